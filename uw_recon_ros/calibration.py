"""CameraInfo, as message or YAML file <-> `CameraModel`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import yaml

from uw_recon_ros import strict_yaml
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.images import write_bytes
from uw_recon_ros.types import CameraModel, Matrix, StereoCalibration

_DISTORTION_COUNTS = {"plumb_bob": (4, 5), "rational_polynomial": (8, 12, 14), "equidistant": (4,)}
_LARGEST = 1e9  # px, or px m: what a number of K or P may be
T = TypeVar("T", dict[str, Any], list[Any], int, str)
_KINDS: dict[type, str] = {dict: "a mapping", list: "a list of numbers", int: "a whole number", str: "text"}


def _matrix(name: str, values: Any, shape: tuple[int, int]) -> Matrix:
    try:
        matrix = np.asarray(values, np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"{name}: expected {shape[0] * shape[1]} numbers, got {_short(values)}") from error
    if matrix.size != shape[0] * shape[1] or not (np.abs(matrix) <= _LARGEST).all():  # NaN compares as false
        raise CalibrationError(
            f"{name}: expected {shape[0] * shape[1]} finite numbers up to {_LARGEST:g}, got {_short(matrix.tolist())}"
        )
    return matrix.reshape(shape)


def _short(value: Any) -> str:
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
    intrinsic = _matrix("K", k, (3, 3))
    if not (intrinsic[0, 0] > 0 and intrinsic[1, 1] > 0):
        raise CalibrationError(
            f"K: expected focal lengths > 0, got fx = {intrinsic[0, 0]:g}, fy = {intrinsic[1, 1]:g} (not calibrated)"
        )
    if intrinsic[1, 0] != 0 or intrinsic[2].tolist() != [0, 0, 1]:
        raise CalibrationError(f"K: expected [fx s cx; 0 fy cy; 0 0 1], got {intrinsic.ravel().tolist()}")
    if width <= 0 or height <= 0:
        raise CalibrationError(f"image size: expected > 0 px, got {width}x{height}")
    rotation, projection = _matrix("R", r, (3, 3)), _matrix("P", p, (3, 4))
    if not rotation.any():
        rotation = np.eye(3)
    if not projection.any():
        projection = np.hstack([intrinsic, np.zeros((3, 1))])
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-3:
        raise CalibrationError(f"R: expected a rotation, got {rotation.tolist()}")
    if not (projection[0, 0] > 0 and projection[1, 1] > 0):
        raise CalibrationError(f"P: expected focal lengths > 0, got {projection[0, 0]:g}, {projection[1, 1]:g}")
    return CameraModel(
        int(width), int(height), intrinsic, _distortion(d, distortion_model), rotation, projection,
        distortion_model or "plumb_bob", frame_id,
    )  # fmt: skip


def _distortion(values: Any, model: str) -> Matrix:
    try:
        coefficients = np.asarray(values, np.float64).ravel()
    except (TypeError, ValueError) as error:
        raise CalibrationError(f"D: expected numbers, got {_short(values)}") from error
    if not coefficients.size or not coefficients.any():
        return np.zeros(_DISTORTION_COUNTS.get(model, (5,))[-1])
    if model not in _DISTORTION_COUNTS:
        raise CalibrationError(
            f"distortion_model: expected one of {', '.join(_DISTORTION_COUNTS)}, got {_short(model)}"
        )
    if coefficients.size not in _DISTORTION_COUNTS[model] or not np.isfinite(coefficients).all():
        raise CalibrationError(
            f"D: expected {' or '.join(map(str, _DISTORTION_COUNTS[model]))} finite numbers for {model}, "
            f"got {coefficients.size}: {_short(coefficients.tolist())}"
        )
    return coefficients


def camera_from_info(info: Any) -> CameraModel:
    """Convert a ``sensor_msgs/CameraInfo``, rclpy's or rosbags'.

    Raises
    ------
    CalibrationError
        The camera is not calibrated or its numbers make no sense.
    """
    return make_camera(
        width=info.width, height=info.height, k=info.k, d=info.d, r=info.r, p=info.p,
        distortion_model=info.distortion_model, frame_id=info.header.frame_id,
    )  # fmt: skip


def _camera_from_yaml(document: Any, name: str) -> CameraModel:
    if not isinstance(document, dict):
        raise CalibrationError(f"{name}: expected a camera_info mapping, got {type(document).__name__}")
    k, d, r, p = (
        _entry(_entry(document, key, dict, name), "data", list, f"{name}: {key}")
        for key in ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")
    )
    width, height = (_entry(document, key, int, name) for key in ("image_width", "image_height"))
    model, frame = (_entry({key: "", **document}, key, str, name) for key in ("distortion_model", "frame_id"))
    return make_camera(
        width=width, height=height, k=k, d=d, r=r, p=p, distortion_model=model or "plumb_bob", frame_id=frame
    )


def _entry(document: dict[str, Any], key: str, kind: type[T], name: str) -> T:
    """A value that must be there, of a kind."""
    value = document.get(key)
    if not isinstance(value, kind) or isinstance(value, bool):
        told = "nothing" if key not in document else f"{type(value).__name__} {_short(str(value))}"
        raise CalibrationError(f"{name}: {key}: expected {_KINDS[kind]}, got {told}")
    return value


def read_calibration(path: str | Path) -> StereoCalibration:
    """Read a rig's calibration: two camera_info YAML documents, left then right, as ``camera_calibration`` writes them.

    Raises
    ------
    CalibrationError
        Naming the file and what is wrong in it.
    """
    try:
        documents = [document for document in strict_yaml.read_all(path) if document is not None]
    except strict_yaml.YamlError as error:
        raise CalibrationError(f"{path}: expected a calibration file: {error}") from error
    if len(documents) != 2:
        raise CalibrationError(f"{path}: expected two YAML documents (left, right), got {len(documents)}")
    left, right = (_camera_from_yaml(d, f"{path}, {eye}") for d, eye in zip(documents, ("left", "right"), strict=True))
    return StereoCalibration(left, right)


def _matrix_to_yaml(values: Matrix) -> dict[str, int | list[float]]:
    rows, cols = values.shape if values.ndim == 2 else (1, values.size)
    return {"rows": rows, "cols": cols, "data": [float(x) for x in values.ravel()]}


def _camera_to_yaml(camera: CameraModel, name: str) -> dict[str, Any]:
    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "frame_id": camera.frame_id,
        "camera_matrix": _matrix_to_yaml(camera.k),
        "distortion_model": camera.distortion_model,
        "distortion_coefficients": _matrix_to_yaml(camera.d),
        "rectification_matrix": _matrix_to_yaml(camera.r),
        "projection_matrix": _matrix_to_yaml(camera.p),
    }


def write_calibration(calibration: StereoCalibration, path: str | Path) -> None:
    """Write what `read_calibration` reads."""
    names: Sequence[str] = ("left", "right")
    cameras = (calibration.left, calibration.right)
    documents = [_camera_to_yaml(camera, name) for camera, name in zip(cameras, names, strict=True)]
    text = yaml.safe_dump_all(documents, sort_keys=False, default_flow_style=None)
    write_bytes(path, text.encode())
