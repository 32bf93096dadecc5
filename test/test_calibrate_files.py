"""`uw_recon calibrate` from stills and bags of a simulated session."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, of_two_moments, rig_of, small_session, smeared, truth_of, write_stills

from uw_recon_ros.calibrate.optics import NAMES
from uw_recon_ros.cli import main
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.files.images import read_image, write_image
from uw_recon_ros.recordings.pack import pack

COUNT = 8
pytestmark = pytest.mark.slow  # pictures are taken and searched for boards


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Good pairs 1 to 8; 9 smeared, 10 as 3, 11 of two moments, 12 empty, 13 smaller."""
    folder = tmp_path_factory.mktemp("session")
    rig, shots = small_session(COUNT, 2)
    blank = np.full_like(shots[0].left, 90)
    empty = type(shots[0])(shots[0].pose, blank, blank + 1)
    small = type(shots[0])(shots[0].pose, shots[0].left[:400], shots[0].right[:400])
    shots += [smeared(rig, BOARD, 7, 9), shots[2], of_two_moments(shots[4], shots[5]), empty, small]
    write_stills(folder, shots)
    write_image(folder / "left" / "14.png", shots[0].left)  # no partner
    return folder


@pytest.fixture(scope="module")
def calibrated(session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("out") / "calibration"
    assert main(["calibrate", str(session), "-o", str(out), "--square-mm", "40", "--medium", "water"]) == 0
    return out


def test_the_rig_comes_out(calibrated: Path) -> None:
    report = json.loads((calibrated / "calibration.json").read_text())
    rig = rig_of(1)
    assert report["board"]["columns"] * report["board"]["rows"] == 54  # found in the pictures
    true = dict(zip(NAMES, truth_of(rig), strict=True))
    assert report["parameters"]["left_fx"] == pytest.approx(true["left_fx"], rel=2e-3)
    assert report["baseline_m"] == pytest.approx(np.linalg.norm(rig.right_center), rel=3e-3)
    assert report["rms_px"] < 0.1
    assert np.array(report["covariance"]).shape == (24, 24)
    assert report["held_out"]["rms_px"] < 0.15
    assert report["reliable"]
    both = read_calibration(calibrated / "calibration.yaml")
    assert -both.right.p[0, 3] / both.right.p[0, 0] == pytest.approx(report["baseline_m"])
    assert "image_width: 640" in (calibrated / "left.yaml").read_text()


def test_every_pair_left_out_is_named_with_its_reason(calibrated: Path) -> None:
    report = json.loads((calibrated / "calibration.json").read_text())
    out = {entry["name"]: entry["code"] for entry in report["left_out"]}
    assert out == {
        "09.png": "calibrate.blurred", "10.png": "calibrate.duplicate", "11.png": "calibrate.unsynchronised",
        "12.png": "calibrate.not_seen", "13.png": "calibrate.size_differs",
    }  # fmt: skip
    assert any("14.png" in note for note in report["notes"])
    assert len(report["pairs"]) == COUNT


def test_the_page_needs_no_network(calibrated: Path) -> None:
    page = (calibrated / "index.html").read_text()
    assert "Depth error" in page
    assert "09.png" in page
    assert "http" not in page.replace("http-equiv", "")


def test_a_bag_gives_the_same(session: Path, tmp_path: Path) -> None:
    good = tmp_path / "good"
    for side in ("left", "right"):
        (good / side).mkdir(parents=True)
        for k in range(1, 6):
            shutil.copy(session / side / f"{k:02}.png", good / side)
    pack(str(good / "left"), str(good / "right"), tmp_path / "bag")
    reports = []
    for name in ("good", "bag"):
        words = ["calibrate", str(tmp_path / name), "-o", str(tmp_path / f"{name}_out"), "--size", "9x6"]
        assert main([*words, "--square-mm", "40"]) == 0
        reports.append(json.loads((tmp_path / f"{name}_out" / "calibration.json").read_text()))
    assert reports[0]["parameters"] == reports[1]["parameters"]
    assert any(w["code"] == "calibrate.medium" for w in reports[1]["warnings"])


def _few(session: Path, folder: Path, count: int = 5) -> Path:
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
        for k in range(1, count + 1):
            shutil.copy(session / side / f"{k:02}.png", folder / side)
    return folder


def test_without_squares_nothing_is_in_metres(session: Path, tmp_path: Path) -> None:
    assert main(["calibrate", str(_few(session, tmp_path / "in")), "-o", str(tmp_path / "out"), "--size", "9x6"]) == 0
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert report["baseline_m"] is None
    assert report["depth_errors"] == []
    assert not read_calibration(tmp_path / "out" / "calibration.yaml").right.p[:, 3].any()


def test_swapped_cameras_are_one_clear_line(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = _few(session, tmp_path / "in")
    (folder / "left").rename(folder / "x")
    (folder / "right").rename(folder / "left")
    (folder / "x").rename(folder / "right")
    assert main(["calibrate", str(folder), "-o", str(tmp_path / "out"), "--size", "9x6", "--square-mm", "40"]) == 1
    assert "exchanged" in capsys.readouterr().err.splitlines()[-1]
    assert not (tmp_path / "out" / "calibration.yaml").exists()


def test_another_board_is_one_clear_line(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = _few(session, tmp_path / "in", 1)
    assert main(["calibrate", str(folder), "-o", str(tmp_path / "out"), "--size", "8x5", "--square-mm", "40"]) == 1
    line = capsys.readouterr().err.splitlines()[-1]
    assert "8x5" in line
    assert "9x6" in line or "6x9" in line


def test_squares_in_the_wrong_unit_are_refused(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = _few(session, tmp_path / "in")
    assert main(["calibrate", str(folder), "-o", str(tmp_path / "out"), "--size", "9x6", "--square-mm", "0.04"]) == 1
    assert "--square-mm" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["--size", "nine"], ["--most-pairs", "1"], ["--square-mm", "-3"]])
def test_wrong_usage(words: list[str], tmp_path: Path) -> None:
    assert main(["calibrate", str(tmp_path), "-o", str(tmp_path / "out"), *words]) == 2


def test_a_folder_with_results_is_not_overwritten(calibrated: Path, session: Path) -> None:
    before = read_image(session / "left" / "01.png")
    assert main(["calibrate", str(session), "-o", str(calibrated), "--size", "9x6"]) == 1
    assert np.array_equal(before, read_image(session / "left" / "01.png"))


def test_cameras_of_two_sizes_are_one_clear_line(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = _few(session, tmp_path / "in", 4)
    for path in (folder / "right").iterdir():
        write_image(path, read_image(path)[::2, ::2])
    assert main(["calibrate", str(folder), "-o", str(tmp_path / "out"), "--size", "9x6", "--square-mm", "40"]) == 1
    line = capsys.readouterr().err.splitlines()[-1]
    assert "4 pairs could not be read" in line
    assert "320" in line


def test_a_shorter_folder_is_told(session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = _few(session, tmp_path / "in")
    (folder / "right" / "05.png").unlink()
    assert main(["calibrate", str(folder), "-o", str(tmp_path / "out"), "--size", "9x6", "--square-mm", "40"]) == 0
    assert "05.png" in capsys.readouterr().err
