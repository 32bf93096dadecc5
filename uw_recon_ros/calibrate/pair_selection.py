"""Pairs that are left out before anything is solved: no board, blurred, seen before, of another size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from uw_recon_ros.board_kinds import APRILGRID, CHARUCO
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.detect import Sighting, find_board
from uw_recon_ros.calibrate.fit import LeftOut
from uw_recon_ros.findings import Code
from uw_recon_ros.types import ByteImage

LEAST_COMMON = 8  #: points that both cameras must see
_BLURRED = 1.6  # times the usual width of edges
_BLURRED_PX = 4.0  # what no pair is left out for
_SAME_PLACE = 0.002  # of the image's diagonal: a board that has moved less than that since an earlier pair


def unseen_reason(left: Sighting | None, right: Sighting | None) -> str | None:
    """Why a pair cannot be used at all; None: it can."""
    blind = [side for side, found in (("left", left), ("right", right)) if found is None]
    if left is None or right is None:
        return f"no board found in the {' and the '.join(blind)} image"
    common = len(np.intersect1d(left.numbers, right.numbers))
    return None if common >= LEAST_COMMON else f"only {common} points of the board are seen by both cameras"


def mirrored(gray: ByteImage, board: Board) -> bool:
    """Whether a board with markers, not found in a picture, is found in its mirror image."""
    return board.kind in (CHARUCO, APRILGRID) and find_board(np.ascontiguousarray(gray[:, ::-1]), board) is not None


def sharp_ones(pairs: Sequence[SeenPair]) -> tuple[list[SeenPair], list[LeftOut]]:
    """Split off pairs whose edges are far wider than those of most."""
    if not pairs:
        return [], []
    widths = [max(pair.left.edge_px, pair.right.edge_px) for pair in pairs]
    usual = float(np.median(widths))
    limit = max(_BLURRED * usual, _BLURRED_PX)
    kept = [pair for pair, width in zip(pairs, widths, strict=True) if width <= limit]
    blurred = [
        LeftOut(pair.name, f"blurred: edges are {width:.1f} px wide (others {usual:.1f} px)", Code.CALIBRATE_BLURRED)
        for pair, width in zip(pairs, widths, strict=True)
        if width > limit
    ]
    return kept, blurred


def different_ones(pairs: Sequence[SeenPair], size: tuple[int, int]) -> tuple[list[SeenPair], list[LeftOut]]:
    """Split off pairs that show the board where an earlier one shows it, so that a still board does not outvote."""
    kept, same = list[SeenPair](), list[LeftOut]()
    for pair in pairs:
        twin = seen_before(pair, kept, size)
        if twin is None:
            kept.append(pair)
        else:
            same.append(LeftOut(pair.name, f"shows the board where {twin.name} does", Code.CALIBRATE_DUPLICATE))
    return kept, same


def seen_before(pair: SeenPair, others: Sequence[SeenPair], size: tuple[int, int]) -> SeenPair | None:
    """One of others that shows the board in the same place."""
    limit = _SAME_PLACE * float(np.hypot(*size))
    return next((other for other in others if _moved(pair, other) < limit), None)


def _moved(pair: SeenPair, other: SeenPair) -> float:
    """Root mean square motion of the points common to both, px."""
    moves = []
    for one, two in ((pair.left, other.left), (pair.right, other.right)):
        _, here, there = np.intersect1d(one.numbers, two.numbers, return_indices=True)
        if not len(here):
            return float("inf")
        moves.append(((one.pixels[here] - two.pixels[there]) ** 2).sum(axis=1).mean())
    return float(np.sqrt(np.mean(moves)))
