"""``calibration.json`` as ``uw_recon calibrate`` writes it: with the medium, the error of depth, and ports."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration.stereo_pose import Lens, Parts
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations.document import Document
from uw_recon_ros.files.calibrations.fields import as_numbers
from uw_recon_ros.findings import Code
from uw_recon_ros.types import CalibrationOrigin, FlatPorts, StereoCalibration

FORMAT = 1
MEDIA = ("water", "air", "unknown")
_SHAPE = {"plumb_bob": ("k1", "k2", "p1", "p2", "k3"), "equidistant": ("k1", "k2", "k3", "k4")}
_FRAMES = ("stereo_left_optical_frame", "stereo_right_optical_frame")


def is_own(document: Document) -> bool:
    """Whether a file is one of ours."""
    return "parameters" in document.first and "depth_errors" in document.first


def rig_of(document: Document) -> StereoCalibration:
    """Read it; without a baseline where the board's squares were not known.

    Raises
    ------
    CalibrationError
        It is of another format, or something in it is missing or no number.
    """
    told = document.first
    if told.get("format") != FORMAT:
        raise CalibrationError(f"format: expected {FORMAT}, got {told.get('format')!r}", Code.CALIBRATION_UNKNOWN_FORM)
    try:
        return _rig(told)
    except (KeyError, TypeError, AttributeError) as error:
        raise CalibrationError(f"expected what uw_recon calibrate writes, got {error!r}") from error


def _rig(told: dict[str, Any]) -> StereoCalibration:
    if told["parameters_unit_of_length"] != "m":
        raise CalibrationError("expected a calibration in metres, got one made without --square-mm")
    size, numbers = (int(told["image_width"]), int(told["image_height"])), told["parameters"]
    left, right = (_lens(numbers, side, size, str(told["distortion_model"]), frame)
                   for side, frame in zip(("left", "right"), _FRAMES, strict=True))  # fmt: skip
    turn, move = (as_numbers([numbers[f"{word}_{axis}"] for axis in "xyz"], word, 3)
                  for word in ("rotation", "translation"))  # fmt: skip
    rig = Parts(left, right, Rotation.from_rotvec(turn).as_matrix(), move).rig()
    return StereoCalibration(rig.left, rig.right, _origin(told))


def _lens(numbers: dict[str, Any], side: str, size: tuple[int, int], model: str, frame: str) -> Lens:
    if model not in _SHAPE:
        raise CalibrationError(f"distortion_model: expected one of {', '.join(_SHAPE)}, got {model!r}")
    fx, fy, cx, cy = as_numbers([numbers[f"{side}_{name}"] for name in ("fx", "fy", "cx", "cy")], side, 4)
    shape = as_numbers([numbers[f"{side}_{name}"] for name in _SHAPE[model]], side)
    return Lens(size, np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), shape, model, frame)


def _origin(told: dict[str, Any]) -> CalibrationOrigin:
    medium = str(told["medium"])
    if medium not in MEDIA:
        raise CalibrationError(f"medium: expected one of {', '.join(MEDIA)}, got {medium!r}")
    rows = [(row["range_m"], row["mean_percent"]) for row in told["depth_errors"] if row["mean_percent"] is not None]
    sigmas = tuple((float(range_m), float(percent) / 100) for range_m, percent in rows)
    if any(not 0 < x < np.inf for row in sigmas for x in row) or sorted(sigmas) != list(sigmas):
        raise CalibrationError(f"depth_errors: expected ranges that grow, and errors over 0, got {rows}")
    return CalibrationOrigin(medium, sigmas, _ports(told.get("ports")))


def _ports(told: dict[str, Any] | None) -> FlatPorts | None:
    if told is None:
        return None
    lengths = (told["distance_m"], told["thickness_m"], told["glass"], told["water"])
    distance, thickness, glass, water = as_numbers(list(lengths), "ports", 4)
    if not (0 <= distance <= 1 and 0 <= thickness <= 0.2 and 1 <= glass <= 2.5 and 1 <= water <= 1.5):
        raise CalibrationError(f"ports: expected m and refractive indices, got {lengths}")
    left, right = (_normal(told[f"normal_{side}"]) for side in ("left", "right"))
    return FlatPorts(float(distance), float(thickness), float(glass), float(water), left, right)


def _normal(told: Any) -> tuple[float, float, float]:
    x, y, z = (float(part) for part in as_numbers(told, "normal", 3))
    if abs(np.hypot(np.hypot(x, y), z) - 1) > 1e-3 or z < 0.5:
        raise CalibrationError(f"ports: expected a unit normal that points forwards, got {[x, y, z]}")
    return x, y, z
