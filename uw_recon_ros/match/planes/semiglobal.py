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
from uw_recon_ros.match.planes.path_costs import JUMP, STEP, Bytes, Paths, Sums, extend_row
from uw_recon_ros.match.planes.search_band import Band, Labels
from uw_recon_ros.match.planes.thread_pool import row_bands, run_parallel
from uw_recon_ros.types import ByteImage, FloatImage

EDGE = 16  #: gray-level difference that halves the penalty of a jump
_NONE = 32767  # more than any cost

Indices = NDArray[np.uint16]


class Row(NamedTuple):
    """What is known of a row when its last paths have met it.

    Parameters
    ----------
    totals : (W labels,) int16
        Of `path_costs.extend_row`.
    least : (W,) int16
    best_right, label_right : (W,) int16, uint16
        See `_winners`.
    """

    totals: Sums
    least: Sums
    best_right: Sums
    label_right: Indices

    @classmethod
    def begin(cls, width: int, labels: int) -> Row:
        """Before anything is known."""
        least, best = np.empty((2, width), np.int16)
        return cls(np.empty(width * labels, np.int16), least, best, np.empty(width, np.uint16))


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


def jump_penalties(gray: Gray) -> Bytes:
    """Penalties towards the four predecessors of either direction of scanning, (2, 4, H, W), lower across edges."""
    penalties = np.full((2, 4, *gray.shape), JUMP, np.uint8)
    apart = np.arange(2 * MOST // LEVELS + 2)
    table = np.maximum(JUMP * EDGE // (EDGE + apart), STEP + STEP // 2).astype(np.uint8)
    _fill_penalties(gray // np.int16(LEVELS), table, penalties[0], penalties[1])
    return penalties


@kernel(allocates=False)
def _fill_penalties(levels: Gray, table: Bytes, forward: Bytes, backward: Bytes) -> None:
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
    penalties: Bytes,
    low: int,
    band: Band,
    backward: bool,
    second: bool,
    paths: Paths,
    row: Row,
    sums: Volume,
    disparity: FloatImage,
    right: FloatImage,
) -> None:
    """Extend four paths that arrive from above (backward: from below) over one half of the rows.

    What the first half's cost is written into `sums`. The second half's is added to what the paths of the other
    direction have left there, and each row that is complete then names its winners. So the sums are written and read
    once, and take a byte a voxel: moving them takes the time.
    """
    height = penalties.shape[1]
    half = height - height // 2 if backward else height // 2
    for i in range(half if second else 0, height if second else half):
        v = height - 1 - i if backward else i
        extend_row(costs, penalties, band.first, v, backward, second, i & 1, paths, sums, row.totals, row.least)
        if second:
            _winners(row, low, band.labels, band.first[v], disparity[v], right[v])


@kernel(allocates=False)
def _winners(row: Row, low: int, labels: int, first: Labels, disparity: FloatImage, right: FloatImage) -> None:
    """Take the best label of every pixel of a row of either view; of labels as good the first.

    `best_right` and `label_right` run from right to left, so that rising disparities lie side by side in memory.
    """
    width = disparity.size
    sums, best_right, label_right = row.totals, row.best_right, row.label_right
    best_right[:] = _NONE
    for u in range(width):
        costs, least, lowest = sums[u * labels : (u + 1) * labels], row.least[u], low + int(first[u])
        best = _first(costs, least)
        start, stop = max(0, u - lowest - width + 1), min(labels, u - lowest + 1)
        if stop > start:
            x, n = width - 1 - u + lowest + start, stop - start
            _better(costs[start:stop], int(first[u]) + start, best_right[x : x + n], label_right[x : x + n])
        offset = np.float32(0)
        if 0 < best < labels - 1:
            before, after = np.float32(costs[best - 1] - least), np.float32(costs[best + 1] - least)
            rise = before + after
            if rise > 0:
                offset = np.float32(0.5) * (before - after) / rise
        disparity[u] = np.float32(lowest + best) + offset
    for u in range(width):
        x = width - 1 - u
        right[u] = np.float32(low + label_right[x]) if best_right[x] < _NONE else np.float32(np.nan)


@kernel(inline=True, allocates=False)
def _first(costs: Sums, least: np.int16) -> int:
    """The first label that costs no more than the least."""
    best = np.uint16(costs.size)
    for k in range(costs.size):
        best = min(best, np.uint16(k) if costs[k] == least else np.uint16(_NONE))
    return int(best)


@kernel(inline=True, allocates=False, apart=True)
def _better(costs: Sums, first: int, best: Sums, label: Indices) -> None:
    """Take what costs less than the best so far."""
    for k in range(costs.size):
        label[k] = np.uint16(first + k) if costs[k] < best[k] else label[k]
        best[k] = min(costs[k], best[k])


def _volume(
    words: Words, left: ByteImage, right: ByteImage, low: int, labels: int, band: Band, parts: list[tuple[int, int]],
    threads: int,
) -> Volume:  # fmt: skip
    """Costs of all matches in the band, averaged over 3x3 pixels."""
    height, width = words.shape[1:]
    mirrored, mirrored_color = np.ascontiguousarray(words[1, :, ::-1]), np.ascontiguousarray(right[:, :, ::-1])
    costs = np.empty(height * width * band.labels, np.uint8)
    views = words[0], mirrored, left, mirrored_color
    run_parallel(lambda b: fill_costs(*views, low, labels, band, *b, costs), parts, threads)
    return costs


def semiglobal_start(
    left: ByteImage, right: ByteImage, gray_left: Gray, gray_right: Gray, noise: float, low: int, high: int,
    threads: int, guide: FloatImage | None = None,
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
    guide : (H, W) float32, optional
        Disparities, px, that the search keeps near.
    """
    height, width = gray_left.shape
    labels, parts = high - low + 1, row_bands(height, 2 * threads)
    words = np.empty((2, height, width), np.uint64)
    grays = (gray_left, gray_right)
    jobs = [(view, band) for band in parts for view in (0, 1)]
    run_parallel(lambda j: census_words(grays[j[0]], noise, *j[1], words[j[0]]), jobs, threads)
    band = Band.whole((height, width), labels) if guide is None else Band.around(guide - low, labels)
    costs = _volume(words, left, right, low, labels, band, parts, threads)
    penalties = jump_penalties(gray_left)
    sums = np.empty(costs.size, np.uint8)
    paths = [Paths.begin(width, band.labels, alike=guide is None) for _ in range(2)]
    rows = [Row.begin(width, band.labels) for _ in range(2)]
    start = Start(*(np.empty((height, width), np.float32) for _ in range(2)))

    def scan(backward: int, second: bool) -> None:
        mine = paths[backward], rows[backward]
        aggregate(costs, penalties[backward], low, band, backward == 1, second, *mine, sums, *start)

    for second in (False, True):
        run_parallel(partial(scan, second=second), (0, 1), min(threads, 2))
    return start
