"""Bundle adjustment: all numbers of a rig and all poses of the board at once, with their covariance.

Poses are eliminated pair by pair (Schur's complement), so that the time grows with the number of pairs and no faster.
Source: Triggs, McLauchlan, Hartley, Fitzgibbon: Bundle adjustment, a modern synthesis (2000), section 6.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.optics import PROJECTIONS
from uw_recon_ros.calibrate.pair_covariance import pair_covariance
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.lenses import PLUMB_BOB
from uw_recon_ros.types import Mask, Matrix

_Slopes = tuple[Matrix, Matrix, Matrix]  # pixels, slopes by numbers, slopes by pose
#: Where (numbers, pose, points) puts points: (N, 2) px, (2N, n) slopes by the numbers, (2N, 6) by the pose.
Project = Callable[[Matrix, Matrix, Matrix], _Slopes]

_MOST_STEPS = 60
_SETTLED = 1e-9  # relative fall of the cost
_HEAVIEST = 1e9
_FOLDS = 5
LEAST_HELD_OUT = 8  #: pairs from which a fifth can be left out of a fit


@dataclass(frozen=True, eq=False)
class SeenPair:
    """A board seen by both cameras at one moment.

    Parameters
    ----------
    name : str
        Of the pair, as its files or stamp say.
    left, right : Sighting
    place : int or None
        Which pair of its recording it is; None: pairs are not counted.
    """

    name: str
    left: Sighting
    right: Sighting
    place: int | None = None


@dataclass(frozen=True, eq=False)
class Bundle:
    """A solution.

    Parameters
    ----------
    numbers : (24,) float64
        See `calibrate.optics`; behind ports there are more.
    poses : (P, 6) float64
        Rotation vector and translation (m), left camera from board, of every pair.
    covariance : (24, 24) float64
        Of `numbers`, see `pair_covariance`; 0 for those that were held.
    residuals : tuple of (left, right)
        Seen minus predicted, (N, 2) px each, of every pair.
    noise_px : float
        Standard deviation of a coordinate that the residuals tell.
    free : (24,) bool
        Which numbers were solved for.
    project : two of callable
        Of the left and the right camera.
    """

    numbers: Matrix
    poses: Matrix
    covariance: Matrix
    residuals: tuple[tuple[Matrix, Matrix], ...]
    noise_px: float
    free: Mask
    project: tuple[Project, Project]

    @property
    def rms_px(self) -> float:
        """Root mean square distance of seen and predicted points, px."""
        return rms_px(self.residuals)

    @property
    def pair_rms_px(self) -> Matrix:
        """`rms_px` of every pair alone, (P,)."""
        return np.array([rms_px([pair]) for pair in self.residuals])


def rms_px(residuals: Sequence[tuple[Matrix, Matrix]]) -> float:
    """Root mean square distance over pairs of (N, 2) residuals, px."""
    everything = np.concatenate([side for pair in residuals for side in pair])
    return float(np.sqrt((everything**2).sum(axis=1).mean())) if len(everything) else float("nan")


@dataclass(frozen=True, eq=False)
class Prior:
    """What is known of the numbers beforehand.

    Parameters
    ----------
    numbers : (n,) float64
    information : (n, n) float64
        Inverse covariance, times the squared noise of a coordinate, so that it counts as points do.
    """

    numbers: Matrix
    information: Matrix

    def cost(self, numbers: Matrix) -> float:
        """Squared distance, px^2."""
        aside = numbers - self.numbers
        return float(aside @ self.information @ aside)


@dataclass(frozen=True, eq=False)
class _Normal:
    """The normal equations of one pair: blocks by numbers, by both, by pose."""

    cc: Matrix
    cp: Matrix
    pp: Matrix
    c: Matrix
    p: Matrix


PINHOLES: tuple[Project, Project] = PROJECTIONS[PLUMB_BOB]


def pair_residuals(
    numbers: Matrix, pose: Matrix, pair: SeenPair, points: Matrix, project: tuple[Project, Project] = PINHOLES
) -> tuple[Matrix, Matrix]:
    """Seen minus predicted pixels of a pair, left and right, (N, 2) px."""
    left, right = _predicted(numbers, pose, pair, points, project)
    return pair.left.pixels - left[0], pair.right.pixels - right[0]


def _predicted(
    numbers: Matrix, pose: Matrix, pair: SeenPair, points: Matrix, project: tuple[Project, Project]
) -> tuple[_Slopes, _Slopes]:
    left, right = (
        side(numbers, pose, points[seen.numbers]) for side, seen in zip(project, (pair.left, pair.right), strict=True)
    )
    return left, right


def _normal(
    numbers: Matrix, pose: Matrix, pair: SeenPair, points: Matrix, free: Mask, project: tuple[Project, Project],
    weight: float = 1.0,
) -> tuple[_Normal, float]:  # fmt: skip
    left, right = _predicted(numbers, pose, pair, points, project)
    misses = np.concatenate([(pair.left.pixels - left[0]).ravel(), (pair.right.pixels - right[0]).ravel()])
    c, p = np.concatenate([left[1], right[1]])[:, free], np.concatenate([left[2], right[2]])
    made = (c.T @ c, c.T @ p, p.T @ p, c.T @ misses, p.T @ misses)
    return _Normal(*(weight * part for part in made)), weight * float(misses @ misses)


def _damped(matrix: Matrix, weight: float) -> Matrix:
    return matrix + weight * np.diag(np.maximum(np.diag(matrix), 1e-12))


def _step(blocks: Sequence[_Normal], weight: float, prior: tuple[Matrix, Matrix]) -> tuple[Matrix, Matrix]:
    """Levenberg's and Marquardt's step of the free numbers, and of every pose; `prior`: its part of both sums."""
    inverses = [np.linalg.inv(_damped(block.pp, weight)) for block in blocks]
    reduced = _damped(np.sum([block.cc for block in blocks], axis=0) + prior[0], weight)
    wanted = np.sum([block.c for block in blocks], axis=0) + prior[1]
    for block, inverse in zip(blocks, inverses, strict=True):
        reduced = reduced - block.cp @ inverse @ block.cp.T
        wanted = wanted - block.cp @ inverse @ block.p
    numbers = np.linalg.solve(reduced, wanted)
    poses = [inverse @ (block.p - block.cp.T @ numbers) for block, inverse in zip(blocks, inverses, strict=True)]
    return numbers, np.array(poses)


def adjust(
    numbers: Matrix, poses: Matrix, pairs: Sequence[SeenPair], points: Matrix, free: Mask,
    weights: Matrix | None = None, *, project: tuple[Project, Project] = PINHOLES, prior: Prior | None = None,
) -> Bundle:  # fmt: skip
    """Minimise the squared distances of seen and predicted points, from a guess.

    Parameters
    ----------
    numbers : (24,) float64
    poses : (P, 6) float64
    pairs : sequence of SeenPair
    points : (N, 3) float64
        Of the board, m.
    free : (24,) bool
        Which numbers may move.
    weights : (P,) float64 or None
        Of the pairs; None: all 1, without which the covariance is none.
    project : two of callable
        Of the left and the right camera.
    prior : Prior or None

    Returns
    -------
    Bundle
    """
    damping, weights = 1e-3, np.ones(len(pairs)) if weights is None else weights
    known = prior or Prior(numbers, np.zeros((len(numbers), len(numbers))))

    def cost_of(there: Matrix, turned: Matrix) -> float:
        misses = (pair_residuals(there, pose, pair, points, project) for pose, pair in zip(turned, pairs, strict=True))
        squares = (sum((side**2).sum() for side in pair) for pair in misses)
        return known.cost(there) + float(sum(w * square for w, square in zip(weights, squares, strict=True)))

    for _ in range(_MOST_STEPS):
        made = [
            _normal(numbers, pose, pair, points, free, project, w)
            for pose, pair, w in zip(poses, pairs, weights, strict=True)
        ]
        blocks, cost = [block for block, _ in made], known.cost(numbers) + sum(part for _, part in made)
        pull = (known.information[np.ix_(free, free)], (known.information @ (known.numbers - numbers))[free])
        numbers, poses, damping, fallen = _descend(numbers, poses, free, blocks, pull, cost, cost_of, damping)
        if fallen <= _SETTLED * cost:
            break
    return _solution(numbers, poses, pairs, points, free, project, known)


def _descend(
    numbers: Matrix, poses: Matrix, free: Mask, blocks: Sequence[_Normal], pull: tuple[Matrix, Matrix], cost: float,
    cost_of: Callable[[Matrix, Matrix], float], damping: float,
) -> tuple[Matrix, Matrix, float, float]:  # fmt: skip
    """One step that lowers the cost, ever shorter until it does; the last number is by how much."""
    while damping < _HEAVIEST:
        try:
            moved, turned = _step(blocks, damping, pull)
        except np.linalg.LinAlgError:
            damping *= 10
            continue
        there = numbers.copy()
        there[free] += moved
        fallen = cost - cost_of(there, poses + turned)
        if fallen > 0:  # NaN is not
            return there, poses + turned, max(damping / 10, 1e-12), fallen
        damping *= 10
    return numbers, poses, damping, 0.0


def _solution(
    numbers: Matrix, poses: Matrix, pairs: Sequence[SeenPair], points: Matrix, free: Mask,
    project: tuple[Project, Project], known: Prior,
) -> Bundle:  # fmt: skip
    residuals = tuple(
        pair_residuals(numbers, pose, pair, points, project) for pose, pair in zip(poses, pairs, strict=True)
    )
    count = 2 * sum(len(side) for pair in residuals for side in pair)
    spare = max(count - int(free.sum()) - 6 * len(pairs), 1)
    noise = float(np.sqrt(sum((side**2).sum() for pair in residuals for side in pair) / spare))
    covariance = np.zeros((len(numbers), len(numbers)))
    if free.any():
        blocks = [
            _normal(numbers, pose, pair, points, free, project)[0] for pose, pair in zip(poses, pairs, strict=True)
        ]
        prior = known.information[np.ix_(free, free)]
        covariance[np.ix_(free, free)] = _spread(blocks, prior, noise)
    return Bundle(numbers, poses, covariance, residuals, noise, free, project)


def _spread(blocks: Sequence[_Normal], prior: Matrix, noise: float) -> Matrix:
    """Covariance of the free numbers; of numbers that ran away there is none."""
    try:
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            found = pair_covariance(*_without_poses(blocks), prior, noise)
    except np.linalg.LinAlgError:
        found = np.full((1, 1), np.nan)
    if not np.isfinite(found).all():
        text = (
            f"pairs of the board: no rig explains them, points miss by {noise:.3g} px; are both pictures of one moment?"
        )
        raise CalibrationError(text, Code.CALIBRATE_UNSYNCHRONISED)
    return found


def _without_poses(blocks: Sequence[_Normal]) -> tuple[list[Matrix], list[Matrix]]:
    """What each pair tells of the numbers, and how it pulls at them, when its pose may follow."""
    inverses = [np.linalg.pinv(block.pp) for block in blocks]
    parts = [block.cc - block.cp @ inverse @ block.cp.T for block, inverse in zip(blocks, inverses, strict=True)]
    pulls = [block.c - block.cp @ inverse @ block.p for block, inverse in zip(blocks, inverses, strict=True)]
    return parts, pulls


def unseen_residual(rig: Bundle, pose: Matrix, pair: SeenPair, points: Matrix) -> tuple[Matrix, Matrix]:
    """Residuals of a pair with a rig that is known, its pose fitted: how a pair left out of the fit is judged."""
    nothing: NDArray[np.bool_] = np.zeros(len(rig.numbers), np.bool_)
    return adjust(rig.numbers, pose[None], [pair], points, nothing, project=rig.project).residuals[0]


def without_folds(bundle: Bundle, pairs: Sequence[SeenPair], points: Matrix) -> Iterator[tuple[Bundle, range]]:
    """Solve without a fifth of the pairs, five times; each solution with the indices of the pairs it has not seen."""
    for fold in range(_FOLDS):
        kept = [k for k in range(len(pairs)) if k % _FOLDS != fold]
        chosen = [pairs[k] for k in kept]
        part = adjust(bundle.numbers, bundle.poses[kept], chosen, points, bundle.free, project=bundle.project)
        yield part, range(fold, len(pairs), _FOLDS)


def unseen_residuals(bundle: Bundle, pairs: Sequence[SeenPair], points: Matrix) -> list[tuple[Matrix, Matrix]]:
    """Residuals of every pair by a solution that has not seen it."""
    return [
        unseen_residual(part, bundle.poses[k], pairs[k], points)
        for part, out in without_folds(bundle, pairs, points)
        for k in out
    ]
