"""Calibrations as people's own scripts and other programs leave them: read right, or named with the way out."""

from __future__ import annotations

import io
import json
import pickle
import tarfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.calibration.stereo_pose import Lens, Parts
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import read_calibration, write_calibration
from uw_recon_ros.findings import Code
from uw_recon_ros.types import StereoCalibration

SIZE = (640, 480)
K = np.array([[500.0, 0, 322], [0, 501, 236], [0, 0, 1]]), np.array([[503.0, 0, 318], [0, 504, 243], [0, 0, 1]])
D = np.array([-0.2, 0.05, 0.001, -0.0005, 0.0]), np.array([-0.21, 0.06, -0.0007, 0.0003, 0.0])
R = Rotation.from_rotvec([0.01, -0.02, 0.015]).as_matrix()
T = np.array([-0.12, 0.002, -0.001])
RIG = Parts(Lens(SIZE, K[0], D[0]), Lens(SIZE, K[1], D[1]), R, T).rig()


def same(found: StereoCalibration) -> None:
    for one, other in ((found.left, RIG.left), (found.right, RIG.right)):
        for name in ("k", "d", "r", "p"):
            assert getattr(one, name) == pytest.approx(getattr(other, name), abs=1e-8), name


def storage(matrices: dict[str, Any]) -> str:
    """A file as OpenCV's FileStorage writes it."""
    text = "%YAML:1.0\n---\n"
    for name, value in matrices.items():
        rows = np.atleast_2d(value)
        data = ", ".join(f"{number:.17g}" for number in rows.ravel())
        shape = f"   rows: {rows.shape[0]}\n   cols: {rows.shape[1]}\n   dt: d\n"
        text += f"{name}: !!opencv-matrix\n{shape}   data: [{data}]\n"
    return text


@pytest.mark.parametrize(
    "names",
    ["cameraMatrix1 distCoeffs1 cameraMatrix2 distCoeffs2 R T", "K1 D1 K2 D2 R T", "mtxL distL mtxR distR Rot Trns",
     "camera_matrix_left dist_coeffs_left camera_matrix_right dist_coeffs_right R T",
     "KL DL KR DR rotation translation", "mtx_l dist_l mtx_r dist_r R T", "camMatL distCoefL camMatR distCoefR R T",
     "cam_mtx_1 dist1 cam_mtx_2 dist2 R trans",
     "Left_Camera_Matrix Left_Distortion_Coefficients Right_Camera_Matrix Right_Distortion_Coefficients R T"],
)  # fmt: skip
def test_matrices_by_other_names(tmp_path: Path, names: str) -> None:
    values = dict(zip(names.split(), (K[0], D[0], K[1], D[1], R, T[:, None]), strict=True))
    (tmp_path / "rig.yml").write_text(storage(values))
    np.savez(tmp_path / "rig.npz", **values)  # type: ignore[arg-type]
    for file in ("rig.yml", "rig.npz"):
        same(read_calibration(tmp_path / file, SIZE))
        with pytest.raises(CalibrationError) as error:
            read_calibration(tmp_path / file)
        assert error.value.code == Code.CALIBRATION_SIZE_UNKNOWN


@pytest.mark.parametrize("sides", [("left", "right"), ("camera_left", "camera_right"), ("cam1", "cam2"), ("0", "1")])
@pytest.mark.parametrize("words", [("K", "D"), ("camera_matrix", "dist_coeff")])
@pytest.mark.parametrize("inner", ["", "extrinsics"])
def test_a_part_of_the_file_for_each_camera(
    tmp_path: Path, sides: tuple[str, str], words: tuple[str, str], inner: str
) -> None:
    pose = {"R": R.tolist(), "T": T.tolist()}
    parts: dict[str, Any] = {"image_size": list(SIZE), **({inner: pose} if inner else pose)}
    for side, k, d in zip(sides, K, D, strict=True):
        parts[side] = dict(zip(words, (k.tolist(), d.tolist()), strict=True))
    (tmp_path / "rig.json").write_text(json.dumps(parts))
    same(read_calibration(tmp_path / "rig.json"))


def test_rectification_tells_the_pose_too(tmp_path: Path) -> None:
    """ORB-SLAM2's LEFT.R, RIGHT.P; or R1, R2, P1, P2 of a script that left R and T out."""
    for names in (("M{}", "D{}", "R{}", "P{}"), ("{}.K", "{}.D", "{}.R", "{}.P")):
        values = {"size": np.array([SIZE])}
        for camera, side in ((RIG.left, ("1", "LEFT")), (RIG.right, ("2", "RIGHT"))):
            mark = side[names[0].startswith("{")]
            for name, value in zip(names, (camera.k, camera.d, camera.r, camera.p), strict=True):
                values[name.format(mark)] = value
        (tmp_path / "rig.yml").write_text(storage(values))
        same(read_calibration(tmp_path / "rig.yml"))


def test_lengths_of_scripts_are_in_metres_or_refused(tmp_path: Path) -> None:
    """KWIVER's names are in millimetres; of others a baseline of centimetres would pass for one of millimetres."""
    for factor, unit in ((1000, "mm"), (100, "cm")):
        values = {"mtxL": K[0], "distL": D[0], "mtxR": K[1], "distR": D[1], "R": R, "T": factor * T}
        np.savez(tmp_path / "rig.npz", rvecs=np.array([{}, None], dtype=object), **values)  # type: ignore[arg-type]
        refused = judge_calibration(read_calibration(tmp_path / "rig.npz", SIZE)).refusal
        assert refused is not None
        assert refused.code == Code.CALIBRATION_BASELINE_IMPLAUSIBLE
        assert "--unit" in str(refused)
        same(read_calibration(tmp_path / "rig.npz", SIZE, unit=unit))


def test_printed_twice_is_one_rig(tmp_path: Path) -> None:
    """``ros2 topic echo`` that ran on: of each camera the messages differ in their stamps only."""
    text = ""
    for n in range(3):
        for name, camera in (("left", RIG.left), ("right", RIG.right)):
            numbers = {key: getattr(camera, key).ravel().tolist() for key in "dkrp"}
            head = {"stamp": {"sec": n, "nanosec": 0}, "frame_id": name}
            value = {"header": head, "width": SIZE[0], "height": SIZE[1], "distortion_model": "plumb_bob", **numbers}
            text += yaml.safe_dump(value) + "---\n"
    (tmp_path / "infos.txt").write_text(text)
    same(read_calibration(tmp_path / "infos.txt"))
    (tmp_path / "infos.txt").write_text(text + text.replace("500.0", "510.0"))
    with pytest.raises(CalibrationError, match="expected 2, got 3"):
        read_calibration(tmp_path / "infos.txt")


def test_a_struct_inside_others(tmp_path: Path) -> None:
    camera = {"RadialDistortion": D[0][:2], "TangentialDistortion": D[0][2:4], "ImageSize": [480.0, 640.0]}
    struct = {f"CameraParameters{n + 1}": camera | {"K": K[n]} for n in (0, 1)}
    pose = {"RotationOfCamera2": np.eye(3), "TranslationOfCamera2": 1000 * T}
    savemat(tmp_path / "rig.mat", {"survey": {"calibration": {**struct, **pose}}})
    assert judge_calibration(read_calibration(tmp_path / "rig.mat")).baseline_m == pytest.approx(np.linalg.norm(T))


def test_kitti_of_gray_or_of_colour_but_not_of_either(tmp_path: Path) -> None:
    p = "718.856 0 607.19 {} 0 718.856 185.21 0 0 0 1 0"
    lines = [f"P{n}: {p.format(x)}\n" for n, x in enumerate((0, -386.1448, 45.38225, -337.2877))]
    for first in (0, 2):
        (tmp_path / "calib.txt").write_text("".join(lines[first : first + 2]))
        baseline = (386.1448, 45.38225 + 337.2877)[first // 2] / 718.856
        assert judge_calibration(read_calibration(tmp_path / "calib.txt", (1241, 376))).baseline_m == pytest.approx(
            baseline
        )
    (tmp_path / "calib.txt").write_text("".join(lines))
    with pytest.raises(CalibrationError, match=r"P0 and P1, 0.5372 m apart.*P2 and P3, 0.5323 m"):
        read_calibration(tmp_path / "calib.txt", (1241, 376))


def damaged_tarball() -> bytes:
    packed = io.BytesIO()
    with tarfile.open(fileobj=packed, mode="w:gz") as archive:
        for name in ("left.yaml", "right.yaml"):
            entry = tarfile.TarInfo(name)
            entry.size = 40
            archive.addfile(entry, io.BytesIO(b"\x00\xff" * 20))
    return packed.getvalue()


@pytest.mark.parametrize(
    ("name", "content", "told"),
    [("a.pkl", pickle.dumps({"mtx": 1}, protocol=4), "a pickle of Python, which is not opened"),
     ("a.npy", b"\x93NUMPY\x01\x00v\x00", "one array of numpy"),
     ("a.xml", '<document version="1.5"><chunk label="1"><sensors/></chunk></document>', "Agisoft Metashape"),
     ("a.json", json.dumps({"batchTime": 0, "cameraData": [[1, {"height": 360}]]}), "OAK"),
     ("a.json", json.dumps({"value0": {"T_imu_cam": [], "intrinsics": []}}), "Basalt"),
     ("a.yaml", "%YAML:1.0\nCamera.type: PinHole\nCamera1.fx: 400.0\nStereo.b: 0.1\n", "ORB-SLAM3"),
     ("a.yaml", "%YAML:1.0\nmodel_type: PINHOLE\ndistortion_parameters: {k1: 0}\nprojection_parameters: {fx: 9}\n",
      "VINS-Fusion"),
     ("a.xml", "<opencv_storage><stereoMapL_x><rows>1</rows><data>1</data></stereoMapL_x></opencv_storage>",
      "maps that rectify"),
     ("a.yml", storage({"mtx": K[0], "dist": D[0]}), "one camera's matrices"),
     ("a.txt", "Calibration results\n===================\ncam0:\n  type: <class 'x'>\n  a: b: c\n", "report of kalibr"),
     ("a.conf", "[LEFT_CAM_VGA]\nfx=700,5\nfy=700,5\ncx=336\ncy=188\n[RIGHT_CAM_VGA]\nfx=1\n[STEREO]\nBaseline=120\n",
      "a decimal comma"),
     ("a.tar.gz", damaged_tarball(), "left.yaml in it")],
)  # fmt: skip
def test_forms_that_are_not_read_are_named(tmp_path: Path, name: str, content: str | bytes, told: str) -> None:
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(CalibrationError, match=told) as error:
        read_calibration(tmp_path / name, SIZE)
    assert "\n" not in str(error.value)
    assert "expected calibration.json" not in str(error.value)  # the list of all forms helps nobody here


def test_written_forms_still_stand_for_themselves(tmp_path: Path) -> None:
    write_calibration(RIG, tmp_path / "rig.npz", "viame")
    same(read_calibration(tmp_path / "rig.npz", SIZE))


def test_a_matrix_and_coefficients_under_each_others_names(tmp_path: Path) -> None:
    np.savez(tmp_path / "rig.npz", K1=D[0], D1=K[0], K2=D[1], D2=K[1], R=R, T=T, image_size=SIZE)
    with pytest.raises(CalibrationError, match="got them exchanged"):
        read_calibration(tmp_path / "rig.npz")


def test_a_baseline_longer_than_rigs_have_is_warned_of(tmp_path: Path) -> None:
    for factor, warned in ((1.0, False), (33.0, True)):
        np.savez(tmp_path / "rig.npz", K1=K[0], D1=D[0], K2=K[1], D2=D[1], R=R, T=factor * T, image_size=SIZE)
        judged = judge_calibration(read_calibration(tmp_path / "rig.npz"))
        assert judged.refusal is None
        codes = [finding.code for finding in judged.findings]
        assert (Code.CALIBRATION_BASELINE_IMPLAUSIBLE in codes) is warned
