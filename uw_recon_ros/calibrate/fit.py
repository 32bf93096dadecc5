"""From sightings of a board to a rig: the order of points, the staged solution, pairs that do not belong."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.board_kinds import CHECKERBOARD, CIRCLES
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import (
    LEAST_HELD_OUT,
    Bundle,
    SeenPair,
    adjust,
    rms_px,
    unseen_residual,
    unseen_residuals,
)
from uw_recon_ros.calibrate.detect import NOT_SEEN
from uw_recon_ros.calibrate.guess import guess_rig
from uw_recon_ros.calibrate.optics import EXTRINSIC, NAMES, PROJECTIONS, SIDES
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.lenses import AUTO, EQUIDISTANT, PLUMB_BOB
from uw_recon_ros.types import Mask, Matrix

LEAST_PAIRS = 4
_OUTLYING = 3.0  # times the median error of a pair
_OUTLYING_PX = 0.5  # what no pair is left out for
_REWEIGHTED = 8
_MOST_AGREE, _AGREE_PX = 0.8, 1.0  # of the pairs, and how well, for pictures that were turned over
_ALL_ALIKE = 0.4  # least over largest weight: no pair stands out
_SINGLE_FITS = 0.4  # share of the pair's error in either camera alone, below which the two disagree on the moment
_GAIN = 0.97  # held-out error of a richer or another model over that of the plain one, up to which it is worth having
_WIDE = 0.9  # px off the middle over focal length
_SHAPE = {PLUMB_BOB: (4, 5, 6, 7), EQUIDISTANT: (4, 5)}  # which of a camera's numbers bend it
_MORE_SHAPE = {PLUMB_BOB: (8,), EQUIDISTANT: (6, 7)}


@dataclass(frozen=True)
class LeftOut:
    """A pair that was not used.

    Parameters
    ----------
    name : str
    reason : str
        In words, with numbers.
    code : Code
    """

    name: str
    reason: str
    code: Code


@dataclass(frozen=True, eq=False)
class Fit:
    """A solution with what it was made of.

    Parameters
    ----------
    bundle : Bundle
    pairs : tuple of SeenPair
        Used, in the order of the bundle.
    left_out : tuple of LeftOut
    lens : {'plumb_bob', 'equidistant'}
    """

    bundle: Bundle
    pairs: tuple[SeenPair, ...]
    left_out: tuple[LeftOut, ...]
    lens: str = PLUMB_BOB


def ordered_alike(pair: SeenPair, board: Board) -> SeenPair:
    """Count the points of the right image from the corner that the left one begins with.

    A board without markers looks the same turned by 180 degrees, a square one by 90: the order is taken that moves
    points most alike.
    """
    if board.kind not in (CHECKERBOARD, CIRCLES):
        return pair
    left, right = pair.left.pixels - pair.left.pixels.mean(axis=0), pair.right.pixels - pair.right.pixels.mean(axis=0)
    orders = _orders(board)
    best = min(orders, key=lambda order: float(((right[order] - left) ** 2).sum()))
    return replace(pair, right=replace(pair.right, pixels=pair.right.pixels[best]))


def _orders(board: Board) -> list[NDArray[np.int64]]:
    columns, rows = board.grid
    numbers = np.arange(columns * rows).reshape(rows, columns)
    turns = range(4) if columns == rows else (0, 2)
    return [np.rot90(numbers, turn).ravel() for turn in turns]


def solve(pairs: Sequence[SeenPair], board: Board, size: tuple[int, int], lens: str = PLUMB_BOB) -> Fit:
    """Solve for a rig; pairs that do not agree with the others are left out, by name.

    Parameters
    ----------
    pairs : sequence of SeenPair
    board : Board
    size : (width, height)
        Of both images, px.
    lens : {'auto', 'plumb_bob', 'equidistant'}
        Model of both lenses; `auto`: of a wide view the one that predicts pairs it has not seen better.

    Raises
    ------
    CalibrationError
        Fewer than four pairs, at the beginning or in the end.
    """
    if lens != AUTO:
        return _solved(pairs, board, size, lens)
    try:
        plain = _solved(pairs, board, size, PLUMB_BOB)
    except CalibrationError as error:
        try:
            return _solved(pairs, board, size, EQUIDISTANT)
        except CalibrationError:
            raise error from None
    if not _wide(plain):
        return plain
    try:
        wide = _solved(pairs, board, size, EQUIDISTANT)
    except CalibrationError:
        return plain
    return wide if _fits_better(wide, plain, board.points()) else plain


def turned_over(pairs: Sequence[SeenPair], board: Board, size: tuple[int, int]) -> str | None:
    """How the right camera's pictures are turned against the left one's, where that alone keeps pairs from agreeing.

    Only of boards without markers, which are found in a mirror image too.

    Parameters
    ----------
    pairs : sequence of SeenPair
    board : Board
    size : (width, height)
        Of both images, px.

    Returns
    -------
    str or None
        ``mirrored`` or ``upside down``; None: neither explains them.
    """
    if board.kind not in (CHECKERBOARD, CIRCLES):
        return None
    columns, rows = board.grid
    numbers, edge = np.arange(columns * rows).reshape(rows, columns), np.array(size) - 1.0
    ways = {
        "mirrored": (numbers[:, ::-1].ravel(), np.array([-1.0, 1.0])),
        "upside down": (numbers[::-1, ::-1].ravel(), np.array([-1.0, -1.0])),
    }
    for way, (order, signs) in ways.items():
        places = [np.where(signs < 0, edge - pair.right.pixels, pair.right.pixels)[order] for pair in pairs]
        changed = [replace(pair, right=replace(pair.right, pixels=px)) for pair, px in zip(pairs, places, strict=True)]
        try:
            found = solve(changed, board, size)
        except CalibrationError:
            continue
        if len(found.pairs) >= _MOST_AGREE * len(pairs) and found.bundle.noise_px < _AGREE_PX:
            return way
    return None


def _wide(fit: Fit) -> bool:
    """Whether the board was seen so far off the axis that lenses of both kinds differ."""
    for side, sightings in zip(SIDES, ([p.left for p in fit.pairs], [p.right for p in fit.pairs]), strict=True):
        camera = fit.bundle.numbers[side]
        aside = (np.concatenate([sighting.pixels for sighting in sightings]) - camera[2:4]) / camera[:2]
        if float(np.linalg.norm(aside, axis=1).max()) > _WIDE:
            return True
    return False


def _fits_better(one: Fit, other: Fit, points: Matrix) -> bool:
    """Whether more pairs agree with it, or it predicts those it has not seen better."""
    if len(one.pairs) != len(other.pairs):
        return len(one.pairs) > len(other.pairs)
    if len(one.pairs) < LEAST_HELD_OUT:
        return one.bundle.noise_px < _GAIN * other.bundle.noise_px
    errors = [rms_px(unseen_residuals(fit.bundle, fit.pairs, points)) for fit in (one, other)]
    return errors[0] < _GAIN * errors[1]


def _solved(pairs: Sequence[SeenPair], board: Board, size: tuple[int, int], lens: str) -> Fit:
    points, left_out = board.points(), list[LeftOut]()
    kept = [ordered_alike(pair, board) for pair in pairs]
    enough(kept, left_out)
    bundle = _staged(*guess_rig(kept, points, size, lens), kept, points, lens)
    while True:
        bundle = _by_most(bundle, kept, points)
        wrong = _outlying(bundle)
        left_out += [_named(kept[k], bundle, k, points) for k in wrong]
        kept = [pair for k, pair in enumerate(kept) if k not in wrong]
        enough(kept, left_out)
        poses = np.delete(bundle.poses, wrong, axis=0)
        bundle = adjust(bundle.numbers, poses, kept, points, bundle.free, project=bundle.project)
        if not wrong:
            return Fit(_with_more(bundle, kept, points, lens), tuple(kept), tuple(left_out), lens)


def without_outlying(
    bundle: Bundle,
    pairs: Sequence[SeenPair],
    fitted: Callable[[Matrix, Matrix, Sequence[SeenPair]], Bundle],
    before: Sequence[LeftOut] = (),
) -> tuple[Bundle, tuple[SeenPair, ...], tuple[LeftOut, ...]]:
    """Fit again, by numbers, poses and pairs, until no pair fits far worse than most; `before`: left out already.

    Raises
    ------
    CalibrationError
        Fewer than four pairs are left.
    """
    left_out, kept = list(before), tuple(pairs)
    while wrong := _outlying(bundle):
        usual = float(np.median(bundle.pair_rms_px))
        for k in wrong:
            text = f"points miss by {bundle.pair_rms_px[k]:.2f} px (others {usual:.2f})"
            left_out.append(LeftOut(kept[k].name, text, Code.CALIBRATE_OUTLIER))
        kept = tuple(pair for k, pair in enumerate(kept) if k not in wrong)
        enough(kept, left_out)
        bundle = fitted(bundle.numbers, np.delete(bundle.poses, wrong, axis=0), kept)
    return bundle, kept, tuple(left_out)


def enough(kept: Sequence[SeenPair], left_out: Sequence[LeftOut]) -> None:
    """Raise `CalibrationError` for fewer than four pairs."""
    if len(kept) < LEAST_PAIRS:
        because = f"; left out: {left_out[-1].name}: {left_out[-1].reason}" if left_out else ""
        raise CalibrationError(
            f"pairs of the board: expected at least {LEAST_PAIRS} that agree, got {len(kept)}{because}",
            Code.CALIBRATE_TOO_FEW,
        )


def _free(lens: str, *, middle: bool, shape: bool, more: bool) -> Mask:
    free = np.ones(len(NAMES), np.bool_)
    for side in SIDES:
        free[side.start + 2 : side.start + 4] = middle
        free[side.start + 4 : side.stop] = False
        free[[side.start + k for k in _SHAPE[lens]]] = shape
        free[[side.start + k for k in _MORE_SHAPE[lens]]] = more
    return free


def _staged(numbers: Matrix, poses: Matrix, pairs: Sequence[SeenPair], points: Matrix, lens: str) -> Bundle:
    """First what is coarse, then the rest from there."""
    for middle, shape in ((False, False), (False, True), (True, True)):
        free = _free(lens, middle=middle, shape=shape, more=False)
        bundle = adjust(numbers, poses, pairs, points, free, project=PROJECTIONS[lens])
        numbers, poses = bundle.numbers, bundle.poses
    return bundle


def _with_more(bundle: Bundle, pairs: Sequence[SeenPair], points: Matrix, lens: str) -> Bundle:
    """The solution with distortion of higher powers, where that predicts pairs it has not seen better; beyond the
    points it sees it runs away, and a better fit alone is no reason."""
    if len(pairs) < LEAST_HELD_OUT:
        return bundle
    free = _free(lens, middle=True, shape=True, more=True)
    richer = adjust(bundle.numbers, bundle.poses, pairs, points, free, project=bundle.project)
    plain, bent = (rms_px(unseen_residuals(found, pairs, points)) for found in (bundle, richer))
    return richer if bent < _GAIN * plain else bundle


def _by_most(bundle: Bundle, pairs: Sequence[SeenPair], points: Matrix) -> Bundle:
    """The solution that most pairs agree on: those that fit badly weigh ever less (Geman and McClure)."""
    for _ in range(_REWEIGHTED):
        usual = max(float(np.median(bundle.pair_rms_px)), 1e-6)
        weights = 1 / (1 + (bundle.pair_rms_px / (2 * usual)) ** 2) ** 2
        if weights.min() > _ALL_ALIKE * weights.max():
            break
        bundle = adjust(bundle.numbers, bundle.poses, pairs, points, bundle.free, weights, project=bundle.project)
    return bundle


def _outlying(bundle: Bundle) -> list[int]:
    """Pairs that fit far worse than most."""
    errors = bundle.pair_rms_px
    limit = max(_OUTLYING * float(np.median(errors)), _OUTLYING_PX)
    return [int(k) for k in np.flatnonzero(errors > limit)]


def _named(pair: SeenPair, bundle: Bundle, index: int, points: Matrix) -> LeftOut:
    """Why a pair does not fit: each camera alone tells whether the two saw one moment."""
    together, usual = float(bundle.pair_rms_px[index]), float(np.median(bundle.pair_rms_px))
    alone = max(_alone(bundle, index, pair, side, points) for side in ("left", "right"))
    if alone < _SINGLE_FITS * together:
        reason = (
            f"not taken at one moment? reprojection error {together:.2f} px (others {usual:.2f}), in either camera "
            "alone "
            f"by at most {alone:.2f}"
        )
        return LeftOut(pair.name, reason, Code.CALIBRATE_UNSYNCHRONISED)
    return LeftOut(pair.name, f"reprojection error {together:.2f} px (others {usual:.2f})", Code.CALIBRATE_OUTLIER)


def _alone(bundle: Bundle, index: int, pair: SeenPair, side: str, points: Matrix) -> float:
    """Error of one camera's points when the board's pose need please no other camera."""
    single = replace(pair, right=NOT_SEEN) if side == "left" else replace(pair, left=NOT_SEEN)
    return rms_px([unseen_residual(bundle, bundle.poses[index], single, points)])


def baseline_sigma(bundle: Bundle) -> float:
    """Standard deviation of the distance between the cameras, m."""
    move = bundle.numbers[EXTRINSIC][3:]
    direction, part = move / np.linalg.norm(move), slice(EXTRINSIC.start + 3, EXTRINSIC.stop)
    return float(np.sqrt(direction @ bundle.covariance[part, part] @ direction))
