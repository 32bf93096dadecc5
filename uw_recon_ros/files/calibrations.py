"""Calibrations as files: camera_info YAML documents <-> `StereoCalibration`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar

import yaml

from uw_recon_ros.calibration.model import make_camera, short
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files import strict_yaml
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.types import CameraModel, Matrix, StereoCalibration

T = TypeVar("T", dict[str, Any], list[Any], int, str)
_KINDS: dict[type, str] = {dict: "a mapping", list: "a list of numbers", int: "a whole number", str: "text"}


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
        width=width, height=height, k=k, d=d, r=r, p=p, distortion_model=model or _told_lens(document), frame_id=frame
    )


def _told_lens(document: dict[str, Any]) -> str:
    """Some calibrators write ``camera_model: fisheye`` instead of a ``distortion_model``."""
    return "equidistant" if document.get("camera_model") == "fisheye" else ""


def _entry(document: dict[str, Any], key: str, kind: type[T], name: str) -> T:
    """A value that must be there, of a kind."""
    value = document.get(key)
    if not isinstance(value, kind) or isinstance(value, bool):
        told = "nothing" if key not in document else f"{type(value).__name__} {short(str(value))}"
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
    left, right = (
        _camera_from_yaml(d, f"{path}, {side}") for d, side in zip(documents, ("left", "right"), strict=True)
    )
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
