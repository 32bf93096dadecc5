"""Row error against lag: a rig's cameras see a point on the same rows at the same moment only.

What a left frame's points are off in the right frames around its moment goes up and down with the rig's motion, but for
the frame of the same moment, where it is always the same: the offset is where it varies least from moment to moment
(`find_row_lag`). Once it is known to a frame, what the rows of neighbouring frames are off goes with how fast the rows
move in the left camera's own images, and the ratio is what is left of the offset (`refine_row_lag`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ImageError
from uw_recon_ros.recordings.video import Video
from uw_recon_ros.types import Matrix, RawImage

Marks = list[tuple[int, int]]

_WIDTH = 320  # px, to which frames are reduced
_MOMENTS = 16  # spread over the recording
_AROUND = 9  # right frames around a moment
_FEWEST_S = 0.45  # that they reach to either side at least
_MATCHES = 25  # that make a pair of frames count
_ENOUGH = 6  # moments
_NEAR_PX = 3.0  # a feature is found again so near to its whole pixel
_REFINED_MOMENTS = 32
_REFINED_ENOUGH = 12  # pairs of frames
_RATE_S = 0.1  # before and after a frame: how fast its rows move
_MOVING_PX = 0.15  # rows that vary less from frame to frame stand still
_DEEPEST = 0.6  # of the variation elsewhere: where less is left, the rows tell


@dataclass(frozen=True)
class RowLag:
    """What the rows say of an offset.

    Parameters
    ----------
    shift_s : float
        To be added to it, at the left video's first frame.
    sigma_s : float
        In the middle of the moments looked at.
    spread_px : float
        How much the rows still vary from moment to moment, px of frames 320 px wide.
    drift, drift_sigma : float
        To be added to its drift, s a second; NaN sigma where this was not asked.
    middle_s : float
        That middle, on the left video's clock.
    """

    shift_s: float
    sigma_s: float
    spread_px: float
    drift: float = 0.0
    drift_sigma: float = float("nan")
    middle_s: float = 0.0


def find_row_lag(
    left: Video, right: Video, ours: Marks, theirs: Marks, right_of: Callable[[int], int]
) -> RowLag | None:
    """Look around the moments that an offset gives.

    Parameters
    ----------
    left, right : Video
    ours, theirs : list of (stamp, mark)
    right_of : callable
        The right clock's time of a left stamp, ns.

    Returns
    -------
    RowLag or None
        None: nothing moves, or there is too little to match.
    """
    stamps = np.array([stamp for stamp, _ in theirs], np.int64)
    within = [frame for frame in ours if stamps[0] <= right_of(frame[0]) <= stamps[-1]]
    if len(within) < _ENOUGH or len(stamps) < _AROUND:
        return None
    chosen = [within[k] for k in np.unique(np.linspace(0, len(within) - 1, _MOMENTS + 2).astype(int)[1:-1])]
    step = float(np.median(np.diff(stamps))) / 1e9
    stride = max(1, round(2 * _FEWEST_S / step / (_AROUND - 1)))
    curves = []
    for stamp, mark in chosen:
        middle = int(np.searchsorted(stamps, right_of(stamp)))
        near = [
            k for k in (middle + stride * n for n in range(-(_AROUND // 2), _AROUND // 2 + 1)) if 0 <= k < len(stamps)
        ]
        lags = np.array([(stamps[k] - right_of(stamp)) / 1e9 for k in near])
        found = _offsets(left, mark, right, [theirs[k][1] for k in near])
        curves.append((lags, found))
    return _least(curves, stride * step)


def refine_row_lag(
    left: Video, right: Video, ours: Marks, theirs: Marks, right_of: Callable[[int], int], drifts: bool
) -> RowLag | None:
    """What is left of an offset that is known to about a frame.

    Parameters
    ----------
    left, right, ours, theirs, right_of
        As in `find_row_lag`.
    drifts : bool
        Whether to look for what is left of the drift too.

    Returns
    -------
    RowLag or None
        None: rows do not move, or there is too little to match.
    """
    stamps = np.array([stamp for stamp, _ in theirs], np.int64)
    places = [n for n in range(1, len(ours) - 1) if stamps[0] <= right_of(ours[n][0]) < stamps[-1]]
    count = min(_REFINED_MOMENTS, len(places))
    chosen = sorted({round(k) for k in np.linspace(0, len(places) - 1, count).tolist()})
    found: list[tuple[float, ...]] = []
    for n in (places[k] for k in chosen):
        stamp, mark = ours[n]
        after = int(np.searchsorted(stamps, right_of(stamp), side="right"))
        near = [k for k in (after - 1, after) if 0 <= k < len(stamps)]
        (first, one), (last, other) = (ours[k] for k in _around(ours, n))
        moved = _offsets(left, one, left, [other])[0]
        rates = -moved[:2] / ((last - first) / 1e9)
        for k, offset in zip(near, _offsets(left, mark, right, [theirs[k][1] for k in near]), strict=True):
            found.append((*offset, *rates, (stamps[k] - right_of(stamp)) / 1e9, stamp / 1e9))
    return _ratio(np.array(found).reshape(-1, 8), drifts)


def _around(ours: Marks, n: int) -> tuple[int, int]:
    """Numbers of the frames about `_RATE_S` before and after one."""
    before, after = n - 1, n + 1
    while before > 0 and ours[n][0] - ours[before - 1][0] <= _RATE_S * 1e9:
        before -= 1
    while after < len(ours) - 1 and ours[after + 1][0] - ours[n][0] <= _RATE_S * 1e9:
        after += 1
    return before, after


def _ratio(seen: Matrix, drifts: bool) -> RowLag | None:
    """The time that rows (N, 8: offset across, along; rest across, along; rate across, along; lag; moment) tell."""
    seen = seen[np.isfinite(seen).all(axis=1)]
    if len(seen) < _REFINED_ENOUGH:
        return None
    axis = int(np.median(seen[:, 2]) > np.median(seen[:, 3]))
    offset, along, rate, lag = seen[:, axis], seen[:, 1 - axis], seen[:, 4 + axis], seen[:, 6]
    middle = float(seen[:, 7].mean())
    columns = [np.ones(len(seen)), along - along.mean(), -rate, -rate * (seen[:, 7] - middle)]
    design = np.stack(columns[: 3 + drifts], axis=1)
    values, kept = offset + rate * lag, np.ones(len(seen), np.bool_)
    for _ in range(4):
        if kept.sum() < _REFINED_ENOUGH:
            return None
        solution, *_ = np.linalg.lstsq(design[kept], values[kept], rcond=None)
        rest = values - design @ solution
        noise = max(_spread(rest[kept]), 0.02)
        kept = np.abs(rest) < 3 * noise
    sigmas = noise * np.sqrt(np.diag(np.linalg.pinv(design[kept].T @ design[kept])))
    shift, sigma = -float(solution[2]), float(sigmas[2])
    if not drifts:
        return RowLag(shift, sigma, noise, middle_s=middle)
    drift = -float(solution[3])
    return RowLag(shift - drift * middle, sigma, noise, drift, float(sigmas[3]), middle)


def _offsets(left: Video, mark: int, right: Video, others: list[int]) -> Matrix:
    """(N, 4): offset across and along at the middle of the image, px, and what is left over of either; NaN: unknown."""
    finder = cv2.ORB.create(nfeatures=700, edgeThreshold=12, patchSize=21, fastThreshold=7)
    found = np.full((len(others), 4), np.nan)
    try:
        mine = _Seen(left.small(mark, _WIDTH), finder)
    except ImageError:
        return found
    for row, other in enumerate(others):
        try:
            theirs = _Seen(right.small(other, _WIDTH), finder)
        except ImageError:
            continue
        found[row] = _offset(mine, theirs)
    return found


class _Seen:
    """An image and its features."""

    def __init__(self, image: RawImage, finder: Any) -> None:
        self.image = image
        self.points, self.descriptors = finder.detectAndCompute(image, None)


def _offset(mine: _Seen, theirs: _Seen) -> list[float]:
    if mine.descriptors is None or theirs.descriptors is None:
        return [np.nan] * 4
    found = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(mine.descriptors, theirs.descriptors)
    matches = [m for m in found if m.distance < 45]
    if len(matches) < _MATCHES:
        return [np.nan] * 4
    here = np.array([mine.points[m.queryIdx].pt for m in matches], np.float32)
    rough = np.array([theirs.points[m.trainIdx].pt for m in matches], np.float32)
    there, seen = _between_pixels(mine.image, theirs.image, here, rough)
    if seen.sum() < _MATCHES:
        return [np.nan] * 4
    points, moved = here[seen].astype(np.float64), (here - there)[seen].astype(np.float64)
    kept = np.all(np.abs(moved - np.median(moved, axis=0)) < 0.2 * _WIDTH, axis=1)
    fitted = [_plane(points[kept], moved[kept, axis]) for axis in (1, 0)]
    return [fitted[0][0], fitted[1][0], fitted[0][1], fitted[1][1]]


def _between_pixels(
    first: RawImage, second: RawImage, here: NDArray[np.float32], rough: NDArray[np.float32]
) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
    """Where points are in the second image, by Lucas and Kanade from a feature's whole pixel on."""
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, here, rough.copy(), winSize=(15, 15), maxLevel=0, flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    there = np.asarray(found, np.float32).reshape(-1, 2)
    return there, (np.asarray(status).ravel() == 1) & (np.abs(there - rough).max(axis=1) < _NEAR_PX)


def _plane(points: Matrix, values: Matrix) -> tuple[float, float]:
    """Value at one place, wherever the points are, and spread, of a plane through most values."""
    design = np.stack([np.ones(len(points)), *(points - _WIDTH / 2).T / _WIDTH], axis=1)
    kept = np.abs(values - np.median(values)) <= 3 * _spread(values) + 0.5
    for _ in range(3):
        if kept.sum() < _MATCHES // 2:
            return np.nan, np.nan
        solution = np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        rest = values - design @ solution
        kept = np.abs(rest) <= 2.5 * _spread(rest[kept]) + 0.2
    return float(solution[0]), _spread(rest[kept])


def _spread(values: Matrix) -> float:
    return float(1.4826 * np.median(np.abs(values - np.median(values)))) if len(values) else np.nan


def _least(curves: list[tuple[Matrix, Matrix]], step: float) -> RowLag | None:
    """Where the offsets of all moments vary least."""
    rest = np.array([np.nanmedian(found[:, 2:], axis=0) for _, found in curves if np.isfinite(found).any()])
    if len(rest) < _ENOUGH:
        return None
    axis = int(np.argmin(np.median(rest, axis=0)))  # rows, of a rig one above the other columns
    reach = (_AROUND // 2 - 0.5) * step
    grid = np.linspace(-reach, reach, 281)
    rows = np.array([_resampled(lags, found[:, axis], grid) for lags, found in curves])
    counts = np.isfinite(rows).sum(axis=0)
    usable = counts >= max(_ENOUGH, 0.6 * counts.max())
    if usable.sum() < 20:
        return None
    grid, rows = grid[usable], rows[:, usable]
    along = np.array([np.nanmedian(found[:, 1 - axis]) if np.isfinite(found).any() else np.nan for _, found in curves])
    variances = np.array([_variance(column, along) for column in rows.T])
    best = int(np.argmin(variances))
    elsewhere = float(np.median(variances))
    if best in (0, len(grid) - 1) or variances[best] > _DEEPEST**2 * elsewhere or elsewhere < _MOVING_PX**2:
        return None
    around = np.abs(grid - grid[best]) <= step
    bend, slope, _ = np.polyfit(grid[around] - grid[best], variances[around], 2)
    if bend <= 0:
        return None
    shift = grid[best] + float(np.clip(-slope / (2 * bend), -step / 2, step / 2))
    noise = float(np.sqrt(variances[best]))
    return RowLag(float(shift), noise / float(np.sqrt(bend * counts.max())), noise)


def _resampled(lags: Matrix, values: Matrix, grid: Matrix) -> NDArray[np.float64]:
    known = np.isfinite(values)
    if known.sum() < 3:
        return np.full(len(grid), np.nan)
    return np.interp(grid, lags[known], values[known], left=np.nan, right=np.nan)


def _variance(values: Matrix, along: Matrix) -> float:
    """Of what the disparity does not explain (a camera that looks a little up), without moments that went wrong."""
    known = np.isfinite(values) & np.isfinite(along)
    values, along = values[known], along[known]
    design = np.stack([np.ones(len(along)), along - along.mean()], axis=1)
    kept = np.ones(len(values), np.bool_)
    for _ in range(2):
        rest = values - design @ np.linalg.lstsq(design[kept], values[kept], rcond=None)[0]
        kept = np.abs(rest - np.median(rest)) <= 3 * _spread(rest) + 0.05
    return float(np.var(rest[kept]))
