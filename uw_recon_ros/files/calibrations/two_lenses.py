"""Forms that hold two lenses and how they stand to each other; each reader returns `together.Parts`."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration.stereo_pose import Lens, Parts, Rectified
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations.document import Document
from uw_recon_ros.files.calibrations.fields import (
    Size,
    as_numbers,
    intrinsics,
    list_of,
    metres_of,
    needed,
    numbers,
    squeezed,
    text_of,
)
from uw_recon_ros.findings import Code
from uw_recon_ros.types import Matrix

# ---- kalibr and EuRoC ------------------------------------------------------------------------------------------------


def kalibr(document: Document, size: Size | None, unit: str | None) -> Parts:
    """``camchain.yaml``: each camera stands to the one before it by ``T_cn_cnm1`` (x_n = T x_n-1)."""
    cameras = {name: value for name, value in document.first.items() if re.fullmatch(r"cam\d+", name)}
    names = sorted(cameras, key=lambda name: int(name[3:]))
    if len(names) != 2 or not all(isinstance(cameras[name], dict) for name in names):
        raise CalibrationError(f"expected cam0 and cam1, got {', '.join(names) or 'none'}: make a file of the two")
    left, right = (_kalibr_lens(cameras[name]) for name in names)
    motion = numbers(cameras[names[1]], "T_cn_cnm1", 16).reshape(4, 4)
    return Parts(left, right, motion[:3, :3], motion[:3, 3] * metres_of(unit, "m"))


def _kalibr_lens(value: dict[str, Any]) -> Lens:
    camera = text_of(value, "camera_model", "pinhole")
    if camera != "pinhole":
        raise CalibrationError(
            f"camera_model: expected pinhole, got {camera[:40]!a}: calibrate with pinhole-radtan or pinhole-equi",
            Code.CALIBRATION_UNKNOWN_MODEL,
        )
    width, height = numbers(value, "resolution", 2)
    given = {"distortion_coeffs": value.get("distortion_coefficients", []), **value}
    model = text_of(value, "distortion_model", "none")
    d = numbers(given, "distortion_coeffs") if model != "none" else np.zeros(5)
    return Lens((int(width), int(height)), intrinsics(*numbers(value, "intrinsics", 4)), d, model)


def euroc(documents: list[Document], size: Size | None, unit: str | None) -> Parts:
    """``cam0/sensor.yaml`` and ``cam1/sensor.yaml``: ``T_BS`` takes a camera's points to the body's."""
    left, right = (_kalibr_lens(document.first) for document in documents)
    motions = [numbers(document.first, "T_BS", 16).reshape(4, 4) for document in documents]
    motion = np.linalg.inv(motions[1]) @ motions[0]
    return Parts(left, right, motion[:3, :3], motion[:3, 3] * metres_of(unit, "m"))


# ---- OpenCV ----------------------------------------------------------------------------------------------------------

#: Names of K, D, R and P, squeezed, without the camera's own mark.
CAMERA_WORDS = {"k": ("m", "k", "cameramatrix", "intrinsicmatrix", "intrinsics", "intrinsic", "mtx", "cm",
                      "cammatrix", "cammat", "cammtx"),
                "d": ("d", "distcoeffs", "distcoeff", "distortioncoefficients", "distortion", "dist", "distcoefs",
                      "distcoef", "distortioncoefs", "distortioncoeffs"),
                "r": ("rect", "r"), "p": ("proj", "p")}  # fmt: skip
#: Names of the right camera's rotation and translation.
MOTION_WORDS = {"r": ("r", "rotation", "rotationmatrix", "rmat", "rot"),
                "t": ("t", "translation", "translationvector", "tvec", "trns", "trans")}  # fmt: skip
_SUFFIXES = (("1", "l", "left"), ("2", "r", "right"))
_ONE_CAMERA = re.compile(r"(?:stereo)?(?:camera|cam)?(left|right|l|r|[012])(?:camera|cam)?")
_BOTH_CAMERAS = ("extrinsics", "extrinsic", "stereo")
_SIZE_PAIRS = (("imagewidth", "imageheight"), ("width", "height"), ("calibrationwidth", "calibrationheight"))
_SIZE_NAMES = ("imagesize", "size", "resolution", "imsize")


def opencv(document: Document, size: Size | None, unit: str | None, default_unit: str = "m") -> Parts:
    """Matrices under the names of OpenCV's samples (M1 D1 M2 D2 R T R1 R2 P1 P2), or any close to them."""
    values, metres = matrices(document), metres_of(unit, default_unit)
    zero_based = any(f"{word}0" in values for word in CAMERA_WORDS["k"])
    suffixes = (("0",), ("1",)) if zero_based else _SUFFIXES
    found_size = opencv_size(values) or needed(size)
    left, right = (_opencv_lens(values, words, found_size) for words in suffixes)
    rectified = _opencv_rectified(values, suffixes, metres)
    if rectified is not None and not has_motion(values):
        return Parts(left, right, *_rectified_motion(rectified), rectified)
    rotation, translation = _opencv_motion(values)
    return Parts(left, right, rotation, translation * metres, rectified)


def matrices(document: Document) -> dict[str, Any]:
    """What a file holds under squeezed names; what stands inside a camera's own part gets the camera's mark."""
    first = document.first
    inside = first["opencv_storage"] if isinstance(first.get("opencv_storage"), dict) else first
    found: dict[str, Any] = {}
    for name, value in inside.items():
        if not isinstance(value, dict) or "data" in value:
            found[squeezed(name)] = value
            continue
        camera = _ONE_CAMERA.fullmatch(squeezed(name))
        if not camera and squeezed(name) not in _BOTH_CAMERAS:
            continue
        found |= {squeezed(inner) + (camera[1] if camera else ""): item for inner, item in value.items()}
    return found


def has_motion(values: dict[str, Any]) -> bool:
    """Whether squeezed names have the right camera's rotation and translation."""
    return all(any(word in values for word in words) for words in MOTION_WORDS.values())


def has_rectified(values: dict[str, Any]) -> bool:
    """Whether squeezed names have R1, R2, P1, P2, which tell them as well."""
    return all(_pick(values, CAMERA_WORDS[name], words) is not None for name in "rp" for words in _SUFFIXES)


def _rectified_motion(rectified: Rectified) -> tuple[Matrix, Matrix]:
    """Rotation and translation, m, of the right camera by how both views were turned, and P's last column."""
    (left, right), (_, view) = rectified.r, rectified.p
    across = view[:, 3] / np.array([view[0, 0], view[1, 1], 1.0])
    return right.T @ left, right.T @ across


def opencv_size(values: dict[str, Any]) -> Size | None:
    """The image size of squeezed names; None where there is none."""
    for width, height in _SIZE_PAIRS:
        if width in values and height in values:
            return int(as_numbers(values[width], width, 1)[0]), int(as_numbers(values[height], height, 1)[0])
    for name in _SIZE_NAMES:
        if name in values:
            width_px, height_px = as_numbers(values[name], name, 2)
            return int(width_px), int(height_px)
    return None


def _pick(values: dict[str, Any], words: tuple[str, ...], suffixes: tuple[str, ...]) -> Any:
    tried = [form for word in words for s in suffixes for form in (f"{word}{s}", f"{s}{word}") if not form.isdigit()]
    return next((values[name] for name in tried if name in values), None)


def _opencv_lens(values: dict[str, Any], suffixes: tuple[str, ...], size: Size) -> Lens:
    k, d = (_pick(values, CAMERA_WORDS[name], suffixes) for name in "kd")
    if k is None or d is None:
        missing = ("M", "cameraMatrix", "mtx", "K") if k is None else ("D", "distCoeffs", "dist")
        names = ", ".join(f"{word}{suffix}" for word in missing for suffix in suffixes[:1])
        side = suffixes[-1] if suffixes[-1] in ("left", "right") else f"camera {suffixes[0]}"
        raise CalibrationError(
            f"expected {names} or the like of {side}, got {list_of(values)}", Code.CALIBRATION_NUMBERS
        )
    coefficients = as_numbers(d, f"D{suffixes[0]}")
    if coefficients.size == 9 and as_numbers(k, f"M{suffixes[0]}").size in (4, 5, 8, 12, 14):
        text = f"M{suffixes[0]} and D{suffixes[0]}: expected a matrix of 9 numbers and coefficients, got them exchanged"
        raise CalibrationError(f"{text}: give each the other's name", Code.CALIBRATION_NUMBERS)
    model = str(values.get("distortionmodel") or values.get("cameramodel") or "plumb_bob")
    return Lens(size, as_numbers(k, f"M{suffixes[0]}", 9).reshape(3, 3), coefficients, model)


def _opencv_motion(values: dict[str, Any]) -> tuple[Matrix, Matrix]:
    r, t = (next((values[word] for word in words if word in values), None) for words in MOTION_WORDS.values())
    if r is None or t is None:
        raise CalibrationError(
            "expected R and T of the right camera beside the matrices of both: the extrinsics are in a file of their "
            "own, most often extrinsics.yml; name both files, or keep them side by side",
            Code.CALIBRATION_NO_BASELINE,
        )
    turn = as_numbers(r, "R")
    rotation = Rotation.from_rotvec(turn).as_matrix() if turn.size == 3 else as_numbers(r, "R", 9).reshape(3, 3)
    return rotation, as_numbers(t, "T", 3)


def _opencv_rectified(values: dict[str, Any], suffixes: Any, metres: float) -> Rectified | None:
    """R1, R2, P1, P2, where all of them are there and of the usual sizes."""
    r = [_pick(values, CAMERA_WORDS["r"], words) for words in suffixes]
    p = [_pick(values, CAMERA_WORDS["p"], words) for words in suffixes]
    if any(value is None for value in (*r, *p)):
        return None
    turns = [as_numbers(value, "R1, R2", 9).reshape(3, 3) for value in r]
    views = [as_numbers(value, "P1, P2", 12).reshape(3, 4).copy() for value in p]
    for view in views:
        view[:, 3] *= metres
    return Rectified((turns[0], turns[1]), (views[0], views[1]))


# ---- VIAME and KWIVER ------------------------------------------------------------------------------------------------


def viame_json(document: Document, size: Size | None, unit: str | None) -> Parts:
    """``fx_left`` ... ``p2_right``, R, T in millimetres."""
    values = document.first
    given = opencv_size({squeezed(name): value for name, value in values.items()}) or needed(size)
    left, right = (_viame_lens(values, side, given) for side in ("left", "right"))
    rotation = numbers(values, "R", 9).reshape(3, 3)
    return Parts(left, right, rotation, numbers(values, "T", 3) * metres_of(unit, "mm"))


def _viame_lens(values: dict[str, Any], side: str, size: Size) -> Lens:
    k = intrinsics(*(float(numbers(values, f"{name}_{side}", 1)[0]) for name in ("fx", "fy", "cx", "cy")))
    names = ["k1", "k2", "p1", "p2", "k3"]
    if f"k4_{side}" in values:
        names += ["k4", "k5", "k6"]
    d = np.array([float(as_numbers(values.get(f"{name}_{side}", 0.0), name, 1)[0]) for name in names])
    return Lens(size, k, d)


def npz(document: Document, size: Size | None, unit: str | None) -> Parts:
    """``cameraMatrixL``, ``distCoeffsL``, ..., R and T in mm, as KWIVER writes them; under other names in metres."""
    return opencv(document, size, unit, default_unit="mm" if "cameraMatrixL" in document.first else "m")


# ---- ZED -------------------------------------------------------------------------------------------------------------

_ZED = {"VGA": (672, 376), "HD": (1280, 720), "FHD": (1920, 1080), "2K": (2208, 1242), "SVGA": (960, 600),
        "FHD1200": (1920, 1200), "QHDPLUS": (3200, 1800), "4K": (3840, 2160), "XVGA": (768, 480)}  # fmt: skip


def zed(document: Document, size: Size | None, unit: str | None) -> Parts:
    """``SN*.conf``: a section a camera and resolution; the baseline and the turns (rad) under ``STEREO``, mm."""
    values = document.first
    modes = [name.removeprefix("LEFT_CAM_") for name in values if name.startswith("LEFT_CAM_")]
    mode = _zed_mode(modes, size)
    left, right = (_zed_lens(values, f"{side}_CAM_{mode}", _ZED[mode]) for side in ("LEFT", "RIGHT"))
    stereo = values.get("STEREO", {})
    turn = [float(as_numbers(stereo.get(f"{name}_{mode}", 0.0), name, 1)[0]) for name in ("RX", "CV", "RZ")]
    across = [float(as_numbers(stereo.get(name, 0.0), name, 1)[0]) for name in ("TY", "TZ")]
    baseline = float(numbers(stereo, "Baseline", 1)[0])
    # Stereolabs' sample hands Rodrigues(RX, CV, RZ) and (Baseline, TY, TZ) to cv::stereoRectify, which takes the sign
    # of the baseline as it comes; the right camera stands on the right
    translation = -np.array([baseline, *across]) * metres_of(unit, "mm")
    return Parts(left, right, Rotation.from_rotvec(turn).as_matrix(), translation)


def _zed_mode(modes: list[str], size: Size | None) -> str:
    known = [mode for mode in modes if mode in _ZED]
    fitting = [mode for mode in known if _ZED[mode] == size]
    if fitting:
        return fitting[0]
    if len(known) == 1:
        return known[0]
    told = ", ".join(f"{mode} ({_ZED[mode][0]}x{_ZED[mode][1]})" for mode in known) or ", ".join(modes[:9]) or "none"
    asked = f"{size[0]}x{size[1]} px" if size else "a size to choose by (convert-calibration --size WxH)"
    raise CalibrationError(f"expected {asked}, got the resolutions {told}", Code.CALIBRATION_SIZE_UNKNOWN)


def _zed_lens(values: dict[str, Any], section: str, size: Size) -> Lens:
    given = values.get(section)
    if not isinstance(given, dict):
        raise CalibrationError(f"expected a section {section}, got {list_of(values)}", Code.CALIBRATION_ONE_CAMERA)
    k = intrinsics(*(float(numbers(given, name, 1)[0]) for name in ("fx", "fy", "cx", "cy")))
    names = ["k1", "k2", "p1", "p2", "k3"]
    if any(given.get(name) for name in ("k4", "k5", "k6")):
        names += ["k4", "k5", "k6"]
    return Lens(size, k, np.array([float(as_numbers(given.get(name, 0.0), name, 1)[0]) for name in names]))


# ---- MATLAB ----------------------------------------------------------------------------------------------------------


def matlab(document: Document, size: Size | None, unit: str | None) -> Parts:
    """The struct of ``toStruct(stereoParams)``, or the Bouguet toolbox's variables; MATLAB counts pixels from 1."""
    values = document.first
    if "fc_left" in values:
        return _bouguet(values, size, unit)
    struct = _with_cameras(values, _DEEPEST)
    if struct is None:
        raise _no_cameras(values)
    cameras = [struct[name] for name in ("CameraParameters1", "CameraParameters2")]
    told = cameras[0].get("WorldUnits")
    metres = metres_of(unit, told if isinstance(told, str) and told else "mm")
    left, right = (_matlab_lens(camera, size) for camera in cameras)
    if isinstance(struct.get("PoseCamera2"), dict):
        pose = struct["PoseCamera2"]
        return Parts(left, right, numbers(pose, "R", 9).reshape(3, 3), numbers(pose, "Translation", 3) * metres)
    # x2 = x1 R + t on rows, so on columns R is transposed
    rotation = numbers(struct, "RotationOfCamera2", 9).reshape(3, 3).T
    return Parts(left, right, rotation, numbers(struct, "TranslationOfCamera2", 3) * metres)


_DEEPEST = 4  # structs in structs


def _with_cameras(values: dict[str, Any], deep: int) -> dict[str, Any] | None:
    """The struct with both cameras: the file's own variables, or one of them."""
    if all(isinstance(values.get(f"CameraParameters{n}"), dict) for n in (1, 2)):
        return values
    inner = (_with_cameras(value, deep - 1) for value in values.values() if isinstance(value, dict) and deep)
    return next((struct for struct in inner if struct is not None), None)


def _no_cameras(values: dict[str, Any]) -> CalibrationError:
    return CalibrationError(
        f"expected a struct with CameraParameters1, CameraParameters2, RotationOfCamera2 and TranslationOfCamera2, got "
        f"{list_of(values)}: in MATLAB, s = toStruct(stereoParams); save('rig.mat', '-struct', 's', '-v7')",
        Code.CALIBRATION_ONE_CAMERA,
    )


def _matlab_lens(camera: dict[str, Any], size: Size | None) -> Lens:
    name = "K" if "K" in camera else "IntrinsicMatrix"
    k = numbers(camera, name, 9).reshape(3, 3)
    k = k.T.copy() if k[2, :2].any() else k.copy()  # IntrinsicMatrix is transposed
    k[:2, 2] -= 1.0
    radial = numbers(camera, "RadialDistortion")
    tangential = as_numbers(camera.get("TangentialDistortion", [0, 0]), "TangentialDistortion", 2)
    d = np.array([*radial[:2], *tangential, *(radial[2:] if radial.size > 2 else [0.0])])
    given = camera.get("ImageSize")
    if given is None or np.size(given) != 2:
        return Lens(needed(size), k, d)
    height, width = as_numbers(given, "ImageSize", 2)
    return Lens((int(width), int(height)), k, d)


def _bouguet(values: dict[str, Any], size: Size | None, unit: str | None) -> Parts:
    given = (int(values["nx"]), int(values["ny"])) if {"nx", "ny"} <= values.keys() else needed(size)
    lenses = []
    for side in ("left", "right"):
        fx, fy = numbers(values, f"fc_{side}", 2)
        skew = float(as_numbers(values.get(f"alpha_c_{side}", 0.0), "alpha_c", 1)[0])
        k = intrinsics(fx, fy, *numbers(values, f"cc_{side}", 2))
        k[0, 1] = skew * fx
        lenses.append(Lens(given, k, numbers(values, f"kc_{side}", 5)))
    rotation = Rotation.from_rotvec(numbers(values, "om", 3)).as_matrix()
    return Parts(lenses[0], lenses[1], rotation, numbers(values, "T", 3) * metres_of(unit, "mm"))


# ---- KITTI -----------------------------------------------------------------------------------------------------------


_KITTI_ALIKE = 1e-3  # of a baseline: the gray and the colour cameras are apart alike


def kitti(document: Document, size: Size | None, unit: str | None) -> Parts:
    """``calib.txt`` or ``calib_cam_to_cam.txt``: P of images that are rectified already, gray or colour."""
    values = document.first
    raw = "P_rect_00" in values or "P_rect_02" in values
    pairs = (("P_rect_00", "P_rect_01"), ("P_rect_02", "P_rect_03")) if raw else (("P0", "P1"), ("P2", "P3"))
    there = [pair for pair in pairs if set(pair) <= values.keys()]
    if not there:
        raise CalibrationError(f"expected P0 and P1, or P_rect_00 and P_rect_01, got {list_of(values)}")
    both = [[numbers(values, name, 12).reshape(3, 4) for name in pair] for pair in there]
    shifts = [float((right[0, 3] - left[0, 3]) / right[0, 0]) for left, right in both]
    if len(both) > 1 and abs(shifts[0] - shifts[1]) > _KITTI_ALIKE * abs(shifts[0]):
        raise CalibrationError(
            f"expected one rig, got the gray cameras ({' and '.join(there[0])}, {abs(shifts[0]):.4f} m apart) and the "
            f"colour ones ({' and '.join(there[1])}, {abs(shifts[1]):.4f} m): keep the lines of the images you have",
            Code.RECORDING_SEVERAL_RIGS,
        )
    names, views = there[0], both[0]
    given = values.get(names[0].replace("P_rect", "S_rect")) if raw else None
    found = (int(given[0]), int(given[1])) if given is not None else needed(size)
    lenses = [Lens(found, view[:, :3].copy(), np.zeros(5)) for view in views]
    shift = (views[1][:, 3] - views[0][:, 3]) / np.array([views[1][0, 0], views[1][1, 1], 1.0])
    shift[1:] = 0.0  # of a mm: what rounding of the rectification leaves
    return Parts(lenses[0], lenses[1], np.eye(3), shift * metres_of(unit, "m"))


# ---- COLMAP ----------------------------------------------------------------------------------------------------------

#: Places of fx, fy, cx, cy in the parameters, then of the distortion in ROS's order (-1: zero), and ROS's model.
_COLMAP: dict[str, tuple[tuple[int, ...], tuple[int, ...], str]] = {
    "SIMPLE_PINHOLE": ((0, 0, 1, 2), (), "plumb_bob"),
    "PINHOLE": ((0, 1, 2, 3), (), "plumb_bob"),
    "SIMPLE_RADIAL": ((0, 0, 1, 2), (3, -1, -1, -1, -1), "plumb_bob"),
    "RADIAL": ((0, 0, 1, 2), (3, 4, -1, -1, -1), "plumb_bob"),
    "OPENCV": ((0, 1, 2, 3), (4, 5, 6, 7, -1), "plumb_bob"),
    "FULL_OPENCV": ((0, 1, 2, 3), (4, 5, 6, 7, 8, 9, 10, 11), "rational_polynomial"),
    "OPENCV_FISHEYE": ((0, 1, 2, 3), (4, 5, 6, 7), "equidistant"),
    "SIMPLE_RADIAL_FISHEYE": ((0, 0, 1, 2), (3, -1, -1, -1), "equidistant"),
    "RADIAL_FISHEYE": ((0, 0, 1, 2), (3, 4, -1, -1), "equidistant"),
}


def colmap_lens(model: str, params: Matrix, size: Size) -> Lens:
    """A camera of COLMAP's; its pixel (0.5, 0.5) is the centre of the first one."""
    if model not in _COLMAP:
        raise CalibrationError(
            f"camera model: expected one of {', '.join(_COLMAP)}, got {model[:40]!a}", Code.CALIBRATION_UNKNOWN_MODEL
        )
    places, distortion, name = _COLMAP[model]
    if params.size <= max((*places, *distortion)):
        raise CalibrationError(
            f"{model}: expected more than {max((*places, *distortion))} parameters, got {params.size}"
        )
    fx, fy, cx, cy = (float(params[place]) for place in places)
    d = np.array([params[place] if place >= 0 else 0.0 for place in distortion])
    return Lens(size, intrinsics(fx, fy, cx - 0.5, cy - 0.5), d if d.size else np.zeros(5), name)


def colmap_rig_config(document: Document, size: Size | None, unit: str | None) -> Parts:
    """``rig_config.json`` of one rig of two cameras with their parameters."""
    rigs = document.values[0]
    cameras = rigs[0].get("cameras") if isinstance(rigs, list) and rigs and isinstance(rigs[0], dict) else None
    if not isinstance(cameras, list) or len(rigs) != 1 or len(cameras) != 2:
        raise CalibrationError("expected one rig of two cameras")
    first, second = sorted(cameras, key=lambda camera: not camera.get("ref_sensor", False))
    lenses = []
    for camera in (first, second):
        if "camera_params" not in camera:
            raise CalibrationError("expected camera_model_name and camera_params of both cameras")
        lenses.append(
            colmap_lens(
                text_of(camera, "camera_model_name"), numbers(camera, "camera_params"), _colmap_size(camera, size)
            )
        )
    turn, moved = numbers(second, "cam_from_rig_rotation", 4), numbers(second, "cam_from_rig_translation", 3)
    return Parts(lenses[0], lenses[1], _turned(turn), moved * metres_of(unit, "m"))


def _colmap_size(camera: dict[str, Any], size: Size | None) -> Size:
    if {"camera_width", "camera_height"} <= camera.keys():
        return int(numbers(camera, "camera_width", 1)[0]), int(numbers(camera, "camera_height", 1)[0])
    return needed(size)


def _turned(wxyz: Matrix) -> Matrix:
    if not np.linalg.norm(wxyz) > 0:
        raise CalibrationError("rotation: expected a quaternion w, x, y, z, got zeros", Code.CALIBRATION_NOT_A_ROTATION)
    return Rotation.from_quat([*wxyz[1:], wxyz[0]]).as_matrix()


def colmap_model(documents: list[Document], size: Size | None, unit: str | None) -> Parts:
    """``cameras.txt`` and ``rigs.txt`` of a sparse model: the first rig of two cameras."""
    tables = {document.name: document.values[0] for document in documents}
    try:
        cameras = {int(row[0]): _colmap_row(row) for row in tables["cameras.txt"]}
        row = next(row for row in tables["rigs.txt"] if int(row[1]) == 2)
        place = row.index("CAMERA", 4)
        reference, second, pose = int(row[3]), int(row[place + 1]), row[place + 3 : place + 10]
        values = as_numbers([float(word) for word in pose], "pose", 7)
        lenses = cameras[reference], cameras[second]
    except (KeyError, ValueError, IndexError, StopIteration) as error:
        raise CalibrationError(
            "expected cameras.txt and rigs.txt of a model with one rig of two cameras and its pose"
        ) from error
    return Parts(lenses[0], lenses[1], _turned(values[:4]), values[4:] * metres_of(unit, "m"))


def _colmap_row(row: list[str]) -> Lens:
    return colmap_lens(row[1], np.array([float(word) for word in row[4:]]), (int(row[2]), int(row[3])))
