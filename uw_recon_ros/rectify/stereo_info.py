"""Whether two ``CameraInfo`` describe a stereo rig, and which: what R and P of both say."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.types import Axis, CameraModel, StereoCalibration

_MODELS = ("plumb_bob", "rational_polynomial", "equidistant")
_RELATIVE = 1e-3  # focal lengths of both P
_PIXELS = 0.1  # principal points of both P across the baseline


def _check_camera(eye: str, camera: CameraModel) -> None:
    r = camera.r
    if np.abs(r @ r.T - np.eye(3)).max() > 1e-3 or np.linalg.det(r) < 0:
        raise CalibrationError(f"{eye} R: expected a rotation, got {r.tolist()}")
    if camera.distortion_model not in _MODELS:
        raise CalibrationError(
            f"{eye} distortion_model: expected {', '.join(_MODELS)}, got {camera.distortion_model[:40]!a}"
        )
    if abs(camera.p[0, 1]) > 1e-6 * camera.p[0, 0] or camera.p[2].tolist() != [0, 0, 1, 0]:
        raise CalibrationError(f"{eye} P: expected [fx 0 cx Tx; 0 fy cy Ty; 0 0 1 0], got {camera.p.tolist()}")


def _baseline(calibration: StereoCalibration) -> tuple[Axis, float]:
    """Axis and signed baseline, m, from the last column of P."""
    left, right = calibration.left.p, calibration.right.p
    metres = right[:2, 3] / np.diag(right)[:2]
    if np.abs(left[:2, 3]).max() > 1e-9:
        raise CalibrationError(
            f"left P: expected P[3] = P[7] = 0, got {left[0, 3]:g} and {left[1, 3]:g}: are left and right exchanged?"
        )
    if not metres.any():
        raise CalibrationError(
            "right P: expected P[3] = -fx B or P[7] = -fy B, got 0 and 0: two single cameras, not a stereo rig"
        )
    if np.abs(metres).min() > 1e-6 * np.abs(metres).max():
        raise CalibrationError(
            f"right P: expected either P[3] or P[7] to be 0, got {right[0, 3]:g} and {right[1, 3]:g}"
        )
    if metres[0] > 0:
        raise CalibrationError(
            f"right P: expected P[3] = -fx B < 0, got {right[0, 3]:g}: the right camera would stand on the left, "
            "exchange the eyes"
        )
    return ("horizontal", -float(metres[0])) if metres[0] else ("vertical", -float(metres[1]))


def _check_together(calibration: StereoCalibration, axis: Axis) -> None:
    left, right = calibration.left, calibration.right
    if (left.width, left.height) != (right.width, right.height):
        raise CalibrationError(
            f"calibration: expected both cameras of one size, got {left.width}x{left.height} and "
            f"{right.width}x{right.height}"
        )
    focal = np.abs(np.diag(left.p)[:2] / np.diag(right.p)[:2] - 1).max()
    across = 1 if axis == "horizontal" else 0
    centre = abs(left.p[across, 2] - right.p[across, 2])
    if focal > _RELATIVE or centre > _PIXELS:
        name = ("cx", "cy")[across]
        raise CalibrationError(
            f"P: expected one fx, fy and {name} for both rectified views, got fx {left.p[0, 0]:g} and "
            f"{right.p[0, 0]:g}, fy {left.p[1, 1]:g} and {right.p[1, 1]:g}, {name} {left.p[across, 2]:g} and "
            f"{right.p[across, 2]:g}"
        )


def stereo_axis(calibration: StereoCalibration) -> tuple[Axis, float]:
    """Check that a calibration describes a stereo rig.

    Returns
    -------
    axis : {'horizontal', 'vertical'}
    baseline_m : float
        Signed, m; negative for a vertical rig whose second camera is above.

    Raises
    ------
    CalibrationError
        Naming the field, the expectation and what came.
    """
    for eye, camera in (("left", calibration.left), ("right", calibration.right)):
        _check_camera(eye, camera)
    axis, baseline = _baseline(calibration)
    _check_together(calibration, axis)
    return axis, baseline


def has_baseline(calibration: StereoCalibration) -> bool:
    """Whether the cameras are calibrated to each other, and not each for itself."""
    return bool(calibration.left.p[:2, 3].any() or calibration.right.p[:2, 3].any())
