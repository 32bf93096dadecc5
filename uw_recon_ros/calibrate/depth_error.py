"""What a calibration is worth: the error of depth that its covariance leaves, and that of pairs left out of the fit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from uw_recon_ros.calibrate.bundle import LEAST_HELD_OUT, Bundle, SeenPair, rms_px, unseen_residual, without_folds
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.types import Matrix

RANGES_M = (0.5, 1.0, 2.0, 3.0, 5.0)


@dataclass(frozen=True)
class DepthError:
    """How wrong depth is at a range by the calibration alone, one standard deviation.

    Parameters
    ----------
    range_m : float
    middle_percent, mean_percent, worst_percent : float
        Nearest to the middle of what both cameras see, root mean square over it, and at its worst place; NaN where
        they see nothing in common.
    """

    range_m: float
    middle_percent: float
    mean_percent: float
    worst_percent: float


class Locates(Protocol):
    """A rig by its numbers, whatever stands before its cameras."""

    @property
    def numbers(self) -> Matrix:
        """What the covariance is of."""

    def moved(self, by: Matrix) -> Locates:
        """The rig of numbers that differ."""

    def common_view(self, range_m: float) -> tuple[Matrix, Matrix, Matrix]:
        """Places at a depth that both cameras see, see `rig.RigNumbers`."""

    def located(self, left: Matrix, right: Matrix) -> Matrix:
        """(N, 3) points of pixels, m."""


def depth_sigmas(
    rig: Locates, covariance: Matrix, range_m: float, seen_by: Locates | None = None
) -> tuple[Matrix, Matrix]:
    """Relative standard deviation of depth by the calibration at places both cameras see.

    Parameters
    ----------
    rig : Locates
    covariance : (n, n) float64
    range_m : float
    seen_by : Locates or None
        The rig that tells which places both cameras see; None: the same.

    Returns
    -------
    (N, 3), (N,) float64
        Points in the left frame, m; sigma over depth.
    """
    points, left, right = (seen_by or rig).common_view(range_m)
    if not len(points):
        return points, np.empty(0)
    values, vectors = np.linalg.eigh(covariance)
    changes = []
    for value, vector in zip(values, vectors.T, strict=True):
        if value <= 0:
            continue
        there, back = (rig.moved(sign * np.sqrt(value) * vector).located(left, right) for sign in (1, -1))
        changes.append((there[:, 2] - back[:, 2]) / 2)
    return points, np.sqrt(np.sum(np.square(changes), axis=0)) / points[:, 2]


def depth_errors_by_range(rig: Locates, covariance: Matrix) -> tuple[DepthError, ...]:
    """The table that decides: depth error in percent at each of `RANGES_M`."""
    return tuple(_depth_error(rig, covariance, range_m) for range_m in RANGES_M)


def _depth_error(rig: Locates, covariance: Matrix, range_m: float) -> DepthError:
    points, sigmas = depth_sigmas(rig, covariance, range_m)
    if not len(points):
        return DepthError(range_m, *([float("nan")] * 3))
    sigmas = np.where(np.isfinite(sigmas), sigmas, np.inf)
    middle = int(np.argmin(np.linalg.norm(points - points.mean(axis=0), axis=1)))
    mean = float(np.sqrt(np.mean(sigmas**2)))
    return DepthError(range_m, 100 * float(sigmas[middle]), 100 * mean, 100 * float(sigmas.max()))


@dataclass(frozen=True)
class HeldOut:
    """Pairs judged by a calibration that has not seen them.

    Parameters
    ----------
    rms_px : float
        Distance of seen and predicted points, the board's pose fitted.
    length_percent : float
        Median error of distances across the board, measured by stereo.
    length_bias_percent : float
        Mean signed error.
    pairs : int
    """

    rms_px: float
    length_percent: float
    length_bias_percent: float
    pairs: int


def held_out(bundle: Bundle, pairs: Sequence[SeenPair], points: Matrix, rig: RigNumbers) -> HeldOut | None:
    """Judge every pair by a solution that has not seen it; None for fewer than eight pairs."""
    if len(pairs) < LEAST_HELD_OUT:
        return None
    misses, lengths = [], []
    for part, out in without_folds(bundle, pairs, points):
        found = replace(rig, numbers=part.numbers)
        misses += [unseen_residual(part, bundle.poses[k], pairs[k], points) for k in out]
        lengths += [length_errors(found, pairs[k], points) for k in out]
    errors = np.concatenate(lengths)
    errors = errors[np.isfinite(errors)]
    return HeldOut(rms_px(misses), 100 * float(np.median(np.abs(errors))), 100 * float(errors.mean()), len(pairs))


def length_errors(rig: RigNumbers, pair: SeenPair, points: Matrix) -> Matrix:
    """Relative errors of distances across the board, each over at least half of its size, measured by stereo."""
    common, at_left, at_right = np.intersect1d(pair.left.numbers, pair.right.numbers, return_indices=True)
    found, true = rig.located(pair.left.pixels[at_left], pair.right.pixels[at_right]), points[common]
    one, other = np.triu_indices(len(common), 1)
    lengths = np.linalg.norm(true[one] - true[other], axis=1)
    far = lengths >= 0.5 * lengths.max(initial=0.0)
    measured = np.linalg.norm(found[one[far]] - found[other[far]], axis=1)
    return np.asarray(measured / lengths[far] - 1, np.float64)
