"""How two frames lie to each other: matches, P3P in RANSAC, then Gauss-Newton with both ends' covariance."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.jit import kernel
from uw_recon_ros.track.keypoints import Keypoints, RigError, constants, points_of, thinned
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.types import FloatImage, Matrix, StereoGeometry

_RANSAC_PX, _RANSAC_TURNS = 2.5, 300
_GATE = 11.3  # chi2 of 3, 99 %
_ROUNDS = 6
_APART_PX = 12.0  # from the place a relation predicts: the match of another one
_SHARED = 2.5  # measured: neighbouring key points have the matcher's errors in common
_LEAST_SIGMA_PX = 0.05  # of a disparity: nobody is surer
_KEPT = 200  # matches that stay with a relation
_RIVAL_KEYPOINTS, _RIVAL_SIMILARITY = 700, 0.9
_TWIN_KEYPOINTS = 300
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

    def packed(self) -> PackedMatches:
        """For keeping, in half of the memory."""
        rows = np.column_stack([self.first, self.second, self.sigma_first, self.sigma_second])
        return PackedMatches(rows.astype(np.float32))


@dataclass(frozen=True, eq=False)
class PackedMatches:
    """Matches that are kept for long; made by `KeyPointMatches.packed`.

    Parameters
    ----------
    rows : (M, 8) float32
        u, v, disparity in either, the disparities' sigmas; px.
    """

    rows: FloatImage

    def unpacked(self) -> KeyPointMatches:
        """As they were, but for rounding."""
        rows = self.rows.astype(np.float64)
        return KeyPointMatches(rows[:, :3], rows[:, 3:6], rows[:, 6], rows[:, 7])


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
    matches : PackedMatches or None
        What it was made from, thinned out; None for a bridge.
    """

    motion: Matrix
    covariance: Matrix
    inliers: int
    chi2: float = 1.0
    rival: int = 0
    matches: PackedMatches | None = None


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
    white : (M, 3, 3)
        What px are multiplied by.
    """

    residuals: Matrix
    slopes: Matrix
    white: Matrix

    @property
    def squares(self) -> Matrix:
        """(M,) chi2 of 3 of each match; infinity where a point is behind the camera."""
        found: Matrix = np.nan_to_num((self.residuals**2).sum(axis=1), nan=np.inf)
        return found


def linearise(
    second_from_first: Matrix, matches: KeyPointMatches, geometry: StereoGeometry, error: RigError, sigma_px: float
) -> Linearised:
    """Residuals in u, v, d of the second frame; their covariance is the second's and the first's carried over."""
    count = len(matches.first)
    found = Linearised(np.empty((count, 3)), np.empty((count, 3, 6)), np.zeros((count, 3, 3)))
    lens = np.array(constants(geometry, error))
    first, second = np.ascontiguousarray(matches.first), np.ascontiguousarray(matches.second)
    _linearise(
        np.ascontiguousarray(second_from_first), first, second, np.maximum(matches.sigma_first, _LEAST_SIGMA_PX),
        np.maximum(matches.sigma_second, _LEAST_SIGMA_PX), lens, sigma_px, found.residuals, found.slopes, found.white,
    )  # fmt: skip
    return found


@kernel(allocates=False)
def _linearise(
    motion: Matrix, first: Matrix, second: Matrix, sigma_first: Matrix, sigma_second: Matrix, lens: Matrix,
    sigma_px: float, residuals: Matrix, slopes: Matrix, white: Matrix,
) -> None:  # fmt: skip
    """Match by match; NaN for a point behind the camera. Matrices of three rows are written out: many are small."""
    fx, fy, cx, cy, fb, offset = lens
    r = motion
    for n in range(len(first)):
        z1 = fb / (first[n, 2] + offset)
        x1, y1 = (first[n, 0] - cx) / fx * z1, (first[n, 1] - cy) / fy * z1
        x = r[0, 0] * x1 + r[0, 1] * y1 + r[0, 2] * z1 + r[0, 3]
        y = r[1, 0] * x1 + r[1, 1] * y1 + r[1, 2] * z1 + r[1, 3]
        z = r[2, 0] * x1 + r[2, 1] * y1 + r[2, 2] * z1 + r[2, 3]
        if not z > 1e-6:
            residuals[n] = np.nan
            slopes[n] = np.nan
            continue
        # the first's sigmas as points: columns of R times the derivatives of the point by u, v, disparity
        su, sv, sd = sigma_px * z1 / fx, sigma_px * z1 / fy, -sigma_first[n] * z1 / fb
        a = 1.0 / z
        c00 = c01 = c02 = c11 = c12 = c22 = 0.0
        for k in range(3):
            if k < 2:
                s = su if k == 0 else sv
                px, py, pz = r[0, k] * s, r[1, k] * s, r[2, k] * s
            else:
                px, py, pz = (x - r[0, 3]) * sd, (y - r[1, 3]) * sd, (z - r[2, 3]) * sd
            u, v, d = fx * a * (px - x * a * pz), fy * a * (py - y * a * pz), -fb * a * a * pz
            c00, c01, c02 = c00 + u * u, c01 + u * v, c02 + u * d
            c11, c12, c22 = c11 + v * v, c12 + v * d, c22 + d * d
        c00, c11, c22 = c00 + sigma_px * sigma_px, c11 + sigma_px * sigma_px, c22 + sigma_second[n] * sigma_second[n]
        # Cholesky's factor, and its inverse
        l00 = math.sqrt(c00)
        l10, l20 = c01 / l00, c02 / l00
        l11 = math.sqrt(c11 - l10 * l10)
        l21 = (c12 - l20 * l10) / l11
        l22 = math.sqrt(c22 - l20 * l20 - l21 * l21)
        w = white[n]
        w[0, 0], w[1, 1], w[2, 2] = 1.0 / l00, 1.0 / l11, 1.0 / l22
        w[1, 0] = -l10 * w[0, 0] * w[1, 1]
        w[2, 1] = -l21 * w[1, 1] * w[2, 2]
        w[2, 0] = -(l20 * w[0, 0] + l21 * w[1, 0]) * w[2, 2]
        missed = second[n, 0] - (fx * x * a + cx), second[n, 1] - (fy * y * a + cy), second[n, 2] - (fb * a - offset)
        rows = (
            (fx * a, 0.0, -fx * x * a * a), (0.0, fy * a, -fy * y * a * a), (0.0, 0.0, -fb * a * a),
        )  # fmt: skip
        for i in range(3):
            residuals[n, i] = w[i, 0] * missed[0] + w[i, 1] * missed[1] + w[i, 2] * missed[2]
            g0 = w[i, 0] * rows[0][0] + w[i, 1] * rows[1][0] + w[i, 2] * rows[2][0]
            g1 = w[i, 0] * rows[0][1] + w[i, 1] * rows[1][1] + w[i, 2] * rows[2][1]
            g2 = w[i, 0] * rows[0][2] + w[i, 1] * rows[1][2] + w[i, 2] * rows[2][2]
            slopes[n, i, 0], slopes[n, i, 1], slopes[n, i, 2] = g0, g1, g2
            slopes[n, i, 3], slopes[n, i, 4], slopes[n, i, 5] = g2 * y - g1 * z, g0 * z - g2 * x, g1 * x - g0 * y


def rig_slopes(
    second_from_first: Matrix, matches: KeyPointMatches, geometry: StereoGeometry, error: RigError
) -> Matrix:
    """(M, 3, 2) derivatives of the predicted u, v, disparity by the rig's offset (px) and relative focal length.

    Both ends depend on them.
    """
    rotation, first = second_from_first[:3, :3], points_of(matches.first, geometry, error)
    points = first @ rotation.T + second_from_first[:3, 3]
    slopes = _projection_slopes(points, geometry, error)
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
        weights = np.repeat(huber(at.squares) * np.isfinite(at.squares), 3)
        slopes, residuals = np.nan_to_num(at.slopes.reshape(-1, 6)), np.nan_to_num(at.residuals.ravel())
        weighted = weights[:, None] * slopes
        normal = weighted.T @ slopes + 1e-9 * np.eye(6)
        step = np.linalg.solve(normal, weighted.T @ residuals)
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
    return RelativePose(rigid.inverse(motion), covariance, len(kept.first), chi2, matches=thinned.packed())


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


def repeats_itself(keypoints: Keypoints) -> bool:
    """Whether most key points of a view look like others of it: on a tiled floor 95 % do, elsewhere under 30 %."""
    some = thinned(keypoints, _TWIN_KEYPOINTS)
    alike = some.descriptors @ some.descriptors.T
    alike[_near(some.measured[:, :2], some, _APART_PX)] = -1
    return bool((alike > _RIVAL_SIMILARITY).any(axis=1).mean() > 0.5) if len(some) else False


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
