"""The numbers of one camera: checked for themselves, and put together."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from uw_recon_ros.calibration.judge import DISTORTION_COUNTS, is_rotation, same_proportions
from uw_recon_ros.calibration.names import model_named
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import CameraModel, Matrix, StereoCalibration

_LARGEST = 1e9  # px, or px m: what a number of K or P may be


def _matrix(name: str, values: Any, shape: tuple[int, int]) -> Matrix:
    try:
        matrix = np.asarray(values, np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise CalibrationError(
            f"{name}: expected {shape[0] * shape[1]} numbers, got {short(values)}", Code.CALIBRATION_NUMBERS
        ) from error
    if matrix.size != shape[0] * shape[1] or not (np.abs(matrix) <= _LARGEST).all():  # NaN compares as false
        raise CalibrationError(
            f"{name}: expected {shape[0] * shape[1]} finite numbers up to {_LARGEST:g}, got {short(matrix.tolist())}",
            Code.CALIBRATION_NUMBERS,
        )
    return matrix.reshape(shape)


def short(value: Any) -> str:
    """In one line of bounded length: an outsider chose it."""
    text = ascii(value[:20] if isinstance(value, (str, list, tuple)) else type(value).__name__)
    return text if len(text) <= 400 else f"{text[:400]}..."


def make_camera(
    *,
    width: int,
    height: int,
    k: Any,
    d: Any,
    r: Any,
    p: Any,
    distortion_model: str = "plumb_bob",
    frame_id: str = "",
) -> CameraModel:
    """Check the numbers of one camera and put them together.

    A zero `r` or `p` (not rectified yet) becomes the identity and ``[k | 0]``.

    Raises
    ------
    CalibrationError
        E.g. for ``k[0] = 0``, ROS's way to say "not calibrated".
    """
    distortion_model = model_named(distortion_model, np.size(d) if isinstance(d, (list, tuple, np.ndarray)) else 0)
    intrinsic = _matrix("K", k, (3, 3))
    if not (intrinsic[0, 0] > 0 and intrinsic[1, 1] > 0):
        raise CalibrationError(
            f"K: expected focal lengths > 0, got fx = {intrinsic[0, 0]:g}, fy = {intrinsic[1, 1]:g} (not calibrated)",
            Code.CALIBRATION_NUMBERS if intrinsic[0, 0] else Code.CALIBRATION_NOT_CALIBRATED,
        )
    if intrinsic[1, 0] != 0 or intrinsic[2].tolist() != [0, 0, 1]:
        raise CalibrationError(
            f"K: expected [fx s cx; 0 fy cy; 0 0 1], got {intrinsic.ravel().tolist()}", Code.CALIBRATION_INTRINSICS
        )
    if width <= 0 or height <= 0:
        raise CalibrationError(f"image size: expected > 0 px, got {width}x{height}", Code.CALIBRATION_SIZE_DIFFERS)
    rotation, projection = _matrix("R", r, (3, 3)), _matrix("P", p, (3, 4))
    if not rotation.any():
        rotation = np.eye(3)
    if not projection.any():
        projection = np.hstack([intrinsic, np.zeros((3, 1))])
    if not is_rotation(rotation):
        raise CalibrationError(f"R: expected a rotation, got {rotation.tolist()}", Code.CALIBRATION_NOT_A_ROTATION)
    if not (projection[0, 0] > 0 and projection[1, 1] > 0):
        raise CalibrationError(
            f"P: expected focal lengths > 0, got {projection[0, 0]:g}, {projection[1, 1]:g}",
            Code.CALIBRATION_PROJECTION,
        )
    return CameraModel(
        int(width), int(height), intrinsic, _distortion(d, distortion_model), rotation, projection,
        distortion_model or "plumb_bob", frame_id,
    )  # fmt: skip


def _distortion(values: Any, model: str) -> Matrix:
    try:
        coefficients = np.asarray(values, np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"D: expected numbers, got {short(values)}", Code.CALIBRATION_NUMBERS) from error
    if not model and coefficients.size == 4 and coefficients.any():
        raise CalibrationError(
            "distortion_model: expected plumb_bob or equidistant beside 4 coefficients, got nothing: they fit both",
            Code.CALIBRATION_UNKNOWN_MODEL,
        )
    model = model or "plumb_bob"
    if not coefficients.size or not coefficients.any():
        return np.zeros(DISTORTION_COUNTS.get(model, (5,))[-1])
    if model not in DISTORTION_COUNTS:
        raise CalibrationError(
            f"distortion_model: expected one of {', '.join(DISTORTION_COUNTS)}, got {short(model)}",
            Code.CALIBRATION_UNKNOWN_MODEL,
        )
    if coefficients.size not in DISTORTION_COUNTS[model] or not np.isfinite(coefficients).all():
        raise CalibrationError(
            f"D: expected {' or '.join(map(str, DISTORTION_COUNTS[model]))} finite numbers for {model}, "
            f"got {coefficients.size}: {short(coefficients.tolist())}",
            Code.CALIBRATION_DISTORTION,
        )
    return coefficients


def as_imaged(camera: CameraModel, binning: tuple[int, int], roi: tuple[int, int, int, int]) -> CameraModel:
    """Apply ``binning_x``, ``binning_y`` and ``roi`` of a raw camera's CameraInfo: K and P are the full sensor's.

    Parameters
    ----------
    camera : CameraModel
        At full resolution.
    binning : (x, y)
        0 means 1.
    roi : (x_offset, y_offset, width, height)
        Full resolution px; a width and height of 0 mean everything.

    Returns
    -------
    CameraModel
        Of the images sent. Source: REP 104, and image_geometry's PinholeCameraModel.

    Raises
    ------
    CalibrationError
        The region leaves the sensor.
    """
    x, y, width, height = roi
    step = np.maximum(binning, 1)
    if not (width and height):
        x, y, width, height = 0, 0, camera.width, camera.height
    if x + width > camera.width or y + height > camera.height or width < step[0] or height < step[1]:
        raise CalibrationError(
            f"binning and roi: expected a region within {camera.width}x{camera.height} px, got {width}x{height} at "
            f"({x}, {y}), binning {step[0]}x{step[1]}",
            Code.CALIBRATION_BINNING,
        )
    to_image = np.array([[1 / step[0], 0, -x / step[0]], [0, 1 / step[1], -y / step[1]], [0, 0, 1]])
    size = int(width // step[0]), int(height // step[1])
    return replace(
        camera, width=size[0], height=size[1], k=to_image @ camera.k, p=to_image @ camera.p,
        binning=(int(step[0]), int(step[1])),
    )  # fmt: skip


def scaled(calibration: StereoCalibration, size: tuple[int, int]) -> StereoCalibration:
    """The calibration of the same rig whose images are made smaller or larger as a whole.

    Parameters
    ----------
    calibration : StereoCalibration
    size : (width, height)
        px.

    Raises
    ------
    CalibrationError
        The proportions differ: another mode of the camera shows another part of the sensor, which no scale tells.
    """
    return replace(calibration, left=_scaled(calibration.left, size), right=_scaled(calibration.right, size))


def _scaled(camera: CameraModel, size: tuple[int, int]) -> CameraModel:
    x, y = size[0] / camera.width, size[1] / camera.height
    if not same_proportions(size, (camera.width, camera.height)):
        raise CalibrationError(
            f"size: expected the proportions of {camera.width}x{camera.height} px, got {size[0]}x{size[1]}: the camera "
            "cuts its image off in one of both modes; calibrate in the mode that is recorded",
            Code.CALIBRATION_SIZE_DIFFERS,
        )
    to_size = np.array([[x, 0, (x - 1) / 2], [0, y, (y - 1) / 2], [0, 0, 1]])  # pixel centres are whole numbers
    return replace(camera, width=size[0], height=size[1], k=to_size @ camera.k, p=to_size @ camera.p)
