"""`uw_recon measure` in a frame that a survey kept."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import uw_recon_ros as uw
from uw_recon_ros.cli import main
from uw_recon_ros.files.calibrations import write_calibration
from uw_recon_ros.files.disparities import read_disparity
from uw_recon_ros.files.images import write_image
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.survey.kept_frame import write_kept
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import StereoGeometry

GEOMETRY = StereoGeometry(600.0, 159.5, 159.5, 119.5, 0.12)


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    """A wall at 1 m."""
    disparity = np.full((240, 320), 72.0, np.float32)
    frame = DisparityFrame(7, np.zeros((240, 320, 3), np.uint8), disparity, np.full_like(disparity, 0.1), GEOMETRY)
    write_kept(tmp_path / "a.frame", frame)
    write_kept(tmp_path / "unscaled.frame", replace(frame, geometry=GEOMETRY.unscaled))
    return tmp_path


def test_a_length_as_json_and_csv(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", str(kept / "a.frame"), "length", "40,120", "280,120"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["value"] == pytest.approx(0.4, rel=1e-3)
    assert row["frame"] == "a.frame"
    assert row["stamp_ns"] == 7
    assert row["pixels"] == [[40.0, 120.0], [280.0, 120.0]]
    assert row["sigma_calibration"] is None
    assert main(["measure", str(kept / "a.frame"), "length", "40,120", "280,120", "-o", str(kept / "x.csv")]) == 0
    assert (kept / "x.csv").read_text().splitlines()[1].startswith("a.frame,7,length,0.4")


def test_metres_from_a_known_length(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["measure", str(kept / "unscaled.frame"), "length", "40,60", "280,60"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)[0]["unit"] == "baselines"
    assert main([*words, "--known-length", "200", "40,120", "160,120", "--known-sigma-mm", "2"]) == 0
    (row,) = json.loads(capsys.readouterr().out)
    assert row["value"] == pytest.approx(0.4, rel=2e-3)
    assert row["unit"] == "m"
    assert row["sigma_calibration"] > 0.01 * 0.4 * 0.99


def test_what_cannot_be_measured_is_one_line(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", str(kept / "a.frame"), "length", "40,120", "900,120"]) == 1
    assert "320x240" in capsys.readouterr().err
    assert main(["measure", str(kept), "length", "40,120", "90,120"]) == 1
    assert main(["measure", str(kept / "a.frame"), "length", "40,120"]) == 2
    assert main(["measure", str(kept / "a.frame"), "length", "a,b", "1,2"]) == 2


def test_a_frame_that_the_survey_does_not_rely_on_is_marked(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (kept / "model_frames").mkdir()
    for name in ("000003", "000004"):
        (kept / "model_frames" / f"{name}.frame").write_bytes((kept / "a.frame").read_bytes())
    (kept / "frames.csv").write_text("frame,status,reason\n3,ok,\n4,unreliable,rows disagree\n")
    for name, reliable in (("000003", True), ("4", False)):
        assert main(["measure", str(kept), "length", "40,120", "280,120", "--frame", name]) == 0
        told = capsys.readouterr()
        assert json.loads(told.out)[0]["reliable"] is reliable
        assert ("rows disagree" in told.err) is not reliable


def test_the_front_door_measures_the_same(kept: Path) -> None:
    (found,) = uw.measure(kept / "a.frame", "length", [(40.0, 120.0), (280.0, 120.0)])
    assert found.value == pytest.approx(0.4, rel=1e-3)
    with pytest.raises(ValueError, match="square_mm"):
        uw.calibrate(kept, kept / "out", square_mm=0.0)


def test_a_calibrated_pair_that_the_command_left(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What the README shows: `pair` with a calibration, then `measure` in its folder."""
    dive = Dive(SimulateParams(width=240, height=180, scene="plane", water="I"))
    frame = dive.frame(0)
    write_image(tmp_path / "left.png", frame.left)
    write_image(tmp_path / "right.png", frame.right)
    write_calibration(dive.calibration, tmp_path / "rig.yaml")
    pair, out = [str(tmp_path / name) for name in ("left.png", "right.png")], str(tmp_path / "out")
    assert main(["pair", *pair, "-o", out, "--calibration", str(tmp_path / "rig.yaml")]) == 0
    said = capsys.readouterr().err.splitlines()[-1]
    assert "(baseline 0.121 m, depths " in said
    near, far = (float(word) for word in said.split("depths ")[1].removesuffix(" m)").split(" to "))
    seen = read_disparity(tmp_path / "out" / "depth.tiff")
    assert [near, far] == pytest.approx(np.nanquantile(seen, [0.05, 0.95]), rel=0.01)
    assert main(["measure", out, "length", "90,90", "150,90"]) == 0
    told = capsys.readouterr()
    (row,) = json.loads(told.out)
    assert row["unit"] == "m"
    assert told.err.rstrip().endswith(" m")
    depth = read_disparity(tmp_path / "out" / "depth.tiff")
    assert row["depth"] == pytest.approx(float(np.nanmedian(depth[88:93, 88:153])), rel=0.05)


def test_the_report_of_another_rig_is_refused(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = [{"range_m": r, "mean_percent": 0.3} for r in (0.5, 1.0, 3.0)]
    words = ["measure", str(kept / "a.frame"), "length", "40,120", "280,120", "--calibration-report"]
    for baseline_m, status in ((0.1205, 0), (0.07, 1)):
        path = kept / f"{baseline_m}.json"
        path.write_text(json.dumps({"baseline_m": baseline_m, "depth_errors": table}))
        assert main([*words, str(path)]) == status
    assert "0.07 m" in capsys.readouterr().err


def test_a_report_without_the_squares_size_says_so(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """As `calibrate` writes it: neither a baseline nor depth errors in metres."""
    path = kept / "calibration.json"
    path.write_text(json.dumps({"baseline_m": None, "depth_errors": []}))
    words = ["measure", str(kept / "a.frame"), "length", "40,120", "280,120", "--calibration-report", str(path)]
    assert main(words) == 1
    assert "was --square-mm given?" in capsys.readouterr().err


def test_a_known_length_that_the_calibration_contradicts(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The wall's 0.2 m told as 0.2 m and as one: the second cannot be, or the calibration is wrong."""
    words = ["measure", str(kept / "a.frame"), "length", "40,60", "280,60", "--known-length"]
    for millimetres, reliable in (("200", True), ("1000", False)):
        assert main([*words, millimetres, "40,120", "160,120"]) == 0
        told = capsys.readouterr()
        assert json.loads(told.out)[0]["reliable"] is reliable
        assert ("one of them is wrong" in told.err) is not reliable


def test_small_mistakes_are_told(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["measure", str(kept / "a.frame"), "area", "40,120", "90,120"]) == 2
    assert "3 points" in capsys.readouterr().err
    assert main(["measure", str(kept / "a.frame"), "length", "40,120", "90,120", "-o", str(kept / "m.txt")]) == 2
    bow = ["40,40", "200,200", "200,40", "40,200"]
    assert main(["measure", str(kept / "a.frame"), "area", *bow]) == 1
    assert "crosses itself" in capsys.readouterr().err
    assert main(["measure", str(kept / "a.frame"), "area", "40,40", "100,100", "200,200"]) == 1
    assert "not in one line" in capsys.readouterr().err
    assert main(["measure", str(kept / "a.frame"), "height", "100,100", "--plane", "40,40", "200,200"]) == 2
    assert "three corners" in capsys.readouterr().err
    assert main(["measure", str(kept / "a.frame"), "length", "40,120", "90,120", "--frame", "000003"]) == 1
    assert "one frame" in capsys.readouterr().err


def test_a_point_left_of_the_image_is_a_point_and_no_option(kept: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for words in (
        ["length", "-5,200", "90,120"],
        ["length", "40,120", "-5.5,-2"],
        ["height", "9,9", "--plane", "-1,2", "9,2", "9,9"],
    ):
        assert main(["measure", str(kept / "a.frame"), *words]) == 1
        assert "expected within the rectified image" in capsys.readouterr().err or words[0] == "height"
