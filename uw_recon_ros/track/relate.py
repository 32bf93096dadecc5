"""How two frames lie to each other: matches, P3P in RANSAC, then Gauss-Newton with both ends' covariance."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.track.keypoints import Keypoints, RigError, constants, points_of, thinned
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.types import Matrix, StereoGeometry

_RANSAC_PX, _RANSAC_TURNS = 2.5, 300
_GATE = 11.3  # chi2 of 3, 99 %
_ROUNDS = 6
_APART_PX = 12.0  # from the place a relation predicts: the match of another one
_SHARED = 2.5  # measured: neighbouring key points have the matcher's errors in common
_KEPT = 200  # matches that stay with a relation
_RIVAL_KEYPOINTS, _RIVAL_SIMILARITY = 700, 0.9
_LEAST_RIVAL = 10  # inliers; fewer are chance
_CLEARLY = 0.33  # how much nearer to the guess the relation has to be than its rival
_FAR_SHARE, _WEAK_SHARE = 0.1, 0.3  # of the depth, of the usual inliers

Pairs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class KeyPointMatches:
    """Places that two frames show both.

    Parameters
    ----------
    first, second : (M, 3) float64
        u, v, disparity in either, px.
    sigma_first, sigma_second : (M,) float64
        Of the disparities, px.
    """

    first: Matrix
    second: Matrix
    sigma_first: Matrix
    sigma_second: Matrix

    def picked(self, which: NDArray[Any]) -> KeyPointMatches:
        """Some of them."""
        return KeyPointMatches(self.first[which], self.second[which], self.sigma_first[which], self.sigma_second[which])


@dataclass(frozen=True, eq=False)
class RelativePose:
    """Where the second frame is, seen from the first.

    Parameters
    ----------
    motion : (4, 4) float64
        first <- second, m.
    covariance : (6, 6) float64
        Of the twist on the right: ``motion exp(xi)``.
    inliers : int
    chi2 : float
        Mean square of the weighted residuals a degree of freedom; 1 is as expected.
    rival : int
        Inliers of the best other relation.
    matches : Matches or None
        What it was made from, thinned out; None for a bridge.
    """

    motion: Matrix
    covariance: Matrix
    inliers: int
    chi2: float = 1.0
    rival: int = 0
    matches: KeyPointMatches | None = None


def match_keypoints(
    first: Keypoints, second: Keypoints, ratio: float, near: tuple[Matrix, float] | None = None
) -> Pairs:
    """Mutual nearest neighbours that are clearly better than the second: (M, 2) indices.

    Parameters
    ----------
    near : ((N, 2) px, float px), optional
        Where the first frame's key points are expected in the second, and how far from there to look.
    """
    if min(len(first), len(second)) < 2:
        return np.zeros((0, 2), np.int64)
    alike = first.descriptors @ second.descriptors.T
    if near is not None:
        alike = np.where(_near(near[0], second, near[1]), alike, np.float32(-1))
    best = alike.argmax(axis=1)
    rows = np.arange(len(first))
    top = alike[rows, best]
    mutual = (alike.argmax(axis=0)[best] == rows) & (top > 0)
    alike[rows, best] = -1
    runner_up = alike.max(axis=1)
    clear = 2 - 2 * top < ratio**2 * (2 - 2 * runner_up)
    kept = np.flatnonzero(mutual & clear)
    return np.stack([kept, best[kept]], axis=1)


def _near(expected: Matrix, second: Keypoints, radius: float) -> NDArray[np.bool_]:
    """(M, N) which key points lie in a square about each expected place.

    Columns and rows on their own: the largest along an axis of two took a quarter of the whole way's time.
    """
    columns, rows = (
        np.abs(expected[:, k, None].astype(np.float32) - second.measured[:, k].astype(np.float32)) < radius
        for k in (0, 1)
    )
    return np.asarray(columns & rows, np.bool_)


def matches_of(first: Keypoints, second: Keypoints, pairs: Pairs) -> KeyPointMatches:
    """Measurements of matched key points."""
    a, b = pairs.T
    return KeyPointMatches(first.measured[a], second.measured[b], first.sigma[a], second.sigma[b])


def _p3p(matches: KeyPointMatches, geometry: StereoGeometry) -> tuple[Matrix, NDArray[np.int64]] | None:
    """Second <- first by P3P in RANSAC, and its inliers. OpenCV's RANSAC always draws the same."""
    if len(matches.first) < 6:
        return None
    points = points_of(matches.first, geometry)
    done, turn, moved, inliers = cv2.solvePnPRansac(
        points, np.ascontiguousarray(matches.second[:, :2]), geometry.intrinsics_left, None,
        iterationsCount=_RANSAC_TURNS, reprojectionError=_RANSAC_PX, confidence=0.999, flags=cv2.SOLVEPNP_AP3P,
    )  # fmt: skip
    if not done or inliers is None or len(inliers) < 6:
        return None
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = cv2.Rodrigues(turn)[0], moved.ravel()
    return (motion, np.asarray(inliers, np.int64).ravel()) if np.isfinite(motion).all() else None


def projected(points: Matrix, geometry: StereoGeometry, error: RigError) -> Matrix:
    """(N, 3) u, v, disparity of points (N, 3); NaN behind the camera."""
    fx, fy, cx, cy, fb, offset = constants(geometry, error)
    z = np.where(points[:, 2] > 1e-6, points[:, 2], np.nan)
    return np.stack([fx * points[:, 0] / z + cx, fy * points[:, 1] / z + cy, fb / z - offset], axis=1)


def expected_places(measured: Matrix, geometry: StereoGeometry, motion: Matrix) -> Matrix:
    """(N, 2) px where the second frame shows what the first measured (N, 3); far outside for what is behind it.

    `motion` is first <- second.
    """
    there = rigid.inverse(motion)
    places = projected(points_of(measured, geometry) @ there[:3, :3].T + there[:3, 3], geometry, RigError())[:, :2]
    found: Matrix = np.nan_to_num(places, nan=-1e6)
    return found


def _projection_slopes(points: Matrix, geometry: StereoGeometry, error: RigError) -> Matrix:
    """(N, 3, 3) derivatives of `projected` by the point."""
    fx, fy, _, _, fb, _ = constants(geometry, error)
    x, y, z = points.T
    zero = np.zeros_like(z)
    rows = [fx / z, zero, -fx * x / z**2, zero, fy / z, -fy * y / z**2, zero, zero, -fb / z**2]
    return np.stack(rows, axis=-1).reshape(-1, 3, 3)


@dataclass(frozen=True, eq=False)
class Linearised:
    """Residuals of matches at a motion, whitened.

    Parameters
    ----------
    residuals : (M, 3)
        Measured minus predicted u, v, disparity in the second frame, in standard deviations.
    slopes : (M, 3, 6)
        By a twist on the left of second <- first.
    rig_slopes : (M, 3, 2)
        By the disparity's offset (px) and the relative focal length.
    """

    residuals: Matrix
    slopes: Matrix
    rig_slopes: Matrix

    @property
    def squares(self) -> Matrix:
        """(M,) chi2 of 3 of each match; infinity where a point is behind the camera."""
        found: Matrix = np.nan_to_num((self.residuals**2).sum(axis=1), nan=np.inf)
        return found


def linearise(
    second_from_first: Matrix, matches: KeyPointMatches, geometry: StereoGeometry, error: RigError, sigma_px: float
) -> Linearised:
    """Residuals in u, v, d of the second frame; their covariance is the second's and the first's carried over."""
    rotation, moved = second_from_first[:3, :3], second_from_first[:3, 3]
    first = points_of(matches.first, geometry, error)
    points = first @ rotation.T + moved
    slopes = _projection_slopes(points, geometry, error)
    back = np.linalg.inv(_projection_slopes(first, geometry, error))  # of the first's point by its u, v, d
    carried = slopes @ rotation @ back
    covariance = carried * _variances(matches.sigma_first, sigma_px)[:, None, :] @ carried.transpose(0, 2, 1)
    covariance += _variances(matches.sigma_second, sigma_px)[:, :, None] * np.eye(3)
    white = np.linalg.inv(np.linalg.cholesky(covariance))
    residuals = matches.second - projected(points, geometry, error)
    by_twist = slopes @ np.concatenate([np.tile(np.eye(3), (len(points), 1, 1)), -rigid.skew(points)], axis=2)
    return Linearised(
        (white @ residuals[..., None])[..., 0], white @ by_twist, white @ _rig_slopes(first, points, slopes, rotation,
                                                                                     geometry, error),
    )  # fmt: skip


def _variances(sigma: Matrix, sigma_px: float) -> Matrix:
    floor = np.maximum(sigma, 0.05)
    return np.stack([np.full_like(sigma, sigma_px**2), np.full_like(sigma, sigma_px**2), floor**2], axis=1)


def _rig_slopes(
    first: Matrix, points: Matrix, slopes: Matrix, rotation: Matrix, geometry: StereoGeometry, error: RigError
) -> Matrix:
    """(N, 3, 2) derivatives of the predicted u, v, disparity by the rig's errors; both ends depend on them."""
    _, _, cx, cy, fb, _ = constants(geometry, error)
    by_offset = slopes @ rotation @ (-first * (first[:, 2:] / fb))[..., None]
    by_offset[:, 2, 0] -= 1.0
    seen = projected(points, geometry, error)
    at_second = np.stack([seen[:, 0] - cx, seen[:, 1] - cy, fb / points[:, 2]], axis=1) / (1 + error.focal)
    along = np.stack([np.zeros(len(first)), np.zeros(len(first)), first[:, 2]], axis=1) / (1 + error.focal)
    by_focal = slopes @ rotation @ along[..., None] + at_second[..., None]
    return np.concatenate([by_offset, by_focal], axis=2)


def huber(squares: Matrix) -> Matrix:
    """Weights (M,) that let far matches pull no harder than those at 2 standard deviations."""
    return np.minimum(1.0, 2.0 / np.sqrt(np.maximum(squares, 1e-12)))


def refine(
    second_from_first: Matrix,
    matches: KeyPointMatches,
    geometry: StereoGeometry,
    sigma_px: float,
    error: RigError | None = None,
) -> tuple[Matrix, Matrix, float]:
    """Gauss-Newton on all matches: second <- first, its covariance (twist on the left), chi2 a degree of freedom."""
    motion, rig = second_from_first, error or RigError()
    for _ in range(_ROUNDS):
        at = linearise(motion, matches, geometry, rig, sigma_px)
        weights = huber(at.squares)[:, None, None] * np.isfinite(at.squares)[:, None, None]
        slopes, residuals = np.nan_to_num(at.slopes), np.nan_to_num(at.residuals)
        normal = (slopes.transpose(0, 2, 1) @ (weights * slopes)).sum(axis=0) + 1e-9 * np.eye(6)
        step = np.linalg.solve(normal, (slopes.transpose(0, 2, 1) @ (weights * residuals[..., None])).sum(axis=0)[:, 0])
        motion = rigid.exp(step) @ motion
        if np.abs(step).max() < 1e-9:
            break
    freedom = max(3 * len(matches.first) - 6, 1)
    chi2 = float(np.minimum(at.squares, _GATE).sum() / freedom)
    return motion, np.linalg.inv(normal) * max(chi2, 1.0) * _SHARED, chi2


def _gated(motion: Matrix, matches: KeyPointMatches, geometry: StereoGeometry, sigma_px: float) -> NDArray[np.bool_]:
    return np.asarray(linearise(motion, matches, geometry, RigError(), sigma_px).squares < _GATE, np.bool_)


def relate(
    first: Keypoints,
    second: Keypoints,
    geometry: StereoGeometry,
    params: TrackParams,
    guess: Matrix | None = None,
    inliers: int | None = None,
) -> RelativePose | None:
    """Find how two frames lie to each other.

    Parameters
    ----------
    first, second : Keypoints
    geometry : StereoGeometry
    params : TrackParams
    guess : (4, 4) float64, optional
        First <- second: key points are sought near where it puts them.
    inliers : int, optional
        That it takes; None = ``params.track_inliers``.

    Returns
    -------
    RelativePose or None
        None where too few matches agree.
    """
    near = None
    if guess is not None:
        near = expected_places(first.measured, geometry, guess), params.search_px
    matches = matches_of(first, second, match_keypoints(first, second, params.match_ratio, near))
    return relation_of(matches, geometry, params, inliers)


def relation_of(
    matches: KeyPointMatches, geometry: StereoGeometry, params: TrackParams, inliers: int | None = None
) -> RelativePose | None:
    """Judge matches, however they were found: the motion that enough of them agree on; None where too few do."""
    begun = _p3p(matches, geometry)
    if begun is None:
        return None
    motion, kept, needed = begun[0], matches.picked(begun[1]), inliers or params.track_inliers
    for _ in range(2):
        motion, covariance, chi2 = refine(motion, kept, geometry, params.keypoint_sigma_px)
        kept = matches.picked(_gated(motion, matches, geometry, params.keypoint_sigma_px))
        if len(kept.first) < needed:
            return None
    thinned = kept.picked(np.arange(len(kept.first))[:: max(1, -(-len(kept.first) // _KEPT))])
    return RelativePose(rigid.inverse(motion), covariance, len(kept.first), chi2, matches=thinned)


def contradicts(found: RelativePose, guess: Matrix | None, depth_m: float, usual: Collection[int]) -> bool:
    """Whether a relation is far from the guess and weaker than usual (inliers before): on tiles, the next tile's."""
    if guess is None or not usual:
        return False
    missed = float(np.linalg.norm((guess - found.motion)[:3, 3]))
    return missed > _FAR_SHARE * depth_m and found.inliers < _WEAK_SHARE * float(np.median(list(usual)))


def rival(
    first: Keypoints, second: Keypoints, geometry: StereoGeometry, params: TrackParams, found: RelativePose
) -> tuple[int, Matrix]:
    """Inliers and motion (first <- second) of the best *other* relation: on a floor that repeats itself it has about as
    many; zero and `found` where there is none.

    Every key point may match those that look nearly as alike as its best, where `found` does not put it.
    """
    expected = expected_places(first.measured, geometry, found.motion)
    alike = first.descriptors @ second.descriptors.T
    alike[_near(expected, second, _APART_PX)] = -1
    best = alike.argmax(axis=1)
    rows = np.arange(len(first))
    good = np.flatnonzero((alike[rows, best] > _RIVAL_SIMILARITY) & (alike.argmax(axis=0)[best] == rows))
    matches = matches_of(first, second, np.stack([good, best[good]], axis=1))
    begun = _p3p(matches, geometry)
    if begun is None:
        return 0, found.motion
    motion, _, _ = refine(begun[0], matches.picked(begun[1]), geometry, params.keypoint_sigma_px)
    inliers = int(_gated(motion, matches, geometry, params.keypoint_sigma_px).sum())
    return inliers, rigid.inverse(motion)


def is_ambiguous(
    first: Keypoints,
    second: Keypoints,
    geometry: StereoGeometry,
    params: TrackParams,
    found: RelativePose,
    guess: Matrix | None = None,
) -> bool:
    """Whether another relation explains about as many key points, and no guess is clearly nearer to the one found."""
    few = thinned(first, _RIVAL_KEYPOINTS), thinned(second, _RIVAL_KEYPOINTS)
    inliers, other = rival(*few, geometry, params, found)
    if inliers < max(params.rival_share * found.inliers * len(few[0]) / max(len(first), 1), _LEAST_RIVAL):
        return False
    if guess is None:
        return True
    missed = np.linalg.norm((guess - found.motion)[:3, 3])
    return bool(missed > _CLEARLY * np.linalg.norm((guess - other)[:3, 3]))
