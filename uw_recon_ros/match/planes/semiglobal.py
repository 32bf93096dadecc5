"""Semi-global aggregation (Hirschmueller, 2008) along eight paths: where the moves start from."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.census import Words, census_words
from uw_recon_ros.match.planes.cost_volume import Volume, fill_costs
from uw_recon_ros.match.planes.gray import LEVELS, MOST, Gray
from uw_recon_ros.match.planes.thread_pool import row_bands, run_parallel
from uw_recon_ros.types import ByteImage, FloatImage

STEP, JUMP = 80, 320  #: penalties of a disparity step of one, and of any larger one
EDGE = 16  #: gray-level difference that halves the penalty of a jump
_UNREACHED = 8000

Sums = NDArray[np.int16]
Indices = NDArray[np.int16]


class Paths(NamedTuple):
    """What one direction of scanning remembers from row to row.

    Parameters
    ----------
    costs : (2, 3, W + 2, labels + 2) int16
        Of the paths that arrive from the last row, and of those that leave this one; rows take turns.
    least : (2, 3, W + 2) int16
        The least of these.
    along : (2, labels + 2) int16
        Of the path along the row.
    added : (labels,) uint8
        By the second half's paths, at a pixel.
    totals : (W labels,) int16
        Of a row: the sums of all paths.
    best_right, label_right : (W,) int16, int32
        See `_winners`.
    """

    costs: Sums
    least: Sums
    along: Sums
    added: Volume
    totals: Sums
    best_right: Sums
    label_right: NDArray[np.int32]

    @classmethod
    def begin(cls, width: int, labels: int) -> Paths:
        """Before the first row."""
        costs, along = np.zeros((2, 3, width + 2, labels + 2), np.int16), np.zeros((2, labels + 2), np.int16)
        for edge in (0, labels + 1):
            costs[..., edge] = along[:, edge] = _UNREACHED
        least, added = np.zeros((2, 3, width + 2), np.int16), np.empty(labels, np.uint8)
        best, label = np.empty(width, np.int16), np.empty(width, np.int32)
        return cls(costs, least, along, added, np.empty(width * labels, np.int16), best, label)


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
    penalties = np.full((2, 4, *gray.shape), JUMP, np.int16)
    apart = np.arange(2 * MOST // LEVELS + 2)
    table = np.maximum(JUMP * EDGE // (EDGE + apart), STEP + STEP // 2).astype(np.int16)
    _fill_penalties(gray // np.int16(LEVELS), table, penalties[0], penalties[1])
    return penalties


@kernel(allocates=False)
def _fill_penalties(
    levels: Gray, table: NDArray[np.int16], forward: NDArray[np.int16], backward: NDArray[np.int16]
) -> None:
    """From a pixel to its four predecessors and back the difference is the same."""
    height, width = levels.shape
    for v in range(height):
        for u in range(width):
            here = levels[v, u]
            if u > 0:
                forward[0, v, u] = backward[0, v, u - 1] = table[abs(here - levels[v, u - 1])]
            if v == 0:
                continue
            if u > 0:
                forward[1, v, u] = backward[1, v - 1, u - 1] = table[abs(here - levels[v - 1, u - 1])]
            forward[2, v, u] = backward[2, v - 1, u] = table[abs(here - levels[v - 1, u])]
            if u < width - 1:
                forward[3, v, u] = backward[3, v - 1, u + 1] = table[abs(here - levels[v - 1, u + 1])]


@kernel(allocates=False)
def aggregate(
    costs: Volume,
    penalties: NDArray[np.int16],
    low: int,
    labels: int,
    backward: bool,
    second: bool,
    paths: Paths,
    sums: Volume,
    disparity: FloatImage,
    right: FloatImage,
) -> None:
    """Extend four paths that arrive from above (backward: from below) over one half of the rows.

    What the first half's cost is written into `sums`. The second half's is added to what the paths of the other
    direction have left there, and each row that is complete then names its winners. So the sums are written and read
    once, and take a byte a voxel (four paths' costs beyond the match, see `_in_units`): moving them takes the time.
    """
    height, width = penalties.shape[1], penalties.shape[2]
    half = height - height // 2 if backward else height // 2
    beside, here = paths.along[0], paths.along[1]
    for i in range(half if second else 0, height if second else half):
        v = height - 1 - i if backward else i
        before, now = paths.costs[i & 1], paths.costs[1 - (i & 1)]
        least_before, least_now = paths.least[i & 1], paths.least[1 - (i & 1)]
        beside[1 : labels + 1] = 0
        below_beside = np.int16(0)
        for j in range(width):
            u = width - 1 - j if backward else j
            at = (v * width + u) * labels
            voxels, first = costs[at : at + labels], sums[at : at + labels]
            total = paths.added if second else first
            total[:] = 0
            jump = np.int16(penalties[0, v, u] + below_beside)
            below_beside = _extend(voxels, beside, below_beside, jump, here, total)
            beside, here = here, beside
            for p in range(3):
                below = least_before[p, j + p]
                jump = np.int16(penalties[1 + p, v, u] + below)
                least_now[p, j + 1] = _extend(voxels, before[p, j + p], below, jump, now[p, j + 1], total)
            if second:
                _join(voxels, first, total, paths.totals[u * labels : (u + 1) * labels])
        if second:
            _winners(paths.totals, low, labels, paths.best_right, paths.label_right, disparity[v], right[v])


@kernel(allocates=False)
def _extend(costs: Volume, before: Sums, below: np.int16, jump: np.int16, now: Sums, total: Volume) -> np.int16:
    """Path costs of one pixel from those of its predecessor, whose least is `below`; returns their least."""
    least: np.int16 = np.int16(_UNREACHED)
    step = np.int16(STEP)
    for k in range(costs.size):
        neighbours = np.int16(min(before[k], before[k + 2]) + step)
        best = min(min(before[k + 1], jump), neighbours)
        beyond = np.int16(best - below)
        total[k] = np.uint8(
            total[k] + np.uint8(np.int16(np.int16(beyond * np.int16(50)) + np.int16(128)) >> np.int16(8))
        )
        best = np.int16(beyond + np.int16(costs[k]))
        now[k + 1] = best
        least = min(least, best)
    return least


@kernel(allocates=False)
def _in_units(beyond: np.int16) -> np.uint8:
    """What a path costs beyond the match, at most `JUMP`, in units of 256 / 50."""
    units: np.uint8 = np.uint8(np.int16(np.int16(beyond * np.int16(50)) + np.int16(128)) >> np.int16(8))
    return units


@kernel(allocates=False)
def _join(costs: Volume, first: Volume, second: Volume, total: Sums) -> None:
    """The costs of all eight paths through one pixel, each with that of the match, in a 16th of those units."""
    for k in range(costs.size):
        beyond = np.int16(np.int16(first[k]) + np.int16(second[k]))
        total[k] = np.int16(np.int16(beyond << np.int16(4)) + np.int16(np.int16(costs[k]) * np.int16(25)))


@kernel(allocates=False)
def _winners(
    sums: Sums,
    low: int,
    labels: int,
    best_right: Sums,
    label_right: NDArray[np.int32],
    disparity: FloatImage,
    right: FloatImage,
) -> None:
    """Take the best label of every pixel of a row of either view; of labels as good the first.

    `best_right` and `label_right` run from right to left, so that rising disparities lie side by side in memory.
    """
    width = disparity.size
    best_right[:] = 32767
    for u in range(width):
        costs = sums[u * labels : (u + 1) * labels]
        least = np.int16(32767)
        for k in range(labels):
            least = min(least, costs[k])
        best = np.int32(labels)
        for k in range(labels):
            best = min(best, np.int32(k) if costs[k] == least else np.int32(labels))
        start, stop = max(0, u - low - width + 1), min(labels, u - low + 1)
        if stop > start:
            x, n = width - 1 - u + low + start, stop - start
            _better(costs[start:stop], start, best_right[x : x + n], label_right[x : x + n])
        offset = np.float32(0)
        if 0 < best < labels - 1:
            before, after = np.float32(costs[best - 1] - least), np.float32(costs[best + 1] - least)
            rise = before + after
            if rise > 0:
                offset = np.float32(0.5) * (before - after) / rise
        disparity[u] = np.float32(low + best) + offset
    for u in range(width):
        x = width - 1 - u
        right[u] = np.float32(low + label_right[x]) if best_right[x] < 32767 else np.float32(np.nan)


@kernel(allocates=False)
def _better(costs: Sums, first: int, best: Sums, label: NDArray[np.int32]) -> None:
    """Take what costs less than the best so far."""
    for k in range(costs.size):
        label[k] = np.int32(first + k) if costs[k] < best[k] else label[k]
        best[k] = min(costs[k], best[k])


def _volume(
    words: Words, left: ByteImage, right: ByteImage, low: int, labels: int, parts: list[tuple[int, int]], threads: int
) -> Volume:
    """Costs of all matches, averaged over 3x3 pixels."""
    height, width = words.shape[1:]
    mirrored, mirrored_color = np.ascontiguousarray(words[1, :, ::-1]), np.ascontiguousarray(right[:, :, ::-1])
    costs = np.empty(height * width * labels, np.uint8)
    run_parallel(lambda b: fill_costs(words[0], mirrored, left, mirrored_color, low, labels, *b, costs), parts, threads)
    return costs


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
    sums = np.empty(costs.size, np.uint8)
    paths = Paths.begin(width, labels), Paths.begin(width, labels)
    start = Start(*(np.empty((height, width), np.float32) for _ in range(2)))

    def scan(backward: int, second: bool) -> None:
        aggregate(costs, penalties[backward], low, labels, backward == 1, second, paths[backward], sums, *start)

    for second in (False, True):
        run_parallel(partial(scan, second=second), (0, 1), min(threads, 2))
    return start
