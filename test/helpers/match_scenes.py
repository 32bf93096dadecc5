"""Small random problems, and the data cost read plainly from its definition."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.kz2.energy import OCCLUDED

STEREO = Path(__file__).parents[3] / "shared" / "data" / "stereo"


def sides(image: NDArray[np.uint8], v: int, u: int, channel: int) -> tuple[int, int]:
    """Interval of a pixel: it and the half-way values to its four neighbours."""
    height, width = image.shape[:2]
    values = [int(image[v, u, channel])]
    for dv, du in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        if 0 <= v + dv < height and 0 <= u + du < width:
            values.append((int(image[v, u, channel]) + int(image[v + dv, u + du, channel])) // 2)
    return min(values), max(values)


def cost(left: NDArray[np.uint8], right: NDArray[np.uint8], v: int, u: int, d: int) -> int:
    total = 0
    channels = left.shape[2]
    for channel in range(channels):
        p, q = int(left[v, u, channel]), int(right[v, u - d, channel])
        (p_low, p_high), (q_low, q_high) = sides(left, v, u, channel), sides(right, v, u - d, channel)
        total += min(max(0, q_low - p, p - q_high), max(0, p_low - q, q - p_high), 30) ** 2
    return total // channels


def random_labels(random: np.random.RandomState, height: int, width: int, low: int, high: int) -> NDArray[np.int16]:
    """Some labelling with unique partners."""
    labels = np.full((height, width), OCCLUDED, np.int16)
    for v in range(height):
        free = set(range(width))
        for u in random.permutation(width).tolist():
            choices = [d for d in range(low, high + 1) if u - d in free]
            if choices and random.rand() < 0.8:
                labels[v, u] = choices[random.randint(len(choices))]
                free.remove(u - int(labels[v, u]))
    return labels


def random_pair(random: np.random.RandomState, height: int, width: int, channels: int) -> list[NDArray[np.uint8]]:
    return [random.randint(0, 60, (height, width, channels)).astype(np.uint8) // 4 * 4 for _ in range(2)]
