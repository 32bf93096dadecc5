"""The fundamental matrix of given matches, and what it says about a rig."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.rectify.sampson import homogeneous, sampson_distance
from uw_recon_ros.types import Matrix

_CONFIDENCE = 0.9999
_ITERATIONS = 10_000
_MINIMUM = 8  # matches that fix a fundamental matrix linearly
_REFITS = 5
_ROUNDS = 10  # consensus searches, the cheapest wins: one alone depends on luck


def _conditioner(points: Matrix) -> Matrix:
    """Similarity that moves points to mean 0 and rms distance sqrt(2) (Hartley 1997)."""
    mean = points.mean(axis=0)
    scale = np.sqrt(2.0) / max(np.sqrt(np.square(points - mean).sum(axis=1).mean()), 1e-12)
    return np.array([[scale, 0, -scale * mean[0]], [0, scale, -scale * mean[1]], [0, 0, 1.0]])


def _linear(left: Matrix, right: Matrix, weights: Matrix) -> Matrix:
    """Weighted eight-point algorithm on conditioned homogeneous points; rank 2."""
    design = (right[:, :, None] * left[:, None, :]).reshape(-1, 9) * weights[:, None]
    u, s, vt = np.linalg.svd(np.linalg.eigh(design.T @ design)[1][:, 0].reshape(3, 3))
    matrix: Matrix = u @ np.diag([s[0], s[1], 0.0]) @ vt
    return matrix


def fit_fundamental(left: Matrix, right: Matrix, iterations: int = 5) -> Matrix:
    """Fundamental matrix of matches without outliers: eight points, reweighted towards the Sampson error.

    Parameters
    ----------
    left, right : (N, 2) float64
        At least 8 matches, px.

    Returns
    -------
    (3, 3) float64
        ``x_right^T F x_left = 0``, rank 2, Frobenius norm 1.

    Raises
    ------
    ValueError
        For fewer than 8 matches.
    """
    if len(left) < _MINIMUM:
        raise ValueError(f"left, right: expected at least {_MINIMUM} matches, got {len(left)}")
    to_left, to_right = _conditioner(left), _conditioner(right)
    normal_left, normal_right = homogeneous(left) @ to_left.T, homogeneous(right) @ to_right.T
    weights = np.ones(len(left))
    for _ in range(iterations):
        matrix = _linear(normal_left, normal_right, weights)
        gradient = np.square((normal_left @ matrix.T)[:, :2]).sum(axis=1)
        gradient += np.square((normal_right @ matrix)[:, :2]).sum(axis=1)
        weights = 1 / np.sqrt(np.maximum(gradient, 1e-12))
    fundamental = to_right.T @ matrix @ to_left
    normalised: Matrix = fundamental / np.linalg.norm(fundamental)
    return normalised


def _consensus(left: Matrix, right: Matrix, threshold_px: float, seed: int) -> NDArray[np.bool_]:
    """Inliers of the best of many random samples (MAGSAC, seeded)."""
    settings = cv2.UsacParams()
    settings.threshold = threshold_px
    settings.confidence = _CONFIDENCE
    settings.maxIterations = _ITERATIONS
    settings.randomGeneratorState = seed
    settings.score = cv2.SCORE_METHOD_MAGSAC
    settings.sampler = cv2.SAMPLING_UNIFORM
    settings.loMethod = cv2.LOCAL_OPTIM_SIGMA
    try:
        _, mask = cv2.findFundamentalMat(left, right, settings)
    except cv2.error:  # OpenCV 5 asserts instead of giving up where no sample gives a model
        mask = None
    return np.zeros(len(left), bool) if mask is None else mask.ravel().astype(bool)


def _settled(
    left: Matrix, right: Matrix, inside: NDArray[np.bool_], threshold_px: float
) -> tuple[float, NDArray[np.bool_]]:
    """Refit to all inliers a few times, a sample's geometry being noisy; cost (MSAC, px^2) and final inliers."""
    distance = np.full(len(left), np.inf)
    for _ in range(_REFITS):
        if inside.sum() < _MINIMUM:
            return np.inf, np.zeros(len(left), bool)
        distance = sampson_distance(fit_fundamental(left[inside], right[inside]), left, right)
        inside = np.abs(distance) < threshold_px
    return float(np.minimum(np.square(distance), threshold_px**2).sum()), inside


def robust_inliers(left: Matrix, right: Matrix, threshold_px: float, seed: int) -> NDArray[np.bool_]:
    """Which matches one epipolar geometry explains.

    Parameters
    ----------
    left, right : (N, 2) float64
        Matches with outliers, px.
    threshold_px : float
        Sampson distance at which a match becomes an outlier, px.
    seed : int

    Returns
    -------
    (N,) bool
        All false where nothing was found.
    """
    if len(left) < _MINIMUM:
        return np.zeros(len(left), bool)
    rounds = [
        _settled(left, right, _consensus(left, right, threshold_px, seed + k), threshold_px) for k in range(_ROUNDS)
    ]
    return min(rounds, key=lambda found: found[0])[1]


def epipoles(fundamental: Matrix) -> tuple[Matrix, Matrix]:
    """Homogeneous epipoles in the left and the right image: where each camera would see the other."""
    u, _, vt = np.linalg.svd(fundamental)
    return vt[2], u[:, 2]


def epipole_inside(epipole: Matrix, width: int, height: int) -> bool:
    """Whether a homogeneous epipole lies within an image: the camera moved forward."""
    if abs(epipole[2]) * max(width, height) * 1e3 <= np.linalg.norm(epipole[:2]):
        return False
    u, v = epipole[:2] / epipole[2]
    return bool(-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5)
