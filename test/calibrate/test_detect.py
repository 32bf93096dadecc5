"""Boards in simulated pictures: found where they are."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, rig_of, small_session

from uw_recon_ros.board_kinds import KINDS
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.detect import edge_width, find_board, find_checkerboard_size
from uw_recon_ros.calibrate.markers import find_dictionary
from uw_recon_ros.calibrate.pair_selection import mirrored
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.simulate.boards import hold_boards, photograph, seen_points

BOARDS = {
    "checkerboard": BOARD,
    "charuco": Board("charuco", 8, 6, 0.05, dictionary="DICT_5X5_250"),
    "aprilgrid": Board("aprilgrid", 6, 5, 0.065),
    "circles": Board("circles", 8, 6, 0.04),
    "asymmetric-circles": Board("asymmetric-circles", 4, 9, 0.025),
}


ARUCO = getattr(cv2, "aruco", None)
needs_markers = pytest.mark.skipif(ARUCO is None, reason="this OpenCV has no aruco (headless before 4.7)")
WITH_MARKERS = ("charuco", "aprilgrid")


@pytest.mark.parametrize("kind", [pytest.param(k, marks=needs_markers) if k in WITH_MARKERS else k for k in KINDS])
def test_points_are_found_to_a_tenth_of_a_pixel(kind: str) -> None:
    board, rig = BOARDS[kind], rig_of(1)
    poses = hold_boards(rig, board, 2, 3, tilt_rad=0.25, distances_m=(0.6, 1.0))
    for shot in photograph(rig, board, poses, 3):
        for picture, true in zip((shot.left, shot.right), seen_points(rig, board, shot.pose), strict=True):
            found = find_board(picture, board)
            assert found is not None
            assert len(found.numbers) >= 0.6 * len(true)
            order = min((true, true[::-1]), key=lambda t: float(np.abs(found.pixels - t[found.numbers]).max()))
            assert np.sqrt(np.mean((found.pixels - order[found.numbers]) ** 2)) < 0.1
            assert 1.0 < found.edge_px < 4.0


def test_a_board_in_haze_is_found() -> None:
    rig, (shot,) = small_session(1)
    rng = np.random.default_rng(1)
    hazy = np.clip(
        np.rint(120 + 0.06 * (shot.left.astype(float) - 100) + 0.5 * rng.standard_normal(shot.left.shape)), 0, 255
    )
    found = find_board(hazy.astype(np.uint8), BOARD)
    assert found is not None
    true, _ = seen_points(rig, BOARD, shot.pose)
    assert min(np.abs(found.pixels - t).max() for t in (true, true[::-1])) < 1.0


def test_no_board_is_none() -> None:
    noise = np.random.default_rng(1).integers(0, 255, (240, 320), dtype=np.uint8)
    boards = [board for kind, board in BOARDS.items() if ARUCO is not None or kind not in WITH_MARKERS]
    assert all(find_board(noise, board) is None for board in boards)


@pytest.mark.skipif(ARUCO is not None, reason="this OpenCV has aruco")
@pytest.mark.parametrize("kind", WITH_MARKERS)
def test_without_aruco_a_board_with_markers_is_refused(kind: str) -> None:
    with pytest.raises(CalibrationError, match="without aruco: use a checkerboard"):
        find_board(np.zeros((240, 320), np.uint8), BOARDS[kind])


def test_edges_widen_with_blur() -> None:
    _, (shot,) = small_session(1)
    found = find_board(shot.left, BOARD)
    assert found is not None
    blurred = cv2.GaussianBlur(shot.left, (0, 0), 3.0)
    assert edge_width(blurred, found.pixels, found.spacing_px) > 1.5 * found.edge_px


def test_a_checkerboards_size_is_found() -> None:
    _, (shot,) = small_session(1)
    assert find_checkerboard_size(shot.left) in {(9, 6), (6, 9)}


@needs_markers
def test_a_dictionary_is_found() -> None:
    _, (shot,) = small_session(1, board=BOARDS["charuco"])
    assert find_dictionary(shot.left) in {"DICT_5X5_50", "DICT_5X5_250"}  # one begins with the other


@needs_markers
def test_a_mirror_image_is_noticed() -> None:
    _, (shot,) = small_session(1, board=BOARDS["charuco"])
    assert mirrored(np.ascontiguousarray(shot.left[:, ::-1]), BOARDS["charuco"])
    assert not mirrored(shot.left, BOARDS["charuco"])


@pytest.mark.skipif(not hasattr(ARUCO, "CharucoDetector"), reason="this OpenCV draws the old layout alone")
@pytest.mark.parametrize("legacy", [False, True])
def test_both_layouts_of_charuco_are_read(legacy: bool) -> None:
    """As OpenCV itself draws them; every inner corner has the number that the board's points have."""
    board = BOARDS["charuco"]
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    made = cv2.aruco.CharucoBoard((8, 6), board.square_m, board.marker_side_m, dictionary)
    if not hasattr(made, "setLegacyPattern"):
        pytest.skip("OpenCV 4.7 has one layout")
    made.setLegacyPattern(legacy)
    drawn = cv2.copyMakeBorder(
        made.generateImage((640, 480), marginSize=0), 40, 40, 40, 40, cv2.BORDER_CONSTANT, value=255
    )
    found = find_board(cv2.GaussianBlur(drawn, (0, 0), 1.0), board)
    assert found is not None
    assert found.numbers.tolist() == list(range(35))
    true = 80 * (board.points()[:, :2] / board.square_m + 1) + 39.5
    assert np.abs(found.pixels - true).max() < 0.5
