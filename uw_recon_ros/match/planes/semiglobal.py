"""Semi-global aggregation (Hirschmueller, 2008) along eight paths: where the moves start from."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.census import Words, census_words
from uw_recon_ros.match.planes.cost_volume import Volume, fill_costs, smooth_costs
from uw_recon_ros.match.planes.gray import LEVELS, Gray
from uw_recon_ros.match.planes.threads import row_bands, run_parallel
from uw_recon_ros.types import ByteImage, FloatImage

STEP, JUMP = 80, 320  #: penalties of a disparity step of one, and of any larger one
EDGE = 16  #: gray-level difference that halves the penalty of a jump
_UNREACHED = 8000

Sums = NDArray[np.int16]
Indices = NDArray[np.int16]


class Start(NamedTuple):
    """What the aggregation found.

    Parameters
    ----------
    disparity : (H, W) float32
        Left view, px, refined below the pixel; never NaN.
    right : (H, W) float32
        Disparity of the right view, whole px; NaN where no pixel of the left view matches.
    """

    disparity: FloatImage
    right: FloatImage


def jump_penalties(gray: Gray) -> NDArray[np.int16]:
    """Penalties towards the four predecessors of either direction of scanning, (2, 4, H, W), lower across edges."""
    g = gray // np.int16(LEVELS)
    penalties = np.full((2, 4, *g.shape), JUMP, np.int16)

    def between(difference: NDArray[np.int16]) -> NDArray[np.int16]:
        lowered = np.maximum(JUMP * EDGE // (EDGE + np.abs(difference.astype(np.int32))), STEP + STEP // 2)
        return np.asarray(lowered.astype(np.int16))

    along, down = between(g[:, 1:] - g[:, :-1]), between(g[1:] - g[:-1])
    falling, rising = between(g[1:, 1:] - g[:-1, :-1]), between(g[1:, :-1] - g[:-1, 1:])
    forward, backward = penalties
    forward[0, :, 1:], forward[1, 1:, 1:], forward[2, 1:], forward[3, 1:, :-1] = along, falling, down, rising
    backward[0, :, :-1], backward[1, :-1, :-1], backward[2, :-1], backward[3, :-1, 1:] = along, falling, down, rising
    return penalties


@kernel
def aggregate(costs: Volume, penalties: NDArray[np.int16], labels: int, backward: bool, sums: Sums) -> None:
    """Sum the costs of four paths that arrive from above (backward: from below) into `sums`."""
    height, width = penalties.shape[1], penalties.shape[2]
    high = np.int16(_UNREACHED)
    before = np.zeros((3, width + 2, labels + 2), np.int16)
    now = np.zeros((3, width + 2, labels + 2), np.int16)
    for paths in (before, now):
        paths[:, :, 0] = high
        paths[:, :, labels + 1] = high
    least_before, least_now = np.zeros((3, width + 2), np.int16), np.zeros((3, width + 2), np.int16)
    beside, here = np.zeros(labels + 2, np.int16), np.zeros(labels + 2, np.int16)
    beside[0] = beside[labels + 1] = here[0] = here[labels + 1] = high
    for i in range(height):
        v = height - 1 - i if backward else i
        beside[1 : labels + 1] = 0
        least = np.int16(0)
        for j in range(width):
            u = width - 1 - j if backward else j
            at = (v * width + u) * labels
            voxels, total = costs[at : at + labels], sums[at : at + labels]
            for k in range(labels):
                total[k] = 0
            least = _extend(voxels, beside, least, np.int16(penalties[0, v, u] + least), here, total)
            beside, here = here, beside
            for p in range(3):
                below = least_before[p, j + p]
                jump = np.int16(penalties[1 + p, v, u] + below)
                least_now[p, j + 1] = _extend(voxels, before[p, j + p], below, jump, now[p, j + 1], total)
        before, now = now, before
        least_before, least_now = least_now, least_before


@kernel
def _extend(costs: Volume, before: Sums, below: np.int16, jump: np.int16, now: Sums, total: Sums) -> np.int16:
    """Path costs of one pixel from those of its predecessor, whose least is `below`; returns their least."""
    least: np.int16 = np.int16(_UNREACHED)
    step = np.int16(STEP)
    for k in range(costs.size):
        neighbours = np.int16(min(before[k], before[k + 2]) + step)
        best = min(min(before[k + 1], jump), neighbours)
        best = np.int16(np.int16(best - below) + np.int16(costs[k]))
        now[k + 1] = best
        total[k] = np.int16(total[k] + best)
        least = min(least, best)
    return least


@kernel
def winner_takes_all(
    down: Sums,
    up: Sums,
    low: int,
    labels: int,
    first: int,
    last: int,
    disparity: FloatImage,
    right: FloatImage,
) -> None:
    """Take the best label of every pixel of either view, rows `first` to `last`. Overwrites `down`."""
    width = disparity.shape[1]
    best_right = np.empty(width, np.int16)
    for v in range(first, last):
        best_right[:] = 32767
        right[v, :] = np.nan
        for u in range(width):
            at = (v * width + u) * labels
            sums, more = down[at : at + labels], up[at : at + labels]
            least = np.int16(32767)
            for k in range(labels):
                sums[k] = np.int16(sums[k] + more[k])
                least = min(least, sums[k])
            best = 0
            while sums[best] != least:
                best += 1
            for k in range(max(0, u - low - width + 1), min(labels, u - low + 1)):
                if sums[k] < best_right[u - low - k]:
                    best_right[u - low - k] = sums[k]
                    right[v, u - low - k] = np.float32(low + k)
            offset = np.float32(0)
            if 0 < best < labels - 1:
                before, after = np.float32(sums[best - 1] - least), np.float32(sums[best + 1] - least)
                rise = before + after
                if rise > 0:
                    offset = np.float32(0.5) * (before - after) / rise
            disparity[v, u] = np.float32(low + best) + offset


def _volume(
    words: Words, left: ByteImage, right: ByteImage, low: int, labels: int, parts: list[tuple[int, int]], threads: int
) -> Volume:
    """Costs of all matches, averaged over 3x3 pixels."""
    height, width = words.shape[1:]
    mirrored, mirrored_color = np.ascontiguousarray(words[1, :, ::-1]), np.ascontiguousarray(right[:, :, ::-1])
    raw = np.empty(height * width * labels, np.uint8)
    run_parallel(lambda b: fill_costs(words[0], mirrored, left, mirrored_color, low, labels, *b, raw), parts, threads)
    mean = np.empty_like(raw)
    run_parallel(lambda b: smooth_costs(raw, height, width, labels, *b, mean), parts, threads)
    return mean


def semiglobal_start(
    left: ByteImage, right: ByteImage, gray_left: Gray, gray_right: Gray, noise: float, low: int, high: int,
    threads: int,
) -> Start:  # fmt: skip
    """Match two rectified images at whole disparities from `low` to `high`, inclusive.

    Parameters
    ----------
    left, right : (C, H, W) uint8
        C = 1 or 3.
    gray_left, gray_right : (H, W) int16
        Of `gray.gray_pair`, as is `noise`.
    low, high : int
        px.
    threads : int
        At most two are used for the longest part.
    """
    height, width = gray_left.shape
    labels, parts = high - low + 1, row_bands(height, 2 * threads)
    words = np.empty((2, height, width), np.uint64)
    grays = (gray_left, gray_right)
    jobs = [(view, band) for band in parts for view in (0, 1)]
    run_parallel(lambda j: census_words(grays[j[0]], noise, *j[1], words[j[0]]), jobs, threads)
    costs = _volume(words, left, right, low, labels, parts, threads)
    penalties = jump_penalties(gray_left)
    sums = np.empty((2, costs.size), np.int16)
    run_parallel(lambda i: aggregate(costs, penalties[i], labels, i == 1, sums[i]), (0, 1), min(threads, 2))
    start = Start(*(np.empty((height, width), np.float32) for _ in range(2)))
    run_parallel(lambda b: winner_takes_all(sums[0], sums[1], low, labels, *b, *start), parts, threads)
    return start
