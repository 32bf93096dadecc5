"""Calibrations written in the forms of others; `read_calibration` reads each of them back."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration.stereo_pose import right_from_left
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.findings import Code
from uw_recon_ros.types import CameraModel, Matrix, StereoCalibration


def write_calibration(calibration: StereoCalibration, path: str | Path, form: str = "") -> None:
    """Write a rig's calibration.

    Parameters
    ----------
    calibration : StereoCalibration
    path : path
        A file, written whole or not at all.
    form : {'', 'ros', 'opencv', 'kalibr', 'viame', 'colmap'}
        Empty: ros.

    Raises
    ------
    CalibrationError
        The form cannot hold this lens.
    """
    write_bytes(path, WRITERS[form or "ros"](calibration, Path(path).suffix.lower()))


def write_camera(camera: CameraModel, name: str, path: str | Path) -> None:
    """Write one camera's document alone, as ROS's drivers load it."""
    text = yaml.safe_dump(_ros_camera(camera, name), sort_keys=False, default_flow_style=None)
    write_bytes(path, text.encode())


def _ros(calibration: StereoCalibration, suffix: str) -> bytes:
    cameras = (("left", calibration.left), ("right", calibration.right))
    documents = [_ros_camera(camera, name) for name, camera in cameras]
    return yaml.safe_dump_all(documents, sort_keys=False, default_flow_style=None).encode()


def _ros_camera(camera: CameraModel, name: str) -> dict[str, Any]:
    return {
        "image_width": camera.width,
        "image_height": camera.height,
        "camera_name": name,
        "frame_id": camera.frame_id,
        "camera_matrix": _ros_matrix(camera.k),
        "distortion_model": camera.distortion_model,
        "distortion_coefficients": _ros_matrix(camera.d),
        "rectification_matrix": _ros_matrix(camera.r),
        "projection_matrix": _ros_matrix(camera.p),
    }


def _ros_matrix(values: Matrix) -> dict[str, int | list[float]]:
    rows, cols = values.shape if values.ndim == 2 else (1, values.size)
    return {"rows": rows, "cols": cols, "data": [float(x) for x in values.ravel()]}


def _opencv(calibration: StereoCalibration, suffix: str) -> bytes:
    rotation, translation = right_from_left(calibration)
    left, right = calibration.left, calibration.right
    kind = cv2.FILE_STORAGE_FORMAT_XML if suffix == ".xml" else cv2.FILE_STORAGE_FORMAT_YAML
    storage = cv2.FileStorage("memory", cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY | kind)
    storage.write("image_width", left.width)
    storage.write("image_height", left.height)
    storage.write("distortion_model", left.distortion_model)
    matrices = {"M1": left.k, "D1": left.d, "M2": right.k, "D2": right.d, "R": rotation, "T": translation,
                "R1": left.r, "R2": right.r, "P1": left.p, "P2": right.p}  # fmt: skip
    for name, matrix in matrices.items():
        storage.write(name, np.ascontiguousarray(matrix))
    text: str = storage.releaseAndGetString()
    return text.encode()


def _kalibr(calibration: StereoCalibration, suffix: str) -> bytes:
    rotation, translation = right_from_left(calibration)
    motion = np.vstack([np.hstack([rotation, translation[:, None]]), [[0.0, 0.0, 0.0, 1.0]]])
    document = {f"cam{n}": _kalibr_camera(c, n) for n, c in enumerate((calibration.left, calibration.right))}
    document["cam1"] = {"T_cn_cnm1": motion.tolist(), **document["cam1"]}
    return yaml.safe_dump(document, sort_keys=False, default_flow_style=None).encode()


def _kalibr_camera(camera: CameraModel, number: int) -> dict[str, Any]:
    d = _without_skew(camera, "kalibr").d
    if camera.distortion_model == "plumb_bob" and not d[4:].any():
        model, d = "radtan", d[:4]
    elif camera.distortion_model == "equidistant":
        model = "equidistant"
    else:
        raise _cannot("kalibr", "k3 and more coefficients of radial distortion")
    k = camera.k
    return {
        "cam_overlaps": [1 - number], "camera_model": "pinhole", "distortion_coeffs": d.tolist(),
        "distortion_model": model, "intrinsics": [float(x) for x in (k[0, 0], k[1, 1], k[0, 2], k[1, 2])],
        "resolution": [camera.width, camera.height], "rostopic": f"/cam{number}/image_raw",
    }  # fmt: skip


def _viame(calibration: StereoCalibration, suffix: str) -> bytes:
    rotation, translation = right_from_left(calibration)
    if suffix == ".npz":
        return _viame_arrays(calibration, rotation, 1000.0 * translation)
    values: dict[str, Any] = {"image_width": calibration.left.width, "image_height": calibration.left.height}
    for side, camera in (("left", calibration.left), ("right", calibration.right)):
        values |= _viame_camera(camera, side)
    values |= {"R": rotation.ravel().tolist(), "T": (1000.0 * translation).tolist()}
    return (json.dumps(values, indent=2) + "\n").encode()


def _viame_camera(camera: CameraModel, side: str) -> dict[str, float]:
    if camera.distortion_model == "equidistant" or camera.d.size > 8:
        raise _cannot("VIAME's JSON", f"{camera.distortion_model} with {camera.d.size} coefficients")
    k = _without_skew(camera, "VIAME's JSON").k
    names = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")
    values = {"fx": k[0, 0], "fy": k[1, 1], "cx": k[0, 2], "cy": k[1, 2]} | dict(zip(names, camera.d, strict=False))
    return {f"{name}_{side}": float(value) for name, value in values.items()}


def _viame_arrays(calibration: StereoCalibration, rotation: Matrix, translation_mm: Matrix) -> bytes:
    left, right = calibration.left, calibration.right
    if "equidistant" in (left.distortion_model, right.distortion_model):
        raise _cannot("VIAME's npz", "an equidistant lens")
    stream = io.BytesIO()
    np.savez(
        stream, R=rotation, T=translation_mm.reshape(3, 1), cameraMatrixL=left.k, distCoeffsL=left.d[None],
        cameraMatrixR=right.k, distCoeffsR=right.d[None], image_width=np.array(left.width),
        image_height=np.array(left.height),
    )  # fmt: skip
    return stream.getvalue()


def _colmap(calibration: StereoCalibration, suffix: str) -> bytes:
    rotation, translation = right_from_left(calibration)
    x, y, z, w = Rotation.from_matrix(rotation).as_quat()
    left = {"image_prefix": "left/", "ref_sensor": True, **_colmap_camera(calibration.left)}
    right = {
        "image_prefix": "right/", "cam_from_rig_rotation": [float(q) for q in (w, x, y, z)],
        "cam_from_rig_translation": translation.tolist(), **_colmap_camera(calibration.right),
    }  # fmt: skip
    return (json.dumps([{"cameras": [left, right]}], indent=2) + "\n").encode()


def _colmap_camera(camera: CameraModel) -> dict[str, Any]:
    model, d = _colmap_lens(camera)
    k = _without_skew(camera, "COLMAP").k
    pinhole = [float(x) for x in (k[0, 0], k[1, 1], k[0, 2] + 0.5, k[1, 2] + 0.5)]  # its first pixel's centre: 0.5
    return {"camera_model_name": model, "camera_params": [*pinhole, *map(float, d)]}


def _colmap_lens(camera: CameraModel) -> tuple[str, Matrix]:
    if camera.distortion_model == "equidistant":
        return "OPENCV_FISHEYE", camera.d
    if camera.d.size > 8 and camera.d[8:].any():
        raise _cannot("COLMAP", "thin prism or tilt coefficients")
    if camera.d[4:].any():
        return "FULL_OPENCV", np.concatenate([camera.d[:8], np.zeros(max(0, 8 - camera.d.size))])
    return "OPENCV", camera.d[:4]


def _without_skew(camera: CameraModel, form: str) -> CameraModel:
    if camera.k[0, 1]:
        raise _cannot(form, "a skew of K")
    return camera


def _cannot(form: str, what: str) -> CalibrationError:
    return CalibrationError(f"{form} cannot hold {what}: write it as ros or opencv", Code.CALIBRATION_NOT_WRITTEN)


#: Forms that are written, by name; each gets the file's suffix.
WRITERS: dict[str, Callable[[StereoCalibration, str], bytes]] = {
    "ros": _ros, "opencv": _opencv, "kalibr": _kalibr, "viame": _viame, "colmap": _colmap,
}  # fmt: skip
