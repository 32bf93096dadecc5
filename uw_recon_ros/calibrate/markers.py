"""Boards that carry markers, which tell their points apart: ChArUco and AprilGrid."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.boards import Board
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import ByteImage, Matrix

#: Dictionaries tried where none is told.
DICTIONARIES = (
    "DICT_4X4_50", "DICT_5X5_50", "DICT_6X6_50", "DICT_4X4_250", "DICT_5X5_250", "DICT_6X6_250", "DICT_4X4_1000",
    "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000", "DICT_ARUCO_ORIGINAL",
)  # fmt: skip
APRILTAGS = "DICT_APRILTAG_36h11"
_REFINE = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_COUNT, 50, 1e-4)
_BESIDE_MARKERS = 0.12  # of a square: markers begin there
_LEAST_MARKERS = 2
_GRID_BORDER = 2  # bits of black round a tag of kalibr's AprilGrid

Found = tuple[NDArray[np.int64], Matrix]


def marker_dictionary(name: str) -> Any:
    """OpenCV's dictionary of that name.

    Raises
    ------
    CalibrationError
        There is none, or this OpenCV reads no markers.
    """
    aruco: Any = getattr(cv2, "aruco", None)
    if aruco is None:
        raise CalibrationError(
            f"boards with markers: expected OpenCV 4.7 or newer, or opencv-contrib, got {cv2.__version__} without "
            "aruco: use a checkerboard",
            Code.CALIBRATE_BOARD,
        )
    number = getattr(aruco, name, None)
    if not isinstance(number, int):
        raise CalibrationError(
            f"dictionary: expected a name such as DICT_5X5_250, got {name[:40]}", Code.CALIBRATE_BOARD
        )
    return aruco.getPredefinedDictionary(number)


def find_charuco(gray: ByteImage, board: Board) -> Found | None:
    """Inner corners between the markers that are seen; both ways of laying the first square are tried.

    Not by OpenCV's own detector: 4.6 has another, 4.7 knows one of both layouts, 4.10 leaves corners half a pixel off.
    """
    corners, numbers = _detect(gray, board.dictionary, 1)
    layouts = [_marker_places(board, first) for first in ((1, 0) if board.rows % 2 == 0 else (1,))]
    known = numbers < min(len(layout) for layout in layouts)
    corners, numbers = corners[known], numbers[known]
    if len(numbers) < _LEAST_MARKERS:
        return None
    errors = [_plane_error(layout[numbers].reshape(-1, 2), corners.reshape(-1, 2)) for layout in layouts]
    found = _between_markers(layouts[int(np.argmin(errors))], corners, numbers, board)
    return None if found is None else (found[0], refined(gray, found[1], _BESIDE_MARKERS))


def _marker_places(board: Board, first: int) -> Matrix:
    """(M, 4, 2) corners of a ChArUco board's markers, squares, from its own corner; `first`: which square of the first
    row has the first one."""
    row, column = np.nonzero((np.add.outer(np.arange(board.rows), np.arange(board.columns)) + first) % 2 == 0)
    side = board.marker_side_m / board.square_m
    corners = (1 - side) / 2 + side * np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
    places: Matrix = np.stack([column, row], axis=1)[:, None] + corners
    return places


def _between_markers(places: Matrix, corners: Matrix, numbers: NDArray[np.int64], board: Board) -> Found | None:
    """Where the two markers beside each inner corner, both seen, put it on the average: a lens bends little between
    them."""
    columns, rows = board.grid
    sums, counts = np.zeros((rows, columns, 2)), np.zeros((rows, columns), np.int64)
    for marker, pixels in zip(places[numbers], corners, strict=True):
        plane = cv2.getPerspectiveTransform(marker.astype(np.float32), pixels.astype(np.float32))
        column, row = np.floor(marker[0]).astype(int)
        for i, j in ((column - 1, row - 1), (column, row - 1), (column - 1, row), (column, row)):
            if 0 <= i < columns and 0 <= j < rows:
                x, y, scale = plane @ np.array([i + 1.0, j + 1.0, 1.0])
                sums[j, i] += x / scale, y / scale
                counts[j, i] += 1
    both = np.flatnonzero(counts.ravel() == 2)
    return (both, sums.reshape(-1, 2)[both] / 2) if len(both) else None


def refined(gray: ByteImage, pixels: Matrix, share: float = 0.25) -> Matrix:
    """Corners where edges cross, from places near them; one that strays stays where it was.

    They are looked for in a window of `share` of the distance between points, to either side.

    Measured on simulated boards: 0.03 px, whatever the detector left: 0.09 px, and OpenCV 4.10's ChArUco half a pixel
    to the right and down.
    """
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    reach = int(np.clip(share * np.median(apart.min(axis=1)), 2, 11)) if len(pixels) > 1 else 2
    start = pixels.astype(np.float32).reshape(-1, 1, 2)
    found = np.asarray(cv2.cornerSubPix(gray, start, (reach, reach), (-1, -1), _REFINE), np.float64).reshape(-1, 2)
    strayed = np.linalg.norm(found - pixels, axis=1) > 0.5 * reach
    return np.where(strayed[:, None], pixels, found)


def find_dictionary(gray: ByteImage) -> str | None:
    """The smallest dictionary in which most markers of a picture are read; None: none is."""
    counts = [(len(_detect(gray, name, 1)[1]), -rank, name) for rank, name in enumerate(DICTIONARIES)]
    count, _, name = max(counts)
    return name if count >= 3 else None


def find_aprilgrid(gray: ByteImage, board: Board) -> Found | None:
    """Corners of the tags that are seen, whichever way their rows and corners are counted.

    Tags of kalibr's grids touch black squares: in a picture of twice the size they come apart.
    """
    twice = cv2.resize(gray, None, fx=2, fy=2, interpolation=cv2.INTER_CUBIC)
    corners, numbers = _detect(np.asarray(twice, np.uint8), board.dictionary or APRILTAGS, _GRID_BORDER)
    corners = (corners - 0.5) / 2
    known = numbers < board.columns * board.rows
    return _arranged(gray, corners[known], numbers[known], board) if known.sum() >= 4 else None


def _detect(gray: ByteImage, dictionary: str, border: int) -> tuple[Matrix, NDArray[np.int64]]:
    """(N, 4, 2) corners and (N,) numbers of markers; not refined: OpenCV 4.6 puts some 5 px away."""
    found = marker_dictionary(dictionary)
    aruco: Any = cv2.aruco
    old = not hasattr(aruco, "ArucoDetector")  # before OpenCV 4.7
    params = aruco.DetectorParameters_create() if old else aruco.DetectorParameters()
    params.markerBorderBits = border
    if old:
        corners, numbers, _ = aruco.detectMarkers(gray, found, parameters=params)
    else:
        corners, numbers, _ = aruco.ArucoDetector(found, params).detectMarkers(gray)
    if numbers is None or not len(numbers):
        return np.empty((0, 4, 2)), np.empty(0, np.int64)
    return np.asarray(corners, np.float64).reshape(-1, 4, 2), np.asarray(numbers, np.int64).ravel()


def _arranged(gray: ByteImage, corners: Matrix, numbers: NDArray[np.int64], board: Board) -> Found:
    """The count of rows (from either end) and of corners (from any) that fits one plane best."""
    points, best = board.points().reshape(-1, 4, 3), (np.inf, numbers, corners)
    flipped = (board.rows - 1 - numbers // board.columns) * board.columns + numbers % board.columns
    for count in (numbers, flipped):
        for turn in range(4):
            turned = np.roll(corners, turn, axis=1)
            error = _plane_error(points[count].reshape(-1, 3)[:, :2], turned.reshape(-1, 2))
            best = min(best, (error, count, turned), key=lambda item: item[0])
    _, count, turned = best
    reach = int(np.clip(0.08 * np.linalg.norm(turned[0, 0] - turned[0, 1]), 2, 8))
    refined = cv2.cornerSubPix(gray, turned.reshape(-1, 1, 2).astype(np.float32), (reach, reach), (-1, -1), _REFINE)
    return (4 * count[:, None] + np.arange(4)).ravel(), np.asarray(refined, np.float64).reshape(-1, 2)


def _plane_error(points: Matrix, pixels: Matrix) -> float:
    found: Any = cv2.findHomography(points, pixels, 0)[0]
    if found is None:
        return float("inf")
    mapped = np.c_[points, np.ones(len(points))] @ found.T
    return float(np.median(np.linalg.norm(mapped[:, :2] / mapped[:, 2:] - pixels, axis=1)))
