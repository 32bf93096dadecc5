"""Quasi-Euclidean rectification (paper 2.2): the homographies a calibrated rig would have, found from matches alone.

``F = K^-T R_r^T [u1]x R_l K^-1`` (eq. 15) with one unknown focal length for both cameras, no skew, square pixels and
the principal point in the image's centre (eq. 16) is fitted to tie points by their Sampson error (eq. 13). Everything
here is for a horizontal baseline; a vertical rig comes in with rows and columns exchanged.

References
----------
A. Fusiello, L. Irsara, Quasi-Euclidean epipolar rectification of uncalibrated images, Machine Vision and Applications
22 (2011).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from uw_recon_ros.rectify.parametrization import LOG3, fundamental_and_jacobian, rotation_about, rotations
from uw_recon_ros.rectify.sampson import homogeneous, sampson_jacobian, sampson_residuals
from uw_recon_ros.types import Matrix

_FOCAL_STARTS = np.linspace(-1.0, 1.0, 9)
_RANDOM_RESTARTS = 6
_COARSE_MATCHES = 300
# Scaled by the Jacobian's columns, scipy's default, the first step from zero leaves for focal lengths of no return.
_STEP_SCALE = 1e-3

# What a rig is like before any match is seen: standard deviations of the five angles and of alpha', and its mean,
# a focal length of about the image's width (in water 53 degrees). One match weighs about as much as each of them.
_PRIOR_ANGLE = np.radians(5.0)
_PRIOR_FOCAL = 0.3
_PRIOR_MEAN = np.array([0.0, 0.0, 0.0, 0.0, 0.0, -0.5])
_MATCH_NOISE_PX = 0.8


@dataclass(frozen=True, eq=False)
class QuasiEuclidean:
    """A fitted pair of cameras, up to what uncalibrated matches can tell.

    Parameters
    ----------
    rotation_left, rotation_right : (3, 3) float64
        From the raw to the rectified camera frame.
    focal_px : float
        Estimated (or given) focal length: makes the rows agree, calibrates nothing.
    focal_fixed : bool
        Whether it was given, or set to ``w + h`` because no start converged within [1/3, 3] of that.
    fundamental : (3, 3) float64
        ``x_right^T F x_left = 0`` in px, Frobenius norm 1.
    cost_px2 : float
        Sum of squared Sampson distances and prior, px^2.
    infinity_sigma_px : float
        Standard deviation of the disparity of points at infinity, px.
    focal_sigma : float
        Standard deviation of the focal length, as a share of it; 0 where it was given.
    """

    rotation_left: Matrix
    rotation_right: Matrix
    focal_px: float
    focal_fixed: bool
    fundamental: Matrix
    cost_px2: float
    infinity_sigma_px: float
    focal_sigma: float = 0.0


@dataclass(frozen=True, eq=False)
class _Solution:
    """Where Levenberg-Marquardt came to rest."""

    unknowns: Matrix
    cost: float  # sum of squares
    jacobian: Matrix


@dataclass(frozen=True, eq=False)
class _Problem:
    """Residuals of tie points and prior, in units of ``w + h``."""

    left: Matrix
    right: Matrix
    free: NDArray[np.bool_]
    fixed: Matrix
    prior_weights: Matrix

    def unknowns(self, values: Matrix) -> Matrix:
        """All six, the fixed ones filled in."""
        full: Matrix = self.fixed.copy()
        full[self.free] = values
        return full

    def residuals(self, values: Matrix) -> Matrix:
        unknowns = self.unknowns(values)
        distances = sampson_residuals(fundamental_and_jacobian(unknowns)[0], self.left, self.right)
        prior = (unknowns - _PRIOR_MEAN) * self.prior_weights
        return np.concatenate([distances, prior[self.free]])

    def jacobian(self, values: Matrix) -> Matrix:
        fundamental, by_unknowns = fundamental_and_jacobian(self.unknowns(values))
        distances = sampson_jacobian(fundamental, self.left, self.right) @ by_unknowns[:, self.free]
        return np.concatenate([distances, np.diag(self.prior_weights[self.free])])

    def solve(self, start: Matrix) -> _Solution:
        found = least_squares(
            self.residuals, start[self.free], jac=self.jacobian, method="lm", x_scale=_STEP_SCALE, max_nfev=200
        )
        return _Solution(self.unknowns(found.x), 2 * float(found.cost), np.asarray(found.jac))


def _problem(left: Matrix, right: Matrix, unit_px: float, prior_weight: float, alpha: float | None) -> _Problem:
    free = np.ones(6, bool)
    fixed = np.zeros(6)
    if alpha is not None:
        free[5], fixed[5] = False, alpha
    weights = np.array([1 / _PRIOR_ANGLE] * 5 + [1 / _PRIOR_FOCAL]) * np.sqrt(prior_weight) * _MATCH_NOISE_PX / unit_px
    return _Problem(left, right, free, fixed, weights)


def _best(problem: _Problem, starts: list[Matrix]) -> _Solution | None:
    """Cheapest of the solutions whose alpha' lies in [-1, 1]; the first of equals."""
    solutions = [problem.solve(start) for start in starts]
    inside = [s for s in solutions if np.isfinite(s.cost) and abs(s.unknowns[5]) <= 1.0]
    return min(inside, key=lambda s: s.cost) if inside else None


def _coarse(problem: _Problem) -> _Problem:
    """The same problem with some of the matches, enough to tell good starts from bad ones."""
    step = -(-len(problem.left) // _COARSE_MATCHES)
    return replace(problem, left=problem.left[::step], right=problem.right[::step])


def _random_starts(seed: int) -> list[Matrix]:
    rng = np.random.default_rng(seed)
    return [np.append(rng.normal(0.0, _PRIOR_ANGLE, 5), rng.uniform(-1.0, 1.0)) for _ in range(_RANDOM_RESTARTS)]


def _search(free_focal: _Problem, fixed_focal: _Problem, seed: int) -> tuple[_Problem, _Solution]:
    """From zero with nine focal lengths; then at random; then with alpha' = 0 fixed (paper 2.2)."""
    grid = [np.array([0.0, 0.0, 0.0, 0.0, 0.0, alpha]) for alpha in _FOCAL_STARTS]
    for starts in (grid, _random_starts(seed)):
        coarse = _best(_coarse(free_focal), starts)
        solution = _best(free_focal, [coarse.unknowns]) if coarse else None
        if solution is not None:
            return free_focal, solution
    return fixed_focal, fixed_focal.solve(np.zeros(6))


def _sigma(problem: _Problem, solution: _Solution, gradient: Matrix) -> float:
    """Standard deviation of a linear function of the unknowns, by what the fit leaves of the tie points."""
    normal = solution.jacobian.T @ solution.jacobian
    noise = float(np.sqrt(solution.cost / max(len(problem.left) - len(normal), 1)))
    free = gradient[problem.free]
    ridge = 1e-12 * np.trace(normal) * np.eye(len(normal))
    variance = float(free @ np.linalg.solve(normal + ridge, free))
    return noise * float(np.sqrt(max(variance, 0.0)))


def _focal_sigma(problem: _Problem, solution: _Solution, given: bool) -> float:
    """Share of the focal length; what a rig is like before any match is seen, where the matches did not tell."""
    if given:
        return 0.0
    told = _sigma(problem, solution, np.array([0, 0, 0, 0, 0, 1.0])) if problem.free[5] else np.inf
    return float(LOG3 * min(told, _PRIOR_FOCAL))


def fit_quasi_euclidean(
    left: Matrix,
    right: Matrix,
    width: int,
    height: int,
    *,
    focal_px: float | None = None,
    prior_weight: float = 1.0,
    seed: int = 0,
) -> QuasiEuclidean:
    """Fit the rectifying rotations and the focal length to tie points of a horizontal rig.

    Parameters
    ----------
    left, right : (N, 2) float64
        Matching points without outliers, px.
    width, height : int
        Size of the images, px.
    focal_px : float or None
        Known focal length, px; None: the sixth unknown.
    prior_weight : float
        How strongly parallel cameras of ordinary focal length are preferred where the matches leave it open: 1 is
        about one match's worth, 0 the bare method.
    seed : int
        Of the random restarts.

    Returns
    -------
    QuasiEuclidean

    Raises
    ------
    ValueError
        For fewer than six matches, or arrays of another shape.
    """
    if left.shape != right.shape or left.ndim != 2 or left.shape[1] != 2 or len(left) < 6:
        raise ValueError(f"left, right: expected shapes (N, 2), N >= 6, got {left.shape} and {right.shape}")
    unit, center = float(width + height), np.array([(width - 1) / 2, (height - 1) / 2])
    normal_left, normal_right = (homogeneous((np.asarray(p, np.float64) - center) / unit) for p in (left, right))
    alpha = 0.0 if focal_px is None else float(np.log(focal_px / unit) / LOG3)
    fixed_focal = _problem(normal_left, normal_right, unit, prior_weight, alpha)
    if focal_px is None:
        free_focal = _problem(normal_left, normal_right, unit, prior_weight, None)
        problem, solution = _search(free_focal, fixed_focal, seed)
    else:
        problem, solution = fixed_focal, fixed_focal.solve(np.zeros(6))
    return _in_pixels(problem, solution, unit, center, given=focal_px is not None)


def _in_pixels(problem: _Problem, solution: _Solution, unit: float, center: Matrix, *, given: bool) -> QuasiEuclidean:
    rotation_left, rotation_right = rotations(solution.unknowns)
    half = rotation_about(0, -solution.unknowns[2] / 2)  # both may turn about the baseline: share the right one's turn
    focal = float(3.0 ** solution.unknowns[5]) * unit
    to_normal = np.array([[1 / unit, 0, -center[0] / unit], [0, 1 / unit, -center[1] / unit], [0, 0, 1.0]])
    fundamental = to_normal.T @ fundamental_and_jacobian(solution.unknowns)[0] @ to_normal
    return QuasiEuclidean(
        rotation_left=half @ rotation_left,
        rotation_right=half @ rotation_right,
        focal_px=focal,
        focal_fixed=not problem.free[5],
        fundamental=fundamental / np.linalg.norm(fundamental),
        cost_px2=solution.cost * unit**2,
        infinity_sigma_px=focal * _sigma(problem, solution, np.array([1.0, 0, 0, -1.0, 0, 0])),
        focal_sigma=_focal_sigma(problem, solution, given),
    )
