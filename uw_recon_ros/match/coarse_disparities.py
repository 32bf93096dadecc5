"""A first look at a pair, small and quick: which disparities occur at all."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import ByteImage, Mask

COARSE_WIDTH = 256  #: px; the first look is taken at this width
_RADIUS_U, _RADIUS_V = 4, 3  # of the census window: 62 comparisons
_BLOCK = 9  # px, of the window that costs are summed over
_UNSEEN = 62 * _BLOCK * _BLOCK  # cost of a match outside the other view: as bad as can be
_LEAST_CONTRAST = 2.0  # gray levels, standard deviation in a block
_RIVAL = 0.75  # a match must cost less than this part of the next best ...
_APART = 2  # ... that is further than this away, px of the small images

Words = NDArray[np.uint64]
Sums = NDArray[np.uint16]


def coarse_disparities(
    left: ByteImage, right: ByteImage, at_width: int = COARSE_WIDTH
) -> tuple[NDArray[np.int32], float, int]:
    """Disparities of what matches beyond doubt at a small scale.

    Census windows (which do not mind brightness), summed over blocks, over all disparities up to half the width in
    either direction. A match counts if it is the best one seen from both views, clearly better than any other, and in
    textured surroundings.

    Parameters
    ----------
    left, right : (H, W) uint8
    at_width : int
        Of the small images, at most, px.

    Returns
    -------
    disparities : (N,) int32
        In pixels of the small images.
    scale : float
        Original pixels per pixel of these.
    textured : int
        How many pixels of the small left image could have counted.
    """
    scale = max(1.0, left.shape[1] / at_width)
    small_left, small_right = (_shrink(image, scale) for image in (left, right))
    reach = small_left.shape[1] // 2
    costs = _block_costs(_census(small_left), _census(small_right), reach)
    textured = _contrast(small_left) >= _LEAST_CONTRAST
    disparities, sure = _sure_matches(costs, reach)
    return disparities[sure & textured], scale, int(textured.sum())


def _shrink(image: ByteImage, scale: float) -> ByteImage:
    size = max(1, round(image.shape[1] / scale)), max(1, round(image.shape[0] / scale))
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8)


def _contrast(image: ByteImage) -> NDArray[np.float64]:
    values = image.astype(np.float64)
    mean = cv2.blur(values, (_BLOCK, _BLOCK))
    return np.sqrt(np.maximum(cv2.blur(values * values, (_BLOCK, _BLOCK)) - mean * mean, 0.0))


def _census(image: ByteImage) -> Words:
    """(H, W) uint64: a bit for each neighbour in the window that is darker than its centre."""
    height, width = image.shape
    padded = np.pad(image, ((_RADIUS_V, _RADIUS_V), (_RADIUS_U, _RADIUS_U)), mode="edge")
    words = np.zeros(image.shape, np.uint64)
    for v in range(2 * _RADIUS_V + 1):
        for u in range(2 * _RADIUS_U + 1):
            if (v, u) != (_RADIUS_V, _RADIUS_U):
                words = (words << np.uint64(1)) | (padded[v : v + height, u : u + width] < image)
    return words


def _block_costs(left: Words, right: Words, reach: int) -> Sums:
    """(2 reach + 1, H, W): census bits that differ in a block, disparity -reach first."""
    costs = np.full((2 * reach + 1, *left.shape), _UNSEEN, np.uint16)
    bits = np.empty(left.shape, np.uint8)
    for disparity, cost in zip(range(-reach, reach + 1), costs, strict=True):
        first, stop = max(0, disparity), left.shape[1] + min(0, disparity)
        _hamming(left, right, disparity, bits)
        cost[:, first:stop] = cv2.boxFilter(
            bits[:, first:stop], cv2.CV_16U, (_BLOCK, _BLOCK), normalize=False, borderType=cv2.BORDER_REPLICATE
        )
    return costs


@kernel
def _hamming(left: Words, right: Words, disparity: int, distance: ByteImage) -> None:
    """Bits that differ between (v, u) and (v, u - disparity), where both exist."""
    height, width = left.shape
    for v in range(height):
        for u in range(max(0, disparity), min(width, width + disparity)):
            bits = left[v, u] ^ right[v, u - disparity]
            bits -= (bits >> np.uint64(1)) & np.uint64(0x5555555555555555)
            bits = (bits & np.uint64(0x3333333333333333)) + ((bits >> np.uint64(2)) & np.uint64(0x3333333333333333))
            bits = (bits + (bits >> np.uint64(4))) & np.uint64(0x0F0F0F0F0F0F0F0F)
            distance[v, u] = (bits * np.uint64(0x0101010101010101)) >> np.uint64(56)


@kernel
def _sure_matches(costs: Sums, reach: int) -> tuple[NDArray[np.int32], Mask]:
    """Best disparity of each left pixel, and whether it has no rival and its partner points back, give or take one."""
    _, height, width = costs.shape
    disparities = np.zeros((height, width), np.int32)
    sure = np.zeros((height, width), np.bool_)
    for v in range(height):
        best, best_right = _row_winners(costs[:, v], reach)
        rival = _row_rivals(costs[:, v], reach, best)
        for u in range(width):
            disparity = best[u]
            disparities[v, u] = disparity
            clear = costs[disparity + reach, v, u] < _RIVAL * rival[u]
            sure[v, u] = clear and abs(best_right[u - disparity] - disparity) <= 1
    return disparities, sure


@kernel
def _row_winners(costs: Sums, reach: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Disparity of least cost of each left and each right pixel of a row."""
    labels, width = costs.shape
    best, best_right = np.zeros(width, np.int32), np.zeros(width, np.int32)
    least, least_right = np.full(width, _UNSEEN + 1, np.int32), np.full(width, _UNSEEN + 1, np.int32)
    for label in range(labels):
        disparity = label - reach
        for u in range(max(0, disparity), min(width, width + disparity)):
            cost = costs[label, u]
            if cost < least[u]:
                least[u], best[u] = cost, disparity
            if cost < least_right[u - disparity]:
                least_right[u - disparity], best_right[u - disparity] = cost, disparity
    return best, best_right


@kernel
def _row_rivals(costs: Sums, reach: int, best: NDArray[np.int32]) -> NDArray[np.int32]:
    """Least cost of each left pixel of a row among the disparities that are well apart from its best one."""
    labels, width = costs.shape
    rival = np.full(width, _UNSEEN, np.int32)
    for label in range(labels):
        for u in range(width):
            if abs(label - reach - best[u]) > _APART:
                rival[u] = min(rival[u], costs[label, u])
    return rival
