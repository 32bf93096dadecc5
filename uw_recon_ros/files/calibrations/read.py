"""From the files a user names to a rig: which form they are in, what belongs to them, and what is missing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from uw_recon_ros.calibration.stereo_pose import Parts
from uw_recon_ros.camera_sides import partners
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import own_form, ros, two_lenses
from uw_recon_ros.files.calibrations.document import LARGEST_BYTES, Document, read_documents
from uw_recon_ros.files.calibrations.fields import Size, list_of, squeezed
from uw_recon_ros.findings import Code
from uw_recon_ros.system_errors import reason
from uw_recon_ros.types import CameraModel, StereoCalibration

Documents = list[Document]
Paths = str | Path | Sequence[str | Path]
_SUFFIXES = (".yaml", ".yml", ".xml", ".txt", ".json", ".npz", ".mat", ".conf")
_MOST_FILES = 200
_ACCEPTED = (
    "calibration.json of uw_recon calibrate, "
    "camera_info YAML (one file or two, a folder, a tarball of camera_calibration), ost.txt, topic echo, kalibr, "
    "EuRoC, OpenCV yml/xml, VIAME json/npz, ZED conf, MATLAB struct, KITTI, COLMAP"
)


@dataclass(frozen=True)
class Form:
    """One form of calibration files.

    Parameters
    ----------
    name : str
        What a file is taken for, in a sentence.
    pick : callable
        Those of some documents that are of this form, in the order left, right; [] where none is.
    count : int
        How many documents make a rig.
    read : callable
        From them, the image size where it is known, and the unit of lengths where it was told.
    other : str
        What to do where one of two is missing.
    """

    name: str
    pick: Callable[[Documents], Documents]
    count: int
    read: Callable[[Documents, Size | None, str | None], StereoCalibration]
    other: str = ""


def read_calibration(
    path: Paths, image_size: Size | Callable[[], Size | None] | None = None, unit: str | None = None
) -> StereoCalibration:
    """Read a rig's calibration in any form that `FORMS` names.

    Parameters
    ----------
    path : path or two paths
        A file, a folder, a tarball; left and right where each camera has its own. The other of two is found beside it.
    image_size : (width, height), callable or None
        Of the images it is for, px: some forms do not tell theirs, or hold several. A callable is asked only then.
    unit : {'m', 'mm', 'cm', 'in'} or None
        Of lengths, for forms that do not say; None: as the form has it.

    Raises
    ------
    CalibrationError
        Naming the file, what it was taken for, and what is missing.
    """
    given = [Path(one) for one in ([path] if isinstance(path, (str, Path)) else path)]
    name = " and ".join(map(str, given))
    try:
        documents = _documents(given)
        form, chosen = _recognised(documents, given)
    except CalibrationError as error:
        raise CalibrationError(f"{name}: {error}", error.code) from error
    except OSError as error:
        raise CalibrationError(f"{name}: expected a calibration file: {reason(error)}") from error
    try:
        return _read_sized(form, chosen, image_size, unit)
    except (CalibrationError, ValueError, OverflowError) as error:
        code = error.code if isinstance(error, CalibrationError) else Code.CALIBRATION_NUMBERS
        raise CalibrationError(f"{name}: taken for {form.name}: {error}", code) from error


def _read_sized(
    form: Form, chosen: Documents, size: Size | Callable[[], Size | None] | None, unit: str | None
) -> StereoCalibration:
    """Ask for the size of the images only where the file does not tell it."""
    if not callable(size):
        return form.read(chosen, size, unit)
    try:
        return form.read(chosen, None, unit)
    except CalibrationError as error:
        if error.code != Code.CALIBRATION_SIZE_UNKNOWN:
            raise
        return form.read(chosen, size(), unit)


def _documents(given: list[Path]) -> Documents:
    found: Documents = []
    for path in given:
        found += _in_folder(path) if path.is_dir() else read_documents(path)
    return found


def _in_folder(folder: Path) -> Documents:
    """What can be read in a folder, and in its cameras' folders (EuRoC)."""
    files = [file for file in sorted(folder.iterdir()) if file.suffix in _SUFFIXES and file.is_file()]
    files += sorted(folder.glob("cam[0-9]/sensor.yaml"))
    found: Documents = []
    for file in files[:_MOST_FILES]:
        if file.stat().st_size <= LARGEST_BYTES:
            try:
                found += read_documents(file)
            except CalibrationError:
                continue
    if not found:
        raise CalibrationError(f"expected calibration files in this folder, found none: {_ACCEPTED}")
    return found


def _recognised(documents: Documents, given: list[Path]) -> tuple[Form, Documents]:
    """The form of some files; the partner of a lone one is looked for beside it."""
    for form in FORMS:
        picked = form.pick(documents)
        if len(picked) > form.count:
            names = ", ".join(dict.fromkeys(document.name for document in picked))
            raise CalibrationError(
                f"taken for {form.name}: expected {form.count}, got {len(picked)} ({names}): keep those of one rig"
            )
        if len(picked) == form.count:
            return form, picked
    partial = next((form for form in FORMS if form.pick(documents)), None)
    if partial is None:
        raise _unknown(documents)
    beside = _beside(given[0]) if len(given) == 1 and given[0].is_file() else []
    for other in beside:
        together = partial.pick([*documents, *read_documents(other)])
        if len(together) == partial.count:
            return partial, together
    wanted = [file.name for file in _names_beside(given[0])[:3]]
    looked = f"; {' or '.join(wanted)} is not beside it" if wanted and given[0].is_file() else ""
    raise CalibrationError(
        f"taken for {partial.name} of one camera: {partial.other}{looked}", Code.CALIBRATION_ONE_CAMERA
    )


def _names_beside(path: Path) -> list[Path]:
    """Files that may hold the other half, whether they are there or not."""
    names = [path.with_name(name) for name in partners(path.name)]
    for one, other in (
        ("intrinsic", "extrinsic"),
        ("extrinsic", "intrinsic"),
        ("cameras", "rigs"),
        ("rigs", "cameras"),
    ):
        if one in path.name.lower():
            names.append(path.with_name(path.name.lower().replace(one, other)))
    if path.name == "sensor.yaml":
        names += [path.parent.parent / folder / path.name for folder in ("cam0", "cam1")]
    return names


def _beside(path: Path) -> list[Path]:
    """Those that are there, case aside; also where `path` itself is the right one."""
    there = {file.name.lower(): file for file in path.parent.iterdir() if file.is_file() and file != path}
    found = [there[name.name.lower()] for name in _names_beside(path) if name.name.lower() in there]
    found += [file for file in there.values() if path.name.lower() in partners(file.name) and file.suffix in _SUFFIXES]
    found += [name for name in _names_beside(path) if name.parent != path.parent and name.is_file()]
    return [file for file in dict.fromkeys(found) if file.stat().st_size <= LARGEST_BYTES and file != path]


#: Forms that are known and not read, by names at the top of the file or in its first part, and what to do instead.
_NOT_READ: tuple[tuple[set[str], str], ...] = (
    ({"projection"}, "an Agisoft camera file: it holds one camera and no rig: calibrate both together and export both"),
    ({"chunk"}, "a project or camera export of Agisoft Metashape: export both cameras' calibrations as OpenCV XML, and "
     "write R and T of the second one to the first beside them"),
    ({"cameraData"}, "the calibration of an OAK (DepthAI): record camera_info, or write M1 D1 M2 D2 R T"),
    ({"value0"}, "Basalt's calibration, whose models differ: calibrate with kalibr (pinhole-radtan or pinhole-equi)"),
    ({"Camera1.fx"}, "settings of ORB-SLAM3: write M1 D1 M2 D2, and R T = the inverse of Stereo.T_c1_c2"),
    ({"Camera.fx"}, "settings of ORB-SLAM, of one rectified camera: name the calibration they were made from"),
    ({"projection_parameters"}, "a camera of VINS-Fusion, whose rig is in another file: write M1 D1 M2 D2 R T"),
    ({"stereomaplx", "stereomaply", "mapx", "maplx", "map1x", "stereomap1x"}, "maps that rectify, of which no "
     "calibration can be made: write M1 D1 M2 D2 R T of the same script (stereoCalibrate)"),
    ({"mtx", "cameramatrix", "k", "intrinsics"}, "one camera's matrices: calibrate both together, and write M1 D1 M2 "
     "D2 R T"),
)  # fmt: skip


def _unknown(documents: Documents) -> CalibrationError:
    first = documents[0] if documents else Document("", "empty")
    values: dict[str, Any] = first.first
    inner = next((value for value in values.values() if isinstance(value, dict)), {})
    names = values.keys() | inner.keys()
    names |= {squeezed(name) for name in names}
    told = next((text for known, text in _NOT_READ if known & names), "")
    if told:
        return CalibrationError(f"taken for {told}", Code.CALIBRATION_UNKNOWN_FORM)
    return CalibrationError(
        f"expected {_ACCEPTED}; got {first.kind} with {list_of(values)}", Code.CALIBRATION_UNKNOWN_FORM
    )


# ---- what makes a form -----------------------------------------------------------------------------------------------


def _each(documents: Documents, fits: Callable[[Any], bool]) -> Documents:
    """Every document of every file that fits, one by one; of more than two, those that differ but for their times."""
    found = [replace(d, values=[value]) for d in documents for value in d.values if fits(value)]
    if len(found) <= 2:
        return found
    return list({repr(_without_time(d.values[0])): d for d in reversed(found)}.values())[::-1]


def _without_time(value: dict[str, Any]) -> dict[str, Any]:
    """A camera as it is printed; of its header the frame only."""
    header = value.get("header")
    return {**value, "header": header.get("frame_id") if isinstance(header, dict) else header}


def _in_order(found: Documents) -> Documents:
    """Left before right where the names tell; else as they came."""
    sides = [ros.side(document, document.first) for document in found]
    return found[::-1] if sides in ([1, 0], [None, 0], [1, None]) else found


def _ros_form(name: str, fits: Callable[[Any], bool], camera: Callable[[Any, str], CameraModel]) -> Form:
    def read(documents: Documents, size: Size | None, unit: str | None) -> StereoCalibration:
        left, right = (camera(d.values[0], side) for d, side in zip(documents, ("left", "right"), strict=True))
        return StereoCalibration(left, right)

    other = "expected left and right: name both (--calibration LEFT --calibration RIGHT), or keep them together"
    return Form(name, lambda documents: _in_order(_each(documents, fits)), 2, read, other)


def _whole(
    name: str, fits: Callable[[Document], Any], reader: Callable[[Document, Size | None, str | None], Parts]
) -> Form:
    """A form whose one document holds the rig."""
    return Form(
        name, lambda documents: [d for d in documents if fits(d)], 1,
        lambda documents, size, unit: reader(documents[0], size, unit).rig(),
    )  # fmt: skip


def _has_intrinsics(document: Document) -> bool:
    names = two_lenses.matrices(document).keys()
    firsts = [f"{word}{s}" for word in two_lenses.CAMERA_WORDS["k"] for s in ("1", "l", "left", "2", "r", "right")]
    return bool({*firsts, *(f"{s}{word}" for word in two_lenses.CAMERA_WORDS["k"] for s in ("left", "right"))} & names)


def _has_motion(document: Document) -> bool:
    values = two_lenses.matrices(document)
    return two_lenses.has_motion(values) or two_lenses.has_rectified(values)


def _pick_opencv(documents: Documents) -> Documents:
    """One file with everything, or intrinsics and extrinsics, made one."""
    known = [d for d in documents if d.kind in ("yaml", "xml", "json") and (_has_intrinsics(d) or _has_motion(d))]
    whole = [d for d in known if _has_intrinsics(d) and _has_motion(d)]
    if whole or len(known) != 2 or not (any(map(_has_intrinsics, known)) and any(map(_has_motion, known))):
        return whole
    merged: dict[str, Any] = {}
    for document in known:
        inner = document.first.get("opencv_storage", document.first)
        merged |= inner
    return [Document(" and ".join(d.name for d in known), "yaml", [merged])]


def _opencv_halves(documents: Documents) -> Documents:
    return _pick_opencv(documents) * 2 or [d for d in documents if _has_intrinsics(d) or _has_motion(d)][:1]


def _is_kalibr(document: Document) -> bool:
    return any(
        name.startswith("cam") and isinstance(v, dict) and "intrinsics" in v for name, v in document.first.items()
    )


def _is_rig_config(document: Document) -> bool:
    first = document.values[0] if document.values else None
    return isinstance(first, list) and bool(first) and isinstance(first[0], dict) and "cameras" in first[0]


def _is_matlab(document: Document) -> bool:
    return document.kind == "matlab" or any(name.startswith("CameraParameters") for name in document.first)


def _euroc(documents: Documents) -> Documents:
    found = [d for d in documents if "T_BS" in d.first and "intrinsics" in d.first]
    return sorted(found, key=lambda document: document.name)


def _colmap(documents: Documents) -> Documents:
    return [d for d in documents if d.kind == "table" and d.name in ("cameras.txt", "rigs.txt")]


#: In the order they are tried: where a folder holds a rig twice, the first form counts.
FORMS = (
    Form("calibration.json of uw_recon calibrate", lambda documents: [d for d in documents if own_form.is_own(d)], 1,
         lambda documents, size, unit: own_form.rig_of(documents[0])),
    _ros_form("camera_info YAML", ros.is_camera, ros.camera_of_file),
    _ros_form("a printed CameraInfo (ros2 topic echo)", ros.is_echo, ros.camera_of_echo),
    _ros_form("ost.txt of camera_calibration", ros.is_ost, ros.camera_of_ost),
    _whole("a kalibr camchain", _is_kalibr, two_lenses.kalibr),
    Form("EuRoC's sensor.yaml", _euroc, 2, lambda ds, size, unit: two_lenses.euroc(ds, size, unit).rig(),
         "expected cam0/sensor.yaml and cam1/sensor.yaml: name the folder of both"),
    _whole("VIAME's camera JSON", lambda d: "fx_left" in d.first, two_lenses.viame_json),
    _whole("an npz of both cameras' matrices", lambda d: d.kind == "arrays" and _has_intrinsics(d), two_lenses.npz),
    _whole("a ZED conf", lambda d: any(name.startswith("LEFT_CAM_") for name in d.first), two_lenses.zed),
    _whole("MATLAB's stereo parameters", _is_matlab, two_lenses.matlab),
    _whole("KITTI's calibration", lambda d: d.kind == "numbers", two_lenses.kitti),
    _whole("COLMAP's rig_config.json", _is_rig_config, two_lenses.colmap_rig_config),
    Form("a COLMAP model", _colmap, 2, lambda ds, size, unit: two_lenses.colmap_model(ds, size, unit).rig(),
         "expected cameras.txt and rigs.txt: name their folder"),
    Form("OpenCV's stereo matrices", _opencv_halves, 2,
         lambda ds, size, unit: two_lenses.opencv(ds[0], size, unit).rig(),
         "expected M1, D1, M2, D2 and R, T: name both intrinsics and extrinsics"),
)  # fmt: skip
