"""The command line, as a user calls it: files in, files and exit code out."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh

from uw_recon_ros.cli import main
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.calibrations import write_calibration
from uw_recon_ros.files.disparities import read_disparity, write_pfm
from uw_recon_ros.files.images import read_image, write_image
from uw_recon_ros.simulate import Dive, SimulatedFrame, SimulateParams

DIVE = SimulateParams(width=256, height=192, frames=1, water="I", noise=0.2, snow_per_m3=0.0, distance_m=1.0)


@pytest.fixture(scope="session")
def dive() -> Dive:
    return Dive(DIVE)


@pytest.fixture(scope="session")
def frame(dive: Dive) -> SimulatedFrame:
    return dive.frame(0)


@pytest.fixture
def files(tmp_path: Path, dive: Dive, frame: SimulatedFrame) -> list[str]:
    write_image(tmp_path / "left.png", frame.left)
    write_image(tmp_path / "right.png", frame.right)
    write_calibration(dive.calibration, tmp_path / "rig.yaml")
    (tmp_path / "fast.yaml").write_text("/**:\n  ros__parameters: {kz2_sweeps: 1}\n")
    return [str(tmp_path / "left.png"), str(tmp_path / "right.png"), "--params", str(tmp_path / "fast.yaml")]


def test_calibrated_pair_becomes_metric_files(tmp_path: Path, files: list[str], frame: SimulatedFrame) -> None:
    out = tmp_path / "out"
    assert main(["pair", *files, "-o", str(out), "--calibration", str(tmp_path / "rig.yaml")]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["scale"] == "metric"
    assert report["rectification"]["refused"] is None
    assert report["rectification"]["row_error_median_px"] < 0.5
    assert set(report["stages_seconds"]) == {"preprocess", "rectify", "match", "depth", "cloud", "surface"}
    depth = cv2.imread(str(out / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    assert depth.dtype == np.float32
    assert np.nanmedian(depth) == pytest.approx(np.nanmedian(frame.depth), rel=0.1)
    assert read_disparity(out / "disparity.pfm").shape == depth.shape == read_image(out / "left_rect.png").shape[:2]
    assert len(trimesh.load(out / "cloud.ply").vertices) > 0.3 * depth.size
    assert len(next(iter(trimesh.load(out / "mesh.glb").geometry.values())).faces) > 100
    assert "<html" in (out / "index.html").read_text()
    written = {p.name for p in out.iterdir()}
    assert written >= {"left_enhanced.png", "right_enhanced.png", "right_rect.png", "disparity.png"}
    assert not any(name.endswith(".part") for name in written)


def test_a_folder_with_files_is_not_overwritten_unasked(
    tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "mine.txt").write_text("precious")
    assert main(["pair", *files, "-o", str(tmp_path / "out")]) == 1
    assert "expected an empty or new folder" in capsys.readouterr().err
    assert os.listdir(tmp_path / "out") == ["mine.txt"]


def test_what_cannot_be_rectified_leaves_a_report_with_the_reason(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for side in ("left", "right"):
        write_image(tmp_path / f"{side}.png", np.full((120, 160, 3), 90 if side == "left" else 91, np.uint8))
    out = tmp_path / "out"
    assert main(["pair", str(tmp_path / "left.png"), str(tmp_path / "right.png"), "-o", str(out)]) == 1
    error = capsys.readouterr().err.strip().splitlines()[-1]
    report = json.loads((out / "report.json").read_text())
    assert report["rectification"]["refused"] in error
    names = {"method", "energy", "seconds", "density", "min_disparity", "max_disparity", "residual_row_px"}
    assert set(report["matching"]) == names
    assert (out / "left_enhanced.png").exists()


def test_rectified_pair_to_disparity_with_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left = np.random.default_rng(0).integers(0, 255, (40, 60, 3)).astype(np.uint8)
    write_image(tmp_path / "l.png", left)
    write_image(tmp_path / "r.png", np.roll(left, -4, axis=1))
    arguments = ["disparity", str(tmp_path / "l.png"), str(tmp_path / "r.png"), "-o", str(tmp_path / "d.pfm")]
    assert main([*arguments, "--max-disparity", "8", "--method", "kz2"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    expected = {"method", "effort", "energy", "seconds", "density", "min_disparity", "max_disparity", "residual_row_px"}
    assert set(numbers) == expected | {"warnings"}
    assert (numbers["min_disparity"], numbers["max_disparity"]) == (0, 8)
    disparity = read_disparity(tmp_path / "d.pfm")
    assert np.nanmedian(disparity) == 4
    assert numbers["density"] == pytest.approx(np.isfinite(disparity).mean())


def test_evaluate_prints_a_table_and_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    truth = np.arange(12, dtype=np.float32).reshape(3, 4)
    write_pfm(tmp_path / "t.pfm", truth)
    write_pfm(tmp_path / "e.pfm", truth + np.float32(0.75))
    mask = np.full((3, 4), 255, np.uint8)
    write_image(tmp_path / "m.png", mask)
    assert main(["evaluate", str(tmp_path / "e.pfm"), str(tmp_path / "t.pfm"), "--mask", str(tmp_path / "m.png")]) == 0
    printed = capsys.readouterr()
    assert json.loads(printed.out)["filled"]["bad_percent"] == {"bad-0.5": 100, "bad-1": 0, "bad-2": 0, "bad-4": 0}
    assert "bad-0.5" in printed.err


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ("{kz2_sweeps: 0}", "kz2_sweeps: expected an int in"),
        ("{kz2_sweep: 1}", "kz2_sweep"),
        ("{min_disparity: 9, max_disparity: 3}", "max_disparity"),
    ],
)
def test_wrong_parameters_are_wrong_usage(
    tmp_path: Path, files: list[str], values: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "fast.yaml").write_text(f"/**:\n  ros__parameters: {values}\n")
    assert main(["pair", *files, "-o", str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    "arguments",
    [
        ["pair", "gone.png", "gone.png", "-o", "out"],
        ["disparity", "gone.png", "gone.png", "-o", "d.pfm"],
        ["info", "gone"],
        ["evaluate", "gone.pfm", "gone.pfm"],
        ["pack", "--left", "gone/*.png", "--right", "gone/*.png", "-o", "bag"],
    ],
)
def test_missing_files_fail_with_one_line(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 1
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1
    assert "gone" in lines[0]


def test_wrong_arguments_exit_with_2() -> None:
    for arguments in (["pair"], ["nonsense"], ["disparity", "a", "b", "-o", "c", "--method", "x"]):
        with pytest.raises(SystemExit) as ended:
            main(arguments)
        assert ended.value.code == 2


def test_without_arguments_says_what_can_be_done(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    said = capsys.readouterr().err
    assert all(name in said for name in ("pair", "survey", "info", "doctor"))


def test_simulate_pack_and_info(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = str(tmp_path / "sea")
    small = ["--frames", "2", "--width", "64", "--height", "48"]
    assert main(["simulate", "-o", bag, *small]) == 0
    assert main(["info", bag]) == 0
    assert "/left/image_raw" in capsys.readouterr().out
    assert main(["simulate", "-o", bag, *small]) == 1
    assert "sea" in capsys.readouterr().err


@pytest.mark.parametrize("damage", ["black", "noise"])
def test_half_a_camera_is_told_by_name_on_every_door(
    tmp_path: Path, files: list[str], frame: SimulatedFrame, damage: str, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = frame.right.copy()
    part = broken[96:]
    part[:] = 0 if damage == "black" else np.random.default_rng(0).integers(0, 256, part.shape)
    write_image(tmp_path / "right.png", broken)
    out = tmp_path / "out"
    assert main(["pair", *files, "-o", str(out), "--calibration", str(tmp_path / "rig.yaml")]) == 0
    words = "right camera: 5"
    [warning] = json.loads((out / "report.json").read_text())["warnings"]
    assert warning["text"].startswith(words)
    assert f"warning: {words}" in capsys.readouterr().err
    assert words in (out / "index.html").read_text()
    valid = np.isfinite(read_disparity(out / "disparity.pfm"))
    half = len(valid) // 2
    assert valid[: half - 16].mean() > 0.4
    assert valid[half + 16 :].mean() == 0
    assert (
        main(["disparity", *files, "-o", str(tmp_path / "d.pfm"), "--min-disparity", "0", "--max-disparity", "60"]) == 0
    )
    printed = capsys.readouterr()
    assert json.loads(printed.out)["warnings"][0]["text"].startswith(words)
    assert f"warning: {words}" in printed.err
    assert not np.isfinite(read_disparity(tmp_path / "d.pfm"))[110:].any()


def test_a_camera_that_shows_nothing_is_refused_in_one_line(
    tmp_path: Path, files: list[str], frame: SimulatedFrame, capsys: pytest.CaptureFixture[str]
) -> None:
    write_image(tmp_path / "right.png", np.zeros_like(frame.right))
    out = tmp_path / "out"
    assert main(["pair", *files, "-o", str(out), "--calibration", str(tmp_path / "rig.yaml")]) == 1
    assert "right image: expected a scene on at least 2% of its pixels, got 0.0%" in capsys.readouterr().err
    assert json.loads((out / "report.json").read_text())["failed"]["text"].startswith("right image")


@pytest.mark.parametrize("vertical", [False, True])
def test_others_can_project_back_from_the_report(tmp_path: Path, vertical: bool) -> None:
    """Plain numpy, from ``report.json`` and the files alone."""
    dive = Dive(replace(DIVE, axis="vertical" if vertical else "horizontal"))
    frame = dive.frame(0)
    write_image(tmp_path / "l.png", frame.left)
    write_image(tmp_path / "r.png", frame.right)
    write_calibration(dive.calibration, tmp_path / "rig.yaml")
    out = tmp_path / "out"
    names = [str(tmp_path / "l.png"), str(tmp_path / "r.png")]
    assert main(["pair", *names, "-o", str(out), "--calibration", str(tmp_path / "rig.yaml")]) == 0
    report = json.loads((out / "report.json").read_text())
    assert report["reliable"] is True
    assert report["failed"] is None
    g = report["geometry"]
    assert g["axis"] == ("vertical" if vertical else "horizontal")
    depth = cv2.imread(str(out / "depth.tiff"), cv2.IMREAD_UNCHANGED).astype(float)
    disparity = cv2.imread(str(out / "disparity.pfm"), cv2.IMREAD_UNCHANGED).astype(float)
    raw = g["focal_px"] * g["baseline_m"] / (disparity + g["cx_right"] - g["cx_left"])
    both = np.isfinite(raw) & np.isfinite(depth) & np.isfinite(disparity)
    assert np.median(np.abs(raw[both] / depth[both] - 1)) < 0.01  # the depth is smoothed within its sigma
    v, u = np.nonzero(np.isfinite(depth))
    z = depth[v, u]
    along, across = (v, u) if vertical else (u, v)
    x = (along - g["cx_left"]) / g["focal_px"] * z
    y = (across - g["cy"]) / g["focal_across_px"] * z
    points = np.column_stack([y, x, z] if vertical else [x, y, z]) @ np.array(g["rect_from_raw_left"])
    np.testing.assert_allclose(points, trimesh.load(out / "cloud.ply").vertices, atol=1e-4)


def test_rows_that_disagree_are_told_and_metres_withheld(
    tmp_path: Path, files: list[str], frame: SimulatedFrame, capsys: pytest.CaptureFixture[str]
) -> None:
    write_image(tmp_path / "right.png", np.roll(frame.right, 2, axis=0))
    out = tmp_path / "out"
    assert main(["pair", *files, "-o", str(out), "--calibration", str(tmp_path / "rig.yaml")]) == 0
    report = json.loads((out / "report.json").read_text())
    assert (report["reliable"], report["scale"]) == (False, "unknown")
    assert {"rectify.rows_disagree", "rectify.scale_withheld"} <= {w["code"] for w in report["warnings"]}
    assert not (out / "depth.tiff").exists()
    assert "UNRELIABLE: vertical (epipolar) error" in capsys.readouterr().err
    assert 'class="alarm"' in (out / "index.html").read_text()


def test_a_failing_preprocess_leaves_a_report(
    tmp_path: Path, files: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise ImageError("too large")

    monkeypatch.setattr("uw_recon_ros.pipeline.PreprocessSequence.__call__", refuse)
    assert main(["pair", *files, "-o", str(tmp_path / "out")]) == 1
    report = json.loads((tmp_path / "out" / "report.json").read_text())
    assert report["failed"] == {"stage": "preprocess", "code": "image", "text": "too large"}
    assert report["rectification"]["refused"] is None


def textured_pair(folder: Path, dtype: type = np.uint8) -> list[str]:
    left = np.random.default_rng(0).integers(0, 255 if dtype == np.uint8 else 4095, (60, 90)).astype(dtype)
    write_image(folder / "l.png", left)
    write_image(folder / "r.png", np.roll(left, -4, axis=1))
    return ["disparity", str(folder / "l.png"), str(folder / "r.png"), "--max-disparity", "8", "--method", "kz2"]


@pytest.mark.parametrize("name", ["d.pfm", "d.tiff", "d.png"])
def test_disparity_is_written_as_its_name_says(tmp_path: Path, name: str) -> None:
    arguments = [*textured_pair(tmp_path, np.uint16), "-o", str(tmp_path / name)]
    assert main(arguments) == 0
    read = cv2.imread(str(tmp_path / name), cv2.IMREAD_UNCHANGED)
    assert read.dtype == (np.uint16 if name == "d.png" else np.float32)
    values = read / 256 if name == "d.png" else read
    assert np.median(values[np.isfinite(values) & (values != 0)]) == 4


def test_disparity_refuses_before_it_works(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = textured_pair(tmp_path)
    (tmp_path / "mine.pfm").write_text("precious")
    for output, words in (("mine.pfm", "--overwrite replaces it"), ("d.jpg", "expected a name that ends in .pfm"),
                          ("nowhere/d.pfm", "expected a folder that can be written to"), (".", "ends in")):  # fmt: skip
        assert main([*arguments, "-o", str(tmp_path / output)]) == 1
        assert words in capsys.readouterr().err
    assert (tmp_path / "mine.pfm").read_text() == "precious"
    assert main([*arguments, "-o", str(tmp_path / "mine.pfm"), "--overwrite"]) == 0


def test_identical_and_exchanged_images_are_noticed(
    tmp_path: Path, files: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    left, right = files[:2]
    output = ["-o", str(tmp_path / "d.pfm")]
    assert main(["disparity", left, left, *output]) == 1
    assert main(["pair", left, left, "-o", str(tmp_path / "out")]) == 1
    assert capsys.readouterr().err.count("the same twice") == 2
    assert main(["disparity", right, left, *output]) == 1
    assert "left and right images are swapped" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("left", "right", "told"),
    [
        (lambda f: f.left, lambda f: f.right, None),
        (lambda f: f.left, lambda f: f.left, "the same twice"),
        (lambda f: f.right, lambda f: f.left, "swapped"),
        (lambda f: f.left, lambda f: f.right[::-1, ::-1], "upside down"),
    ],
    ids=["right", "one camera", "exchanged", "upside down"],
)
def test_info_looks_at_a_pair(
    tmp_path: Path, dive: Dive, frame: SimulatedFrame, capsys: pytest.CaptureFixture[str], left: Any, right: Any,
    told: str | None,
) -> None:  # fmt: skip
    for side, image in (("left", left(frame)), ("right", right(frame))):
        (tmp_path / "dive" / side).mkdir(parents=True)
        for number in range(2):
            write_image(tmp_path / "dive" / side / f"{number}.png", image)
    write_calibration(dive.calibration, tmp_path / "rig.yaml")
    assert main(["info", str(tmp_path / "dive"), "--calibration", str(tmp_path / "rig.yaml")]) == (1 if told else 0)
    assert (told or "can be reconstructed") in capsys.readouterr().out
