"""Where a board's points are in a picture, to a fraction of a pixel."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.board_kinds import APRILGRID, ASYMMETRIC, CHARUCO, CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.markers import find_aprilgrid, find_charuco, refined
from uw_recon_ros.types import ByteImage, Matrix

_LEAST_POINTS = 8  # a plane's pose needs four; fewer than eight tell nothing of their own noise
_CHECKS = cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
_QUADS = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
_SMALLEST_SIDES = (3, 4, 5)  # patterns that grow into a board of unknown size
_PATCH = 0.3  # of the distance between points, radius in which an edge's width is measured

Found = tuple[NDArray[np.int64], Matrix]


@dataclass(frozen=True, eq=False)
class Sighting:
    """A board in one picture.

    Parameters
    ----------
    numbers : (N,) int64
        Which of `Board.points`, ascending.
    pixels : (N, 2) float64
        Raw px.
    edge_px : float
        How wide the board's edges are, px: about 1.5 when sharp.
    spacing_px : float
        Median distance of neighbouring points, px.
    """

    numbers: NDArray[np.int64]
    pixels: Matrix
    edge_px: float
    spacing_px: float


#: No board.
NOT_SEEN = Sighting(np.empty(0, np.int64), np.empty((0, 2)), 0.0, 0.0)


def find_board(gray: ByteImage, board: Board) -> Sighting | None:
    """Look for the board in a picture, then in the same with its local contrast raised, as haze needs.

    Parameters
    ----------
    gray : (H, W) uint8
    board : Board

    Returns
    -------
    Sighting or None
        None where it is not seen. Points are measured on the picture in which they were found.
    """
    for picture in _versions(gray):
        found = _finder(board)(picture, board)
        if found is not None and len(found[0]) >= _LEAST_POINTS and _spread(found[1]):
            order = np.argsort(found[0])
            numbers, pixels = found[0][order], found[1][order]
            spacing = _spacing(pixels)
            return Sighting(numbers, pixels, edge_width(gray, pixels, spacing), spacing)
    return None


def _versions(gray: ByteImage) -> Iterator[ByteImage]:
    yield gray
    yield np.asarray(cv2.createCLAHE(clipLimit=4.0, tileGridSize=(4, 4)).apply(gray), np.uint8)


def _finder(board: Board) -> Callable[[ByteImage, Board], Found | None]:
    return {CHECKERBOARD: _find_checkerboard, CHARUCO: find_charuco, APRILGRID: find_aprilgrid}.get(
        board.kind, _find_circles
    )


def _find_checkerboard(gray: ByteImage, board: Board) -> Found | None:
    """Found by sectors, which holds in haze and glare, else by quads; then refined where edges cross."""
    done, corners = cv2.findChessboardCornersSB(gray, board.grid, flags=_CHECKS)
    if not done:
        done, corners = cv2.findChessboardCorners(gray, board.grid, flags=_QUADS)
    if not done:
        return None
    numbers, pixels = _all_of(corners)
    return numbers, refined(gray, pixels)


def _find_circles(gray: ByteImage, board: Board) -> Found | None:
    asymmetric = board.kind == ASYMMETRIC
    flags = cv2.CALIB_CB_ASYMMETRIC_GRID | cv2.CALIB_CB_CLUSTERING if asymmetric else cv2.CALIB_CB_SYMMETRIC_GRID
    for picture in (gray, 255 - gray):  # white circles on black as well
        done, centres = cv2.findCirclesGrid(picture, board.grid, flags=flags)
        if done:
            return _all_of(centres)
    return None


def _all_of(corners: Any) -> Found:
    pixels = np.asarray(corners, np.float64).reshape(-1, 2)
    return np.arange(len(pixels)), pixels


def _spacing(pixels: Matrix) -> float:
    apart = np.linalg.norm(pixels[:, None] - pixels[None], axis=2)
    np.fill_diagonal(apart, np.inf)
    return float(np.median(apart.min(axis=1)))


def _spread(pixels: Matrix) -> bool:
    """Whether points span a plane, and not a line."""
    sides = np.linalg.svd(pixels - pixels.mean(axis=0), compute_uv=False)
    return bool(sides[1] > 0.05 * sides[0])


def edge_width(gray: ByteImage, pixels: Matrix, spacing: float) -> float:
    """Median width of the edges near the points, px: contrast over steepest slope, across or down, whichever is less:
    a smear leaves the edges along it sharp."""
    reach = max(round(_PATCH * spacing), 2)
    smooth = cv2.GaussianBlur(gray, (0, 0), 0.6).astype(np.float32)
    slopes = [np.abs(cv2.Sobel(smooth, cv2.CV_32F, *which, scale=1 / 8)) for which in ((1, 0), (0, 1))]
    widths = []
    for u, v in np.rint(pixels).astype(int):
        part = slice(max(v - reach, 0), v + reach + 1), slice(max(u - reach, 0), u + reach + 1)
        if smooth[part].size:
            low, high = np.percentile(smooth[part], (5, 95))
            steepest = min(float(np.percentile(slope[part], 98)) for slope in slopes)
            widths.append(float(high - low) / max(steepest, 1e-3))
    return float(np.median(widths)) if widths else float("inf")


def find_checkerboard_size(gray: ByteImage) -> tuple[int, int] | None:
    """Inner corners (columns, rows) of the checkerboard in a picture, larger number last; None: not seen."""
    for side in _SMALLEST_SIDES:
        done, _, shape = cv2.findChessboardCornersSBWithMeta(gray, (side, side), _CHECKS | cv2.CALIB_CB_LARGER)
        if done:
            rows, columns = sorted(np.asarray(shape).shape[:2])
            return int(rows), int(columns)
    return None
