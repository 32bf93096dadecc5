"""Two images judged as a pair, alike on every door."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from uw_recon_ros.cli import main
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.images import write_image
from uw_recon_ros.findings import Code
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.images import to_gray
from uw_recon_ros.recordings.pack import pack

RNG = np.random.default_rng(5)
COLOUR = RNG.integers(0, 256, (60, 80, 3), np.uint8)
MONO = np.ascontiguousarray(np.roll(to_gray(COLOUR), -4, axis=1))


def test_colour_beside_mono_becomes_gray_and_is_told() -> None:
    for given in ((COLOUR, MONO), (MONO, COLOUR)):
        left, right, findings = as_pair(*given)
        assert left.shape == right.shape == MONO.shape
        assert [finding.code for finding in findings] == [Code.IMAGE_KINDS_DIFFER]
        kinds = ["colour" if image.ndim == 3 else "mono" for image in given]
        assert f"left is {kinds[0]}, right is {kinds[1]}" in findings[0].text


def test_images_of_one_kind_stay_as_they_are() -> None:
    left, right, findings = as_pair(COLOUR, COLOUR[::-1])
    assert left is COLOUR
    assert right.ndim == 3
    assert not findings


@pytest.mark.parametrize(
    ("left", "right", "code", "told"),
    [
        (COLOUR, COLOUR[:, :79], Code.IMAGE_SIZES_DIFFER, "left 80x60 px colour 8 bits and right 79x60 px"),
        (MONO, COLOUR.astype(np.uint16), Code.IMAGE_DEPTHS_DIFFER, "mono 8 bits and right 80x60 px colour 16 bits"),
        (COLOUR, COLOUR.copy(), Code.IMAGE_IDENTICAL, "the same twice"),
        (COLOUR, to_gray(COLOUR), Code.IMAGE_IDENTICAL, "the same twice"),
    ],
    ids=["size", "depth", "identical", "identical but for colour"],
)
def test_what_is_no_pair(left: Any, right: Any, code: Code, told: str) -> None:
    with pytest.raises(ImageError, match=told) as caught:
        as_pair(left, right)
    assert caught.value.code == code


def test_two_black_images_are_not_called_one_camera() -> None:
    """What they lack is a scene; the search for regions says so."""
    black = np.zeros((60, 80), np.uint8)
    assert as_pair(black, black.copy())[2] == ()


def stills(folder: Path, left: Any, right: Any, count: int = 2) -> None:
    for number in range(count):
        for side, image in (("left", left), ("right", right)):
            (folder / side).mkdir(parents=True, exist_ok=True)
            write_image(folder / side / f"{number}.png", np.roll(image, 3 * number, axis=0))


def rows(output: Path) -> list[dict[str, str]]:
    import csv

    with (output / "frames.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.mark.parametrize("as_bag", [False, True], ids=["stills", "bag"])
def test_a_survey_fails_identical_frames_by_name(tmp_path: Path, as_bag: bool, rig_file: Path) -> None:
    stills(tmp_path / "in", MONO, MONO)
    source = tmp_path / "in"
    if as_bag:
        source = tmp_path / "bag"
        pack(str(tmp_path / "in/left/*.png"), str(tmp_path / "in/right/*.png"), source)
    arguments = ["survey", str(source), "-o", str(tmp_path / "out"), "--jobs", "1", "--calibration", str(rig_file)]
    assert main(arguments) == 1
    assert [row["status"] for row in rows(tmp_path / "out")] == ["failed"] * 2
    assert all("the same twice" in row["reason"] for row in rows(tmp_path / "out"))


def test_disparity_tells_of_colour_beside_mono(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_image(tmp_path / "left.png", COLOUR)
    write_image(tmp_path / "right.png", MONO)
    files = [str(tmp_path / name) for name in ("left.png", "right.png")]
    navigation = ["--effort", "navigation", "--max-disparity", "12", "--min-disparity", "0"]
    assert main(["disparity", *files, "-o", str(tmp_path / "d.pfm"), *navigation]) == 0
    told = json.loads(capsys.readouterr().out)["warnings"]
    assert "image.kinds_differ" in [warning["code"] for warning in told]


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "rig.yaml"
    documents = []
    for tx in (0.0, -10.0):
        documents.append(
            "image_width: 80\nimage_height: 60\ncamera_name: x\ndistortion_model: plumb_bob\n"
            "camera_matrix: {rows: 3, cols: 3, data: [100, 0, 39.5, 0, 100, 29.5, 0, 0, 1]}\n"
            "distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}\n"
            "rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}\n"
            f"projection_matrix: {{rows: 3, cols: 4, data: [100, 0, 39.5, {tx}, 0, 100, 29.5, 0, 0, 0, 1, 0]}}\n"
        )
    path.write_text("---\n".join(documents))
    return path
