"""The cost volume of the start: census and colour at whole disparities, one byte a voxel, label fastest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.census import Words
from uw_recon_ros.match.planes.search_band import Band, Labels
from uw_recon_ros.types import ByteImage

Volume = NDArray[np.uint8]
CENSUS_WEIGHT = 1  #: cost of one differing comparison
COLOR_CUT = 48  #: the sum of the three channels' differences is cut here, gray levels
COLOR_WEIGHT = 20  #: cost of a difference, 1/64
OUTSIDE = 30  #: cost of a match outside the other view: what a poor match costs


@kernel
def fill_costs(
    left: Words,
    right: Words,
    left_color: ByteImage,
    right_color: ByteImage,
    low: int,
    labels: int,
    band: Band,
    first: int,
    last: int,
    costs: Volume,
) -> None:
    """Write the costs of rows `first` to `last`, averaged over 3x3 pixels; the volume is continued at its border.

    `right` and `right_color` run from right to left, so that rising disparities lie side by side in memory. Colours
    are (C, H, W), C = 1 or 3. `costs` is flat: label k of a pixel at ``(v W + u) band.labels + k``, of disparity
    ``low + band.first[v, u] + k``.
    """
    height, width = left.shape
    n = width * labels
    written = width * band.labels
    rows, sums = np.zeros((3, n), np.uint8), np.empty(n, np.int16)
    for v in range(max(first - 1, 0), first + 1):
        needed = band.lowest[v], band.end[v]
        _row_costs(left[v], right[v], left_color[:, v], right_color[:, v], low, labels, *needed, rows[v % 3])
    for v in range(first, last):
        above, below = max(v - 1, 0), min(v + 1, height - 1)
        if below > v:
            words, needed = (left[below], right[below]), (band.lowest[below], band.end[below])
            _row_costs(*words, left_color[:, below], right_color[:, below], low, labels, *needed, rows[below % 3])
        mean = costs[v * written : (v + 1) * written]
        _mean(rows[above % 3], rows[v % 3], rows[below % 3], labels, sums, band.first[v], band.labels, mean)


@kernel(allocates=False)
def _row_costs(
    left: Words, right: Words, left_color: ByteImage, right_color: ByteImage, low: int, labels: int,
    lowest: Labels, end: Labels, costs: Volume,
) -> None:  # fmt: skip
    width = left.size
    channels = left_color.shape[0]
    weight = np.int16(COLOR_WEIGHT if channels == 3 else 3 * COLOR_WEIGHT)
    cut = np.int16(COLOR_CUT if channels == 3 else COLOR_CUT // 3)
    for u in range(width):
        begin, beyond = u * labels + int(lowest[u]), u * labels + int(end[u])
        voxels = costs[begin:beyond]
        for k in range(voxels.size):
            voxels[k] = OUTSIDE
        start, stop = max(int(lowest[u]), u - low - (width - 1)), min(int(end[u]), u - low + 1)
        if stop <= start:
            continue
        n, x = stop - start, width - 1 - u + low + start
        seen = costs[u * labels + start : u * labels + stop]
        _census_costs(left[u], right[x : x + n], seen)
        if channels == 3:
            _color_costs(left_color[:, u], right_color[:, x : x + n], weight, cut, seen)
        else:
            _gray_costs(np.int16(left_color[0, u]), right_color[0, x : x + n], weight, cut, seen)


@kernel(inline=True, allocates=False, apart=True)
def _census_costs(word: np.uint64, others: Words, costs: Volume) -> None:
    """Hamming distances; the sum of bits is the form that compilers know for a population count."""
    for k in range(others.size):
        bits = others[k] ^ word
        bits = bits - ((bits >> np.uint64(1)) & np.uint64(0x5555555555555555))
        bits = (bits & np.uint64(0x3333333333333333)) + ((bits >> np.uint64(2)) & np.uint64(0x3333333333333333))
        bits = (bits + (bits >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        costs[k] = np.uint8(((bits * np.uint64(0x0101010101010101)) >> np.uint64(56)) * np.uint64(CENSUS_WEIGHT))


@kernel(inline=True, allocates=False, apart=True)
def _color_costs(pixel: ByteImage, others: ByteImage, weight: np.int16, cut: np.int16, costs: Volume) -> None:
    red, green, blue = np.int16(pixel[0]), np.int16(pixel[1]), np.int16(pixel[2])
    reds, greens, blues = others[0], others[1], others[2]
    for k in range(costs.size):
        total = np.int16(abs(np.int16(red - np.int16(reds[k]))))
        total = np.int16(total + abs(np.int16(green - np.int16(greens[k]))))
        total = np.int16(total + abs(np.int16(blue - np.int16(blues[k]))))
        costs[k] = np.uint8(costs[k] + np.uint8(np.int16(min(total, cut) * weight) >> np.int16(6)))


@kernel(inline=True, allocates=False, apart=True)
def _gray_costs(pixel: np.int16, others: ByteImage, weight: np.int16, cut: np.int16, costs: Volume) -> None:
    for k in range(costs.size):
        total = np.int16(abs(np.int16(pixel - np.int16(others[k]))))
        costs[k] = np.uint8(costs[k] + np.uint8(np.int16(min(total, cut) * weight) >> np.int16(6)))


@kernel(inline=True, allocates=False, apart=True)
def _mean(
    above: Volume, here: Volume, below: Volume, labels: int, sums: NDArray[np.int16],
    first: Labels, wanted: int, mean: Volume,
) -> None:  # fmt: skip
    """Write the mean over 3x3 pixels of three rows: of each pixel, `wanted` labels from its first on."""
    width = here.size // labels
    for i in range(here.size):
        sums[i] = np.int16(np.int16(above[i]) + np.int16(here[i]) + np.int16(below[i]))
    for u in range(width):
        k0 = int(first[u])
        x, y, z = max(u - 1, 0) * labels + k0, u * labels + k0, min(u + 1, width - 1) * labels + k0
        left, centre, right = sums[x : x + wanted], sums[y : y + wanted], sums[z : z + wanted]
        out = mean[u * wanted : (u + 1) * wanted]
        for k in range(wanted):
            total = np.int32(np.int16(left[k] + np.int16(centre[k] + right[k])))
            out[k] = np.uint8((total * np.int32(7282)) >> np.int32(16))  # a ninth
