"""Whether both cameras' pictures were taken at the same moments, and if not, by how many pairs one runs late."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import SeenPair, adjust
from uw_recon_ros.calibrate.detect import NOT_SEEN
from uw_recon_ros.calibrate.fit import LEAST_PAIRS, Fit, ordered_alike, solve
from uw_recon_ros.calibrate.guess import guess_pose, guess_rig, right_from_left
from uw_recon_ros.calibrate.optics import NAMES, PROJECTIONS, SIDES
from uw_recon_ros.calibrate.pair_selection import LEAST_COMMON
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.lenses import PLUMB_BOB
from uw_recon_ros.types import Matrix

_DOUBTED_PX = 0.7  # of noise: cameras that saw one moment hardly reach it
_APART = 2.0  # times the noise of either camera alone
_MOST_SHIFT = 10  # pairs
_MOST_LOOKED_AT = 60  # pairs
_TRIED = 2  # shifts that are solved for, the likeliest first
_AGREE, _AGREE_PX = 0.7, 1.0  # of the pairs, and how well, at the right shift
_Match = tuple[SeenPair, SeenPair]  # one with the left, one with the right picture of a moment


@dataclass(frozen=True)
class Shift:
    """By how many pairs one camera runs late.

    Parameters
    ----------
    pairs : int
        The right picture of pair ``k + pairs`` belongs to the left one of pair ``k``.
    left, right : str
        An example: the pairs that hold the left and the right picture of one moment.
    agreed, of : int
        How many pairs agree when paired so, and how many there are.
    noise_px : float
        Of a coordinate, then.
    """

    pairs: int
    left: str
    right: str
    agreed: int
    of: int
    noise_px: float


def alone_px(pairs: Sequence[SeenPair], board: Board, size: tuple[int, int], lens: str = PLUMB_BOB) -> float:
    """Noise of a coordinate, px, when each camera is calibrated alone: that of the worse one.

    Parameters
    ----------
    pairs : sequence of SeenPair
    board : Board
    size : (width, height)
        Of both images, px.
    lens : {'plumb_bob', 'equidistant'}
    """
    noises, free = [], np.zeros(len(NAMES), np.bool_)
    free[SIDES[0].start : SIDES[0].start + 6] = True
    for views in ([replace(p, right=p.left) for p in pairs], [replace(p, left=p.right) for p in pairs]):
        numbers, poses = guess_rig(views, board.points(), size, lens)
        single = [replace(view, right=NOT_SEEN) for view in views]
        noises.append(adjust(numbers, poses, single, board.points(), free, project=PROJECTIONS[lens]).noise_px)
    return max(noises)


def do_not_belong(fit: Fit, pairs: Sequence[SeenPair], board: Board, size: tuple[int, int]) -> bool:
    """Whether each camera sees the board well, and both together do not."""
    most_left_out, noise = 2 * len(fit.pairs) < len(pairs), fit.bundle.noise_px
    if not most_left_out and noise < _DOUBTED_PX:
        return False
    alone = alone_px(pairs, board, size, fit.lens)
    return alone < _DOUBTED_PX and (most_left_out or noise > _APART * alone)


def find_shift(
    pairs: Sequence[SeenPair], board: Board, size: tuple[int, int], among: Sequence[SeenPair] = ()
) -> Shift | None:
    """The shift at which pairs agree that do not as they came.

    Parameters
    ----------
    pairs : sequence of SeenPair
        With their places in the recording; those without are not looked at.
    board : Board
    size : (width, height)
        Of both images, px.
    among : sequence of SeenPair
        More of the recording, in which a right picture may be found.

    Returns
    -------
    Shift or None
        None: at no shift do most pairs agree.
    """
    placed = [pair for pair in pairs if pair.place is not None][:_MOST_LOOKED_AT]
    if len(placed) < LEAST_PAIRS:
        return None
    numbers, points = guess_rig(placed, board.points(), size)[0], board.points()
    shifted = {
        shift: [(match, _joined(match, board)) for match in matches] for shift, matches in _shifts(placed, among)
    }
    spreads = {shift: _spread(numbers, [pair for _, pair in made], points) for shift, made in shifted.items()}
    likeliest = sorted(spreads, key=lambda shift: spreads[shift])[:_TRIED]
    solved = [made for shift in likeliest if (made := _solved(shift, shifted[shift], board, size)) is not None]
    return min(solved, key=lambda made: made.noise_px, default=None)


def _solved(shift: int, made: Sequence[tuple[_Match, SeenPair]], board: Board, size: tuple[int, int]) -> Shift | None:
    """What comes of a shift; None where most pairs do not agree."""
    try:
        found = solve([pair for _, pair in made], board, size)
    except CalibrationError:
        return None
    if len(found.pairs) < _AGREE * len(made) or found.bundle.noise_px > _AGREE_PX:
        return None
    left, right = made[0][0]
    return Shift(shift, left.name, right.name, len(found.pairs), len(made), found.bundle.noise_px)


def _shifts(pairs: Sequence[SeenPair], among: Sequence[SeenPair]) -> Iterator[tuple[int, list[_Match]]]:
    """Each shift with what belongs together by it, where that is enough for a calibration."""
    by_place = {pair.place: pair for pair in (*among, *pairs)}
    for shift in (k for k in range(-_MOST_SHIFT, _MOST_SHIFT + 1) if k):
        later = [(pair, by_place.get((pair.place or 0) + shift)) for pair in pairs]
        matches = [(one, other) for one, other in later if other is not None and _see_the_same(one, other)]
        if len(matches) >= LEAST_PAIRS:
            yield shift, matches


def _see_the_same(one: SeenPair, other: SeenPair) -> bool:
    return len(np.intersect1d(one.left.numbers, other.right.numbers)) >= LEAST_COMMON


def _joined(match: _Match, board: Board) -> SeenPair:
    return ordered_alike(SeenPair(match[0].name, match[0].left, match[1].right), board)


def _spread(numbers: Matrix, pairs: Sequence[SeenPair], points: Matrix) -> float:
    """How differently pairs tell where the right camera stands: median angle, and move over the board's distance."""
    lefts, rights = (
        [guess_pose(numbers[side], view, points) for view in views]
        for side, views in zip(SIDES, ([p.left for p in pairs], [p.right for p in pairs]), strict=True)
    )
    motions, distances = right_from_left(lefts, rights), np.linalg.norm(np.array(lefts)[:, 3:], axis=1)
    aside = motions - np.median(motions, axis=0)
    return float(np.median(np.linalg.norm(aside[:, :3], axis=1) + np.linalg.norm(aside[:, 3:], axis=1) / distances))
