"""Whether an uncalibrated rig's lenses bend straight lines, and how far: told by its tie points alone.

Straight rows need straight lines. A lens that bends them leaves epipolar errors that no rotation explains, or worse,
that a wrong focal length explains. With the right bend the quasi-Euclidean fit leaves least of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from uw_recon_ros.rectify.lens import UNKNOWN, Lens
from uw_recon_ros.rectify.model_selection import Candidate, fit_rig, trimmed_fit
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.quality import homography_share
from uw_recon_ros.rectify.quasi_euclidean import QuasiEuclidean
from uw_recon_ros.rectify.sampson import sampson_distance
from uw_recon_ros.rectify.shape import USUAL_FOCAL
from uw_recon_ros.rectify.tie_points import TiePoints, thinned

_GRID = (-0.13, -0.09, -0.05, 0.0, 0.06, 0.14, 0.24, 0.36, 0.5)  # of the bend; at -4 / 27 the image would fold
_STEP = 0.02
_POINTS = 300  # that the bend is searched with
_SIGNIFICANT = 50.0  # fall of the sum of squares, in variances of a tie point
# A principal point off the middle, or two unequal focal lengths, look like a weak lens: what they reach (1 % of the
# width, 0.5 %) is not taken for one, and tie points left out of the fit must be left with much less.
_LEAST_BEND, _BETTER = 0.04, 0.9
_LIKE_A_LENS = 0.02  # what they are as a bend, standard deviation
_FAR_FOCAL = float(np.log(2.0))  # from a usual focal length: a lens that asks for more is none
_INSIDE = 0.9  # of these: the rest may be outliers

_Cost = Callable[[float], float]


def find_lens(candidate: Candidate, params: RectifyParams) -> Candidate:
    """The candidate with its lens, and fitted anew, where the tie points leave no doubt that it bends.

    Of a flat scene nothing is said: its own geometry can stand for a lens.

    Parameters
    ----------
    candidate : Candidate
        Fitted without a lens.
    params : RectifyParams
    """
    if _flat(candidate, params):
        return candidate
    found, gain = _searched(thinned(candidate.fitted, _POINTS, params.rectify_seed), params)
    if gain < _SIGNIFICANT or abs(found.bend) < _LEAST_BEND:
        return candidate
    straight = found.straightened(candidate.fitted)
    fit = trimmed_fit(straight, fit_rig(straight, params), params)
    before = left_over(candidate.fit, candidate.held_out)
    after = left_over(fit, found.straightened(candidate.held_out))
    farther = _unusual(fit, candidate) > max(_FAR_FOCAL, _unusual(candidate.fit, candidate))
    if farther or not after < _BETTER * before:
        return candidate
    return replace(candidate, fit=fit, lens=found)


def _flat(candidate: Candidate, params: RectifyParams) -> bool:
    return homography_share(candidate.everything, 2 * params.tie_threshold_px) > params.flat_share_limit


def _unusual(fit: QuasiEuclidean, candidate: Candidate) -> float:
    """How far the focal length is from a usual one, its logarithm."""
    usual = USUAL_FOCAL * (candidate.everything.width + candidate.everything.height)
    return abs(float(np.log(fit.focal_px / usual)))


def left_over(fit: QuasiEuclidean, points: TiePoints) -> float:
    """Root mean square of the smallest distances from the epipolar lines, px."""
    distance = np.sort(np.abs(sampson_distance(fit.fundamental, points.left, points.right)))
    return float(np.sqrt(np.square(distance[: max(round(_INSIDE * len(distance)), 1)]).mean()))


def _searched(points: TiePoints, params: RectifyParams) -> tuple[Lens, float]:
    """The bend of least cost, and by how much it is less than without, in variances of a tie point.

    The cost has more than one valley, where focal lengths part: so it is looked at all over first.
    """

    def cost(bend: float) -> float:
        return fit_rig(Lens(bend).straightened(points), params).cost_px2

    costs = [cost(bend) for bend in _GRID]
    straight, lowest = costs[_GRID.index(0.0)], int(np.argmin(costs))
    if _GRID[lowest] == 0:
        return Lens(), 0.0
    limits = _GRID[max(lowest - 1, 0)], _GRID[min(lowest + 1, len(_GRID) - 1)]
    bend = float(minimize_scalar(cost, bounds=limits, method="bounded", options={"xatol": 2e-3}).x)
    least = cost(bend)
    variance = max(least / len(points), 1e-12)
    beyond = min(bend - _GRID[0], _GRID[-1] - bend) < _STEP / 2
    sigma = UNKNOWN if beyond else _sigma(cost, bend, least, variance)
    return Lens(bend, sigma), (straight - least) / variance


def _sigma(cost: _Cost, bend: float, least: float, variance: float) -> float:
    """Standard deviation of the bend, by how fast the cost grows beside it."""
    curvature = (cost(bend + _STEP) + cost(bend - _STEP) - 2 * least) / (2 * _STEP**2)
    return min(float(np.hypot(np.sqrt(variance / curvature), _LIKE_A_LENS)), UNKNOWN) if curvature > 0 else UNKNOWN
