"""From pictures in air and in water to depths behind the ports, by the command and its files."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from helpers.calibration_scenes import rig_of, sightings

from uw_recon_ros import calibrate_files
from uw_recon_ros.board_kinds import CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.ports import PortGlass
from uw_recon_ros.calibrate_files import PortsAsked, Seen, air_rig, calibrate_frames, write_result
from uw_recon_ros.cli import main
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.simulate.boards import hold_boards
from uw_recon_ros.simulate.ports import FlatPane, pixels_of

AIR, WATER = Board(CHECKERBOARD, 9, 6, 0.04), Board(CHECKERBOARD, 5, 4, 0.07)
PANE = FlatPane(0.03, 0.006, 1.49, 1.342)
NO_PICTURES = [Seen(f"{k:02}", *np.zeros((2, 480, 640), np.uint8)) for k in range(14)]


def in_water() -> list[SeenPair]:
    rig, rng, pairs = rig_of(1), np.random.default_rng(3), []
    for k, pose in enumerate(hold_boards(rig, Board(CHECKERBOARD, 5, 4, 0.11), 8, 1, distances_m=(0.9, 1.6))):
        both = pixels_of(rig, WATER.points() @ pose.rotation.T + pose.position, (PANE, PANE))
        seen = (Sighting(np.arange(20), px + 0.1 * rng.standard_normal(px.shape), 1.5, 40.0) for px in both)
        pairs.append(SeenPair(f"{k:02}", *seen))
    return pairs


def seen_as(pairs: list[SeenPair], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(calibrate_files, "see_boards", lambda frames, board: (pairs, [], (640, 480)))


def test_from_air_and_water_to_metres(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen_as(sightings(rig_of(1), 20, 1, noise_px=0.1), monkeypatch)
    write_result(calibrate_frames(NO_PICTURES, AIR, medium="air"), tmp_path / "air")
    asked = PortsAsked(air_rig(tmp_path / "air" / "calibration.json"), PortGlass(0.006, 1.49, 1.342))
    seen_as(in_water(), monkeypatch)
    told = write_result(calibrate_frames(NO_PICTURES, WATER, medium="water", ports=asked), tmp_path / "ports")
    assert told["medium"] == "air"
    assert told["ports"]["distance_m"] == pytest.approx(0.03, abs=4 * told["sigmas"]["port_distance"])
    assert "from the lens to the pane" in (tmp_path / "ports" / "index.html").read_text()

    found = read_calibration(tmp_path / "ports" / "calibration.json")
    made = rectification_from_calibration(found, RectifyParams())
    assert made.geometry.metric
    points = np.array([[-0.2, 0.1, 1.0], [0.2, -0.15, 1.0], [0.1, 0.0, 1.0]])
    left, right = pixels_of(rig_of(1), points, (PANE, PANE))
    rectified = made.left.rectified(left), made.right.rectified(right)
    depth = made.geometry.depth_from_disparity(rectified[0][:, 0] - rectified[1][:, 0])
    true = ((points - made.left.port.meeting_point) @ made.left.r.T)[:, 2]
    assert depth / true == pytest.approx(1.0, abs=0.01)
    assert np.abs(rectified[0][:, 1] - rectified[1][:, 1]).max() < 0.3


@pytest.mark.parametrize(
    "changes", [{"medium": "water"}, {"covariance": [[1.0]]}, {"parameters": {}}, {"noise_px": None}]
)
def test_what_is_no_calibration_in_air_is_one_line(
    changes: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen_as(sightings(rig_of(1), 9, 1, noise_px=0.1), monkeypatch)
    told = write_result(calibrate_frames(NO_PICTURES, AIR, medium="air"), tmp_path / "air")
    for changes in ({"medium": "water"}, {"covariance": [[1.0]]}, {"parameters": {}}, {"noise_px": None}):
        (tmp_path / "other.json").write_text(json.dumps(told | changes))
        with pytest.raises(CalibrationError) as caught:
            air_rig(tmp_path / "other.json")
        assert "other.json" in str(caught.value)


def test_wrong_usage(tmp_path: Path) -> None:
    words = ["calibrate", str(tmp_path), "-o", str(tmp_path / "out"), "--air", str(tmp_path / "none.json")]
    assert main(words) == 2
    assert main([*words, "--square-mm", "40", "--water-index", "9"]) == 2
    assert main([*words, "--square-mm", "40"]) == 1
