"""Calibration files of every form: the same rig comes out of each; the forms' own libraries judge."""

from __future__ import annotations

import io
import json
import tarfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.io import savemat
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration import scaled
from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.calibration.stereo_pose import Lens, Parts, right_from_left
from uw_recon_ros.cli import main
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import FORMS, WRITERS, read_calibration, write_calibration
from uw_recon_ros.findings import Code
from uw_recon_ros.types import CameraModel, StereoCalibration

SIZE = (640, 480)
TURN = np.array([0.01, -0.02, 0.015])
MOVED = np.array([-0.12, 0.002, -0.001])
K = np.array([[500.0, 0, 322], [0, 501, 236], [0, 0, 1]]), np.array([[503.0, 0, 318], [0, 504, 243], [0, 0, 1]])
D = np.array([-0.2, 0.05, 0.001, -0.0005, 0.0]), np.array([-0.21, 0.06, -0.0007, 0.0003, 0.0])
FISH = np.array([0.02, -0.004, 0.001, -0.0002])


def rig(model: str = "plumb_bob", moved: np.ndarray = MOVED) -> StereoCalibration:
    d = (FISH, 1.1 * FISH) if model == "equidistant" else D
    lenses = [Lens(SIZE, k, c, model) for k, c in zip(K, d, strict=True)]
    return Parts(lenses[0], lenses[1], Rotation.from_rotvec(TURN).as_matrix(), moved).rig()


def same(one: StereoCalibration, other: StereoCalibration, within: float = 1e-9) -> None:
    for a, b in ((one.left, other.left), (one.right, other.right)):
        assert (a.width, a.height, a.distortion_model) == (b.width, b.height, b.distortion_model)
        for name in ("k", "r", "p"):
            assert getattr(a, name) == pytest.approx(getattr(b, name), abs=within)
        length = max(a.d.size, b.d.size)
        assert np.pad(a.d, (0, length - a.d.size)) == pytest.approx(np.pad(b.d, (0, length - b.d.size)), abs=within)


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
@pytest.mark.parametrize("moved", [MOVED, np.array([0.001, -0.2, 0.002]), np.array([0.001, 0.2, 0.002])])
def test_rows_of_a_rig_agree_with_opencv(model: str, moved: np.ndarray) -> None:
    """A point in space falls on one row (column) of both rectified views, by OpenCV's projection."""
    made = rig(model, moved)
    assert judge_calibration(made).refusal is None
    points = np.random.default_rng(1).uniform([-0.5, -0.4, 1.5], [0.5, 0.4, 4.0], (50, 3))
    views = []
    rotation = Rotation.from_rotvec(TURN).as_matrix()
    for camera, seen in ((made.left, points), (made.right, points @ rotation.T + moved)):
        project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
        raw = project(seen[:, None], np.zeros(3), np.zeros(3), camera.k, camera.d)[0]
        undo = cv2.fisheye.undistortPoints if model == "equidistant" else cv2.undistortPoints
        views.append(undo(raw, camera.k, camera.d, R=camera.r, P=camera.p[:, :3])[:, 0])
    across = 0 if abs(moved[1]) > abs(moved[0]) else 1
    assert np.abs(views[0][:, across] - views[1][:, across]).max() < 1e-3
    assert judge_calibration(made).baseline_m == pytest.approx(np.linalg.norm(moved) * (-1 if moved[1] > 0.1 else 1))


@pytest.mark.parametrize("form", sorted(WRITERS))
@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_what_is_written_is_read_back(tmp_path: Path, form: str, model: str) -> None:
    file = tmp_path / {"opencv": "s.yml", "viame": "s.json", "colmap": "rig_config.json"}.get(form, "s.yaml")
    if (form, model) == ("viame", "equidistant"):
        with pytest.raises(CalibrationError, match="cannot hold") as refused:
            write_calibration(rig(model), file, form)
        assert refused.value.code == Code.CALIBRATION_NOT_WRITTEN
        return
    write_calibration(rig(model), file, form)
    same(read_calibration(file, SIZE), rig(model), 1e-6)


@settings(max_examples=25, deadline=None)
@given(
    st.sampled_from([("opencv", ".yml"), ("opencv", ".xml"), ("kalibr", ".yaml"), ("viame", ".json"), ("viame", ".npz"),
                     ("colmap", ".json"), ("ros", ".yaml")]),
    st.lists(st.floats(-0.05, 0.05), min_size=3, max_size=3), st.floats(0.02, 1.0), st.floats(-0.3, 0.3),
    st.floats(200, 2000),
)  # fmt: skip
def test_any_rig_comes_back(
    tmp_path_factory: pytest.TempPathFactory,
    form: tuple[str, str],
    turn: list[float],
    baseline: float,
    k1: float,
    f: float,
) -> None:
    k = np.array([[f, 0, 320.5], [0, f * 1.001, 239.5], [0, 0, 1]])
    lens = Lens(SIZE, k, np.array([k1, 0.01, 0.001, -0.002, 0]))
    made = Parts(lens, lens, Rotation.from_rotvec(turn).as_matrix(), np.array([-baseline, 0.001, 0.002])).rig()
    file = tmp_path_factory.mktemp("any") / f"rig{form[1]}"
    write_calibration(made, file, form[0])
    same(read_calibration(file, SIZE), made, 1e-6 * f)


@pytest.mark.parametrize("suffix", [".yml", ".xml"])
def test_opencv_reads_what_is_written_and_the_reverse(tmp_path: Path, suffix: str) -> None:
    made, file = rig(), tmp_path / f"s{suffix}"
    write_calibration(made, file, "opencv")
    storage = cv2.FileStorage(str(file), cv2.FILE_STORAGE_READ)
    rotation, moved = storage.getNode("R").mat(), storage.getNode("T").mat().ravel()
    assert rotation == pytest.approx(Rotation.from_rotvec(TURN).as_matrix(), abs=1e-12)
    assert moved == pytest.approx(MOVED, abs=1e-12)
    assert storage.getNode("P2").mat() == pytest.approx(made.right.p)
    theirs = tmp_path / f"t{suffix}"
    out = cv2.FileStorage(str(theirs), cv2.FILE_STORAGE_WRITE)
    for name, value in (("cameraMatrix1", K[0]), ("distCoeffs1", D[0]), ("cameraMatrix2", K[1]), ("distCoeffs2", D[1]),
                        ("R", rotation), ("T", moved)):  # fmt: skip
        out.write(name, value)
    out.release()
    same(read_calibration(theirs, SIZE), made)
    with pytest.raises(CalibrationError, match="size of the images") as error:
        read_calibration(theirs)
    assert error.value.code == Code.CALIBRATION_SIZE_UNKNOWN
    text = theirs.read_text().replace("%YAML 1.2", "%YAML:1.0") if suffix == ".yml" else theirs.read_text()
    theirs.write_text(text)
    same(read_calibration(theirs, lambda: SIZE), made)


def test_intrinsics_and_extrinsics_in_two_files(tmp_path: Path) -> None:
    """As OpenCV's stereo_calib sample writes them; either file finds the other."""
    rotation = Rotation.from_rotvec(TURN).as_matrix()
    for name, values in (
        ("intrinsics.yml", {"M1": K[0], "D1": D[0], "M2": K[1], "D2": D[1]}),
        ("extrinsics.yml", {"R": rotation, "T": MOVED}),
    ):
        out = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
        for key, value in values.items():
            out.write(key, value)
        out.release()
    for files in ("intrinsics.yml", "extrinsics.yml", "."):
        same(read_calibration(tmp_path / files, SIZE), rig())
    same(read_calibration([tmp_path / "extrinsics.yml", tmp_path / "intrinsics.yml"], SIZE), rig())
    (tmp_path / "extrinsics.yml").unlink()
    with pytest.raises(CalibrationError, match="R, T") as error:
        read_calibration(tmp_path / "intrinsics.yml", SIZE)
    assert error.value.code == Code.CALIBRATION_ONE_CAMERA


def split(folder: Path, names: tuple[str, str]) -> None:
    write_calibration(rig(), folder / "both.yaml")
    left, right = (folder / "both.yaml").read_text().split("---\n")
    (folder / "both.yaml").unlink()
    for name, text in zip(names, (left, right), strict=True):
        (folder / name).write_text(text)


@pytest.mark.parametrize(
    "names", [("left.yaml", "right.yaml"), ("cam_L.yml", "cam_R.yml"), ("port.yaml", "starboard.yaml")]
)
def test_a_file_for_each_camera(tmp_path: Path, names: tuple[str, str]) -> None:
    split(tmp_path, names)
    paths = [tmp_path / name for name in names]
    for given_paths in (paths[0], paths[1], paths, paths[::-1], tmp_path):
        same(read_calibration(given_paths), rig())
    paths[1].unlink()
    with pytest.raises(CalibrationError, match=names[1].lower()) as error:
        read_calibration(paths[0])
    assert error.value.code == Code.CALIBRATION_ONE_CAMERA


def test_the_tarball_that_camera_calibration_saves(tmp_path: Path) -> None:
    split(tmp_path, ("left.yaml", "right.yaml"))
    with tarfile.open(tmp_path / "calibrationdata.tar.gz", "w:gz") as archive:
        for name in ("right.yaml", "left.yaml"):
            archive.add(tmp_path / name, name)
        picture = tarfile.TarInfo("left-0000.png")
        picture.size = 3 * 2**20
        archive.addfile(picture, io.BytesIO(bytes(picture.size)))
        (tmp_path / "ost.txt").write_text(ost(rig()))
        archive.add(tmp_path / "ost.txt", "ost.txt")
    same(read_calibration(tmp_path / "calibrationdata.tar.gz"), rig())
    whole = (tmp_path / "calibrationdata.tar.gz").read_bytes()
    (tmp_path / "cut.tar.gz").write_bytes(whole[: len(whole) // 3])
    with pytest.raises(CalibrationError, match="damaged"):
        read_calibration(tmp_path / "cut.tar.gz")


def rows(matrix: np.ndarray) -> str:
    return "\n".join(" ".join(f"{x:.12f}" for x in row) for row in np.atleast_2d(matrix))


def ost(calibration: StereoCalibration) -> str:
    return "\n".join(
        f"# oST version 5.0 parameters\n\n\n[image]\n\nwidth\n{c.width}\n\nheight\n{c.height}\n\n"
        f"[narrow_stereo/{side}]\n\ncamera matrix\n{rows(c.k)}\n\ndistortion\n{rows(c.d)}\n\n"
        f"rectification\n{rows(c.r)}\n\nprojection\n{rows(c.p)}\n"
        for side, c in (("left", calibration.left), ("right", calibration.right))
    )


def echo(camera: CameraModel, frame: str, upper: bool = False) -> str:
    message = {"header": {"stamp": {"sec": 1, "nanosec": 0}, "frame_id": frame}, "height": camera.height,
               "width": camera.width, "distortion_model": camera.distortion_model,
               **{name.upper() if upper else name: getattr(camera, name).ravel().tolist() for name in "dkrp"},
               "binning_x": 0, "binning_y": 0,
               "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False}}  # fmt: skip
    return yaml.safe_dump(message) + "---\n"


def test_ost_and_echo(tmp_path: Path) -> None:
    made = rig()
    (tmp_path / "ost.txt").write_text(ost(made))
    same(read_calibration(tmp_path / "ost.txt"), made, 1e-8)
    for upper in (False, True):
        (tmp_path / "echo.yaml").write_text(echo(made.right, "rig_right", upper) + echo(made.left, "rig_left", upper))
        same(read_calibration(tmp_path / "echo.yaml"), made)
    (tmp_path / "echo.yaml").write_text(echo(made.left, "rig_left"))
    with pytest.raises(CalibrationError, match=r"topic echo.*one camera"):
        read_calibration(tmp_path / "echo.yaml")


def test_kalibr_and_euroc(tmp_path: Path) -> None:
    rotation = Rotation.from_rotvec(TURN).as_matrix()
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = rotation, MOVED
    cameras = [
        {"camera_model": "pinhole", "distortion_model": "radtan", "distortion_coeffs": d[:4].tolist(),
         "intrinsics": [float(k[0, 0]), float(k[1, 1]), float(k[0, 2]), float(k[1, 2])], "resolution": list(SIZE)}
        for k, d in zip(K, D, strict=True)
    ]  # fmt: skip
    chain = {"cam0": cameras[0], "cam1": {"T_cn_cnm1": motion.tolist(), **cameras[1]}}
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(chain))
    same(read_calibration(tmp_path / "camchain.yaml"), rig())
    body = np.linalg.inv(motion)  # of the right camera, where the left one is the body
    for number, pose in enumerate((np.eye(4), body)):
        (tmp_path / f"cam{number}").mkdir()
        sensor = {"sensor_type": "camera", "T_BS": {"cols": 4, "rows": 4, "data": pose.ravel().tolist()},
                  **cameras[number], "distortion_model": "radial-tangential",
                  "distortion_coefficients": cameras[number]["distortion_coeffs"]}  # fmt: skip
        del sensor["distortion_coeffs"]
        (tmp_path / f"cam{number}" / "sensor.yaml").write_text("%YAML:1.0\n" + yaml.safe_dump(sensor))
    (tmp_path / "camchain.yaml").unlink()
    for path in (tmp_path, tmp_path / "cam0" / "sensor.yaml", tmp_path / "cam1" / "sensor.yaml"):
        same(read_calibration(path), rig())
    chain["cam0"]["camera_model"] = "omni"
    (tmp_path / "camchain.yaml").write_text(yaml.safe_dump(chain))
    with pytest.raises(CalibrationError, match=r"taken for a kalibr camchain: camera_model: expected pinhole"):
        read_calibration(tmp_path / "camchain.yaml")


def test_viame_is_in_millimetres(tmp_path: Path) -> None:
    write_calibration(rig(), tmp_path / "cams.json", "viame")
    told = json.loads((tmp_path / "cams.json").read_text())
    assert told["T"] == pytest.approx(1000 * MOVED)
    np.savez(tmp_path / "cams.npz", cameraMatrixL=K[0], distCoeffsL=D[0][None], cameraMatrixR=K[1],
             distCoeffsR=D[1][None], R=Rotation.from_rotvec(TURN).as_matrix(), T=1000 * MOVED[:, None])  # fmt: skip
    same(read_calibration(tmp_path / "cams.npz", SIZE), rig())
    wrong = read_calibration(tmp_path / "cams.npz", SIZE, unit="m")
    assert judge_calibration(wrong).refusal.code == Code.CALIBRATION_BASELINE_IMPLAUSIBLE  # type: ignore[union-attr]


def zed_conf(modes: tuple[str, ...] = ("VGA", "HD")) -> str:
    lines = []
    for mode in modes:
        for side, k, d in (("LEFT", K[0], D[0]), ("RIGHT", K[1], D[1])):
            lines += [f"[{side}_CAM_{mode}]", f"fx={k[0, 0]}", f"fy={k[1, 1]}", f"cx={k[0, 2]}", f"cy={k[1, 2]}"]
            lines += [f"{name}={value}" for name, value in zip(("k1", "k2", "p1", "p2", "k3"), d, strict=True)]
    lines += ["[STEREO]", "Baseline=120", "TY=-2", "TZ=1"]
    lines += [f"{n}_{m}={v}" for m in modes for n, v in zip(("RX", "CV", "RZ"), TURN, strict=True)]
    return "\n".join(lines)


def test_zed_rectifies_as_its_maker_does(tmp_path: Path) -> None:
    (tmp_path / "SN1.conf").write_text(zed_conf())
    found = read_calibration(tmp_path / "SN1.conf", (672, 376))
    assert (found.left.width, found.left.height) == (672, 376)
    r1, r2, *_ = cv2.stereoRectify(
        K[0], D[0], K[1], D[1], (672, 376), cv2.Rodrigues(TURN)[0], np.array([[120.0], [-2], [1]])
    )
    assert found.left.r[0] == pytest.approx(r1[0], abs=1e-9)  # along the baseline; about it, either may turn both
    assert found.right.r[0] == pytest.approx(r2[0], abs=1e-9)
    assert found.right.r.T @ found.left.r == pytest.approx(cv2.Rodrigues(TURN)[0], abs=1e-9)
    assert judge_calibration(found).baseline_m == pytest.approx(np.linalg.norm([0.12, 0.002, 0.001]))
    with pytest.raises(CalibrationError, match="VGA") as error:
        read_calibration(tmp_path / "SN1.conf")
    assert error.value.code == Code.CALIBRATION_SIZE_UNKNOWN


def matlab_struct(transposed: bool) -> dict[str, Any]:
    def camera(k: np.ndarray, d: np.ndarray) -> dict[str, Any]:
        one_based = k + np.array([[0, 0, 1], [0, 0, 1], [0, 0, 0]])
        matrix = {"IntrinsicMatrix": one_based.T} if transposed else {"K": one_based}
        return {**matrix, "RadialDistortion": d[:2], "TangentialDistortion": d[2:4], "ImageSize": [480.0, 640.0],
                "WorldUnits": "millimeters"}  # fmt: skip

    rotation = Rotation.from_rotvec(TURN).as_matrix()
    pose = {"RotationOfCamera2": rotation.T, "TranslationOfCamera2": 1000 * MOVED}
    if not transposed:
        pose = {"PoseCamera2": {"R": rotation, "Translation": 1000 * MOVED}}  # type: ignore[dict-item]
    return {"CameraParameters1": camera(K[0], D[0]), "CameraParameters2": camera(K[1], D[1]), **pose}


@pytest.mark.parametrize("transposed", [True, False])
def test_matlab(tmp_path: Path, transposed: bool) -> None:
    savemat(tmp_path / "rig.mat", matlab_struct(transposed))
    savemat(tmp_path / "inner.mat", {"s": matlab_struct(transposed)})
    for name in ("rig.mat", "inner.mat"):
        same(read_calibration(tmp_path / name), rig(), 1e-9)
    turn = {"om": TURN, "T": 1000 * MOVED, "nx": 640, "ny": 480}
    for side, k, d in (("left", K[0], D[0]), ("right", K[1], D[1])):
        turn |= {f"fc_{side}": np.diag(k)[:2], f"cc_{side}": k[:2, 2], f"kc_{side}": d, f"alpha_c_{side}": 0.0}
    savemat(tmp_path / "Calib_Results_stereo.mat", turn)
    same(read_calibration(tmp_path / "Calib_Results_stereo.mat"), rig())
    savemat(tmp_path / "one.mat", {"cameraParams": {"K": K[0]}})
    with pytest.raises(CalibrationError, match="toStruct"):
        read_calibration(tmp_path / "one.mat")
    (tmp_path / "cut.mat").write_bytes((tmp_path / "rig.mat").read_bytes()[:300])
    with pytest.raises(CalibrationError, match="damaged"):
        read_calibration(tmp_path / "cut.mat")


def test_kitti(tmp_path: Path) -> None:
    p = "718.856 0 607.19 {} 0 718.856 185.21 0 0 0 1 0"
    (tmp_path / "calib.txt").write_text(f"P0: {p.format(0)}\nP1: {p.format(-386.1448)}\nTr: {p.format(0)}\n")
    found = read_calibration(tmp_path / "calib.txt", (1241, 376))
    assert judge_calibration(found).baseline_m == pytest.approx(386.1448 / 718.856)
    text = "".join(f"S_rect_0{n}: 1242 375\nP_rect_0{n}: {p.format(x)}\n" for n, x in ((2, 44.85), (3, -339.5)))
    (tmp_path / "calib_cam_to_cam.txt").write_text("calib_time: 09-Jan-2012 13:57:47\n" + text)
    colour = read_calibration(tmp_path / "calib_cam_to_cam.txt")
    assert judge_calibration(colour).baseline_m == pytest.approx((44.85 + 339.5) / 718.856)
    assert judge_calibration(colour).refusal is None


@pytest.mark.parametrize("model", ["plumb_bob", "equidistant"])
def test_colmap_reads_what_is_written(tmp_path: Path, model: str) -> None:
    pycolmap = pytest.importorskip("pycolmap", reason="the real COLMAP: pip install pycolmap")
    write_calibration(rig(model), tmp_path / "rig_config.json", "colmap")
    (config,) = pycolmap.read_rig_config(tmp_path / "rig_config.json")
    first, second = config.cameras
    points = np.random.default_rng(2).uniform([-0.4, -0.3, 1.5], [0.4, 0.3, 3.0], (20, 3))
    pose = second.cam_from_rig
    for camera, seen in ((first.camera, points), (second.camera, np.array([pose * point for point in points]))):
        ours = rig(model).left if camera is first.camera else rig(model).right
        theirs = np.array([camera.img_from_cam(point) for point in seen])
        project = cv2.fisheye.projectPoints if model == "equidistant" else cv2.projectPoints
        expected = project(seen[:, None], np.zeros(3), np.zeros(3), ours.k, ours.d)[0][:, 0] + 0.5
        assert theirs == pytest.approx(expected, abs=1e-6)
    rotation, moved = right_from_left(rig(model))
    assert np.array([pose * point for point in points]) == pytest.approx(points @ rotation.T + moved)


def test_a_colmap_model(tmp_path: Path) -> None:
    x, y, z, w = Rotation.from_rotvec(TURN).as_quat()
    cameras = "# Camera list with one line of data per camera:\n" + "".join(
        f"{n} OPENCV 640 480 {k[0, 0]} {k[1, 1]} {k[0, 2] + 0.5} {k[1, 2] + 0.5} {d[0]} {d[1]} {d[2]} {d[3]}\n"
        for n, k, d in ((1, K[0], D[0]), (2, K[1], D[1]))
    )
    (tmp_path / "cameras.txt").write_text(cameras)
    pose = " ".join(str(float(v)) for v in (w, x, y, z, *MOVED))
    (tmp_path / "rigs.txt").write_text(f"# Rig calib list\n1 2 CAMERA 1 CAMERA 2 1 {pose}\n")
    for path in (tmp_path, tmp_path / "cameras.txt", tmp_path / "rigs.txt"):
        same(read_calibration(path), rig())


@pytest.mark.parametrize(
    ("told", "name"),
    [("radtan", "plumb_bob"), ("fisheye", "equidistant"), ("pinhole", "plumb_bob"), ("Kannala_Brandt4", "equidistant"),
     ("brown-conrady", "plumb_bob")],
)  # fmt: skip
def test_models_have_other_names(tmp_path: Path, told: str, name: str) -> None:
    made = rig(name)
    write_calibration(made, tmp_path / "rig.yaml")
    (tmp_path / "rig.yaml").write_text((tmp_path / "rig.yaml").read_text().replace(f"model: {name}", f"model: {told}"))
    same(read_calibration(tmp_path / "rig.yaml"), made)


def test_scaled_to_another_resolution(tmp_path: Path) -> None:
    half = scaled(rig(), (320, 240))
    point = np.array([[[0.1, -0.2, 2.0]]])
    for whole, small in ((rig().left, half.left), (rig().right, half.right)):
        a, b = (cv2.projectPoints(point, np.zeros(3), np.zeros(3), c.k, c.d)[0].ravel() for c in (whole, small))
        assert b == pytest.approx((a + 0.5) / 2 - 0.5)  # averaging two by two pixels moves centres so
    assert judge_calibration(half).baseline_m == pytest.approx(judge_calibration(rig()).baseline_m)
    with pytest.raises(CalibrationError, match="proportions"):
        scaled(rig(), (640, 360))
    write_calibration(rig(), tmp_path / "rig.yaml")
    assert main(["convert-calibration", str(tmp_path / "rig.yaml"), "-o", str(tmp_path / "h.yml"), "--form", "opencv",
                 "--size", "320x240"]) == 0  # fmt: skip
    same(read_calibration(tmp_path / "h.yml"), half, 1e-9)


def cases_of_one() -> dict[str, Callable[[], str]]:
    return {
        "agisoft.xml": lambda: "<calibration><projection>frame</projection><f>399</f></calibration>",
        "matlab.json": lambda: '{"CameraParameters1": {"K": [[1, 0, 0], [0, 1, 0], [0, 0, 1]]}}',
        "words.txt": lambda: "left camera: good\nright camera: better\n",
        "bomb.xml": lambda: '<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage><M1>&b;</M1></opencv_storage>',
        "list.json": lambda: "[1, 2, 3]",
        "numbers.json": lambda: '{"M1": {"data": ["x"]}, "D1": [], "M2": [], "D2": [], "R": [], "T": []}',
        "empty.yaml": lambda: "",
        "deep.json": lambda: "[" * 100_000,
    }


@pytest.mark.parametrize("name", sorted(cases_of_one()))
def test_refusals_say_what_the_file_was_taken_for(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_text(cases_of_one()[name]())
    with pytest.raises(CalibrationError) as error:
        read_calibration(tmp_path / name, SIZE)
    told = str(error.value)
    assert name in told
    assert "expected" in told or "taken for" in told
    assert "\n" not in told
    assert len(told) < 900


@pytest.mark.parametrize("seed", range(3))
def test_mutants_are_read_or_refused(tmp_path: Path, seed: int) -> None:
    """Every form with bytes changed, cut or doubled: a rig or one line, nothing else."""
    dice = np.random.default_rng(seed)
    files = {}
    kinds = "ros.yaml", "opencv.yml", "opencv.xml", "kalibr.yml", "viame.json", "viame.npz", "colmap.json"
    for form, suffix in ((kind.partition(".")[0], Path(kind).suffix) for kind in kinds):
        write_calibration(rig(), tmp_path / f"x{suffix}", form)
        files[form + suffix] = (suffix, (tmp_path / f"x{suffix}").read_bytes())
    savemat(tmp_path / "x.mat", matlab_struct(True))
    files |= {"mat": (".mat", (tmp_path / "x.mat").read_bytes()), "ost": (".txt", ost(rig()).encode()),
              "echo": (".yaml", (echo(rig().left, "l") + echo(rig().right, "r")).encode()),
              "zed": (".conf", zed_conf(("VGA",)).encode())}  # fmt: skip
    refused: list[str] = []
    for suffix, content in files.values():
        for _ in range(15):
            data = bytearray(content)
            for place in dice.integers(0, len(data), dice.integers(1, 6)):
                data[place] = dice.integers(256)
            file = tmp_path / f"mutant{suffix}"
            file.write_bytes(bytes(data[: dice.integers(1, len(data))] if dice.random() < 0.4 else data))
            try:
                read_calibration(file, SIZE)
            except CalibrationError as error:
                refused.append(str(error))
    assert len(refused) > 40
    assert not any("\n" in text for text in refused)
    assert len(FORMS) >= 13
