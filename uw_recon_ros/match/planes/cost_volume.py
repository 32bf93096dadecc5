"""The cost volume of the start: census and colour at whole disparities, one byte a voxel, label fastest."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.census import Words
from uw_recon_ros.types import ByteImage

Volume = NDArray[np.uint8]
CENSUS_WEIGHT = 2  #: cost of one differing comparison
COLOR_CUT = 48  #: the sum of the three channels' differences is cut here, gray levels
COLOR_WEIGHT = 40  #: cost of a difference, 1/64
OUTSIDE = 60  #: cost of a match outside the other view: what a poor match costs


@kernel
def fill_costs(
    left: Words,
    right: Words,
    left_color: ByteImage,
    right_color: ByteImage,
    low: int,
    labels: int,
    first: int,
    last: int,
    costs: Volume,
) -> None:
    """Write the costs of rows `first` to `last`.

    `right` and `right_color` run from right to left, so that rising disparities lie side by side in memory. Colours
    are (C, H, W), C = 1 or 3. `costs` is flat: voxel (v, u, d) at ``(v W + u) labels + d - low``.
    """
    width = left.shape[1]
    channels = left_color.shape[0]
    weight = np.int16(COLOR_WEIGHT if channels == 3 else 3 * COLOR_WEIGHT)
    cut = np.int16(COLOR_CUT if channels == 3 else COLOR_CUT // 3)
    for v in range(first, last):
        for u in range(width):
            at = (v * width + u) * labels
            start, stop = max(0, u - low - (width - 1)), min(labels, u - low + 1)
            voxels = costs[at : at + labels]
            for k in range(labels):
                voxels[k] = OUTSIDE
            if stop <= start:
                continue
            n, x = stop - start, width - 1 - u + low + start
            seen = costs[at + start : at + stop]
            _census_costs(left[v, u], right[v, x : x + n], seen)
            if channels == 3:
                _color_costs(left_color[:, v, u], right_color[:, v, x : x + n], weight, cut, seen)
            else:
                _gray_costs(np.int16(left_color[0, v, u]), right_color[0, v, x : x + n], weight, cut, seen)


@kernel
def _census_costs(word: np.uint64, others: Words, costs: Volume) -> None:
    """Hamming distances; the sum of bits is the form that compilers know for a population count."""
    for k in range(others.size):
        bits = others[k] ^ word
        bits = bits - ((bits >> np.uint64(1)) & np.uint64(0x5555555555555555))
        bits = (bits & np.uint64(0x3333333333333333)) + ((bits >> np.uint64(2)) & np.uint64(0x3333333333333333))
        bits = (bits + (bits >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
        costs[k] = np.uint8(((bits * np.uint64(0x0101010101010101)) >> np.uint64(56)) * np.uint64(CENSUS_WEIGHT))


@kernel
def _color_costs(pixel: ByteImage, others: ByteImage, weight: np.int16, cut: np.int16, costs: Volume) -> None:
    red, green, blue = np.int16(pixel[0]), np.int16(pixel[1]), np.int16(pixel[2])
    reds, greens, blues = others[0], others[1], others[2]
    for k in range(costs.size):
        total = np.int16(abs(np.int16(red - np.int16(reds[k]))))
        total = np.int16(total + abs(np.int16(green - np.int16(greens[k]))))
        total = np.int16(total + abs(np.int16(blue - np.int16(blues[k]))))
        costs[k] = np.uint8(costs[k] + np.uint8(np.int16(min(total, cut) * weight) >> np.int16(6)))


@kernel
def _gray_costs(pixel: np.int16, others: ByteImage, weight: np.int16, cut: np.int16, costs: Volume) -> None:
    for k in range(costs.size):
        total = np.int16(abs(np.int16(pixel - np.int16(others[k]))))
        costs[k] = np.uint8(costs[k] + np.uint8(np.int16(min(total, cut) * weight) >> np.int16(6)))


@kernel
def smooth_costs(costs: Volume, height: int, width: int, labels: int, first: int, last: int, mean: Volume) -> None:
    """Write the mean over 3x3 pixels, rows `first` to `last`; the volume is continued at its border."""
    row = np.empty(width * labels, np.int16)
    n = width * labels
    for v in range(first, last):
        above, here, below = max(v - 1, 0) * n, v * n, min(v + 1, height - 1) * n
        a, b, c = costs[above : above + n], costs[here : here + n], costs[below : below + n]
        for i in range(n):
            row[i] = np.int16(np.int16(a[i]) + np.int16(b[i]) + np.int16(c[i]))
        for u in range(width):
            x, z = max(u - 1, 0) * labels, min(u + 1, width - 1) * labels
            left, centre, right = row[x : x + labels], row[u * labels : (u + 1) * labels], row[z : z + labels]
            out = mean[here + u * labels : here + (u + 1) * labels]
            for k in range(labels):
                total = np.int32(np.int16(left[k] + np.int16(centre[k] + right[k])))
                out[k] = np.uint8((total * np.int32(7282)) >> np.int32(16))  # a ninth
