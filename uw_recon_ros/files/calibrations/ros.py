"""ROS's forms: camera_info YAML in one file or two, ``ros2 topic echo``, ``ost.txt``."""

from __future__ import annotations

from typing import Any, TypeVar

from uw_recon_ros.calibration.model import as_imaged, make_camera, short
from uw_recon_ros.camera_sides import side_of
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations.document import Document
from uw_recon_ros.files.calibrations.fields import numbers
from uw_recon_ros.types import CameraModel

T = TypeVar("T", dict[str, Any], list[Any], int, str)
_KINDS: dict[type, str] = {dict: "a mapping", list: "a list of numbers", int: "a whole number", str: "text"}
_FILE_KEYS = ("camera_matrix", "distortion_coefficients", "rectification_matrix", "projection_matrix")


def is_camera(value: Any) -> bool:
    """Whether a document describes a camera as ROS's files do."""
    return isinstance(value, dict) and (
        "projection_matrix" in value or ("camera_matrix" in value and "image_width" in value)
    )


def is_echo(value: Any) -> bool:
    """Whether a document is a printed CameraInfo."""
    return isinstance(value, dict) and bool({"k", "K"} & value.keys()) and "header" in value


def is_ost(value: Any) -> bool:
    """Whether a document is a camera of an ``ost.txt``."""
    return isinstance(value, dict) and "camera matrix" in value


def side(document: Document, value: dict[str, Any]) -> int | None:
    """Which camera a document is of, by its names; None where they do not tell."""
    header = value.get("header")
    frame = header.get("frame_id") if isinstance(header, dict) else value.get("frame_id")
    told = [side_of(str(name)) for name in (value.get("camera_name"), document.name.partition(".")[0], frame) if name]
    return next((one for one in told if one is not None), None)


def camera_of_file(value: Any, name: str) -> CameraModel:
    """A camera of a camera_info YAML document."""
    if not isinstance(value, dict):
        raise CalibrationError(f"{name}: expected a camera_info mapping, got {type(value).__name__}")
    k, d, r, p = (_entry(_entry(value, key, dict, name), "data", list, f"{name}: {key}") for key in _FILE_KEYS)
    width, height = (_entry(value, key, int, name) for key in ("image_width", "image_height"))
    model, frame = (_entry({key: "", **value}, key, str, name) for key in ("distortion_model", "frame_id"))
    return make_camera(
        width=width, height=height, k=k, d=d, r=r, p=p, distortion_model=model or _told_lens(value), frame_id=frame
    )


def _told_lens(value: dict[str, Any]) -> str:
    """Some calibrators write ``camera_model: fisheye`` instead of a ``distortion_model``."""
    return "equidistant" if value.get("camera_model") == "fisheye" else ""


def camera_of_echo(value: dict[str, Any], name: str) -> CameraModel:
    """A camera of a CameraInfo as ``topic echo`` prints it, ROS 2's small letters or ROS 1's capitals."""
    lower = {key.lower(): item for key, item in value.items()}
    width, height = (_entry(lower, key, int, name) for key in ("width", "height"))
    k, d, r, p = (numbers(lower, key) for key in "kdrp")
    header = lower.get("header")
    frame = str(header.get("frame_id", "")) if isinstance(header, dict) else ""
    camera = make_camera(
        width=width, height=height, k=k, d=d, r=r, p=p, frame_id=frame,
        distortion_model=_entry({"distortion_model": "", **lower}, "distortion_model", str, name),
    )  # fmt: skip
    given = lower.get("roi")
    roi: dict[str, Any] = given if isinstance(given, dict) else {}
    window = tuple(_entry({key: 0, **roi}, key, int, name) for key in ("x_offset", "y_offset", "width", "height"))
    binning = tuple(_entry({key: 0, **lower}, key, int, name) for key in ("binning_x", "binning_y"))
    return as_imaged(camera, (binning[0], binning[1]), (window[0], window[1], window[2], window[3]))


def camera_of_ost(value: dict[str, Any], name: str) -> CameraModel:
    """A camera of an ``ost.txt``."""
    try:
        width, height = int(value["width"][0]), int(value["height"][0])
        k, d, r, p = (value[key] for key in ("camera matrix", "distortion", "rectification", "projection"))
    except (KeyError, IndexError, TypeError) as error:
        raise CalibrationError(
            f"{name}: expected width, height, camera matrix, distortion, rectification and projection"
        ) from error
    model = "plumb_bob" if len(d) <= 5 else "rational_polynomial"
    return make_camera(width=width, height=height, k=k, d=d, r=r, p=p, distortion_model=model)


def _entry(document: dict[str, Any], key: str, kind: type[T], name: str) -> T:
    """A value that must be there, of a kind."""
    value = document.get(key)
    if not isinstance(value, kind) or isinstance(value, bool):
        told = "nothing" if key not in document else f"{type(value).__name__} {short(str(value))}"
        raise CalibrationError(f"{name}: {key}: expected {_KINDS[kind]}, got {told}")
    return value
