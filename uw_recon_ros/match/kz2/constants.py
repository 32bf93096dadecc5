"""What an occlusion and a disparity step cost in the reference energy: from the images, as fractions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.kz2.data_cost import CUT, Costs, IntervalImage, row_costs

LARGEST_DENOMINATOR = 16
SMALLEST_OCCLUSION_COST = 1.0  #: where nothing differs from anything, a match must still be worth something


@dataclass(frozen=True)
class Constants:
    """The constants of the energy, all multiplied by `denominator`, so that every term is an integer.

    Parameters
    ----------
    denominator : int
        1 to 16.
    occlusion_cost : int
        The paper's K.
    smoothness : int
        Lambda_1: of a disparity step where neither view shows an edge.
    smoothness_at_edge : int
        Lambda_2: of one at an edge.
    """

    denominator: int
    occlusion_cost: int
    smoothness: int
    smoothness_at_edge: int


def make_constants(occlusion_cost: float, smoothness: float) -> Constants:
    """Fractions for K, lambda_1 = 3 lambda and lambda_2 = lambda with one denominator.

    Parameters
    ----------
    occlusion_cost, smoothness : float
        K and lambda, squared gray levels, positive.

    Returns
    -------
    Constants
        With the denominator up to 16 that makes the sum of the three relative errors least.
    """
    wanted = np.array([occlusion_cost, 3 * smoothness, smoothness])
    denominators = np.arange(1, LARGEST_DENOMINATOR + 1)[:, None]
    numerators = np.floor(denominators * wanted + 0.5)
    errors = np.abs(numerators / (denominators * wanted) - 1).sum(axis=1)
    best = int(np.argmin(errors))
    return Constants(best + 1, *(int(value) for value in numerators[best]))


def automatic_occlusion_cost(
    left: IntervalImage, right: IntervalImage, min_disparity: int, max_disparity: int
) -> float:
    """K: the mean over the pixels of the k-th smallest cost over the labels, k a quarter of the labels.

    Only pixels that have a partner for the most labels count (all labels, unless the range is wider than the image).

    Parameters
    ----------
    left, right : IntervalImage
    min_disparity, max_disparity : int
        Inclusive, px.

    Returns
    -------
    float
        Squared gray levels, at least `SMALLEST_OCCLUSION_COST`.
    """
    height, width = left.smooth.shape
    columns = np.arange(width)
    seen = np.minimum(columns, max_disparity) - np.maximum(columns - width + 1, min_disparity) + 1
    most = int(seen.max(initial=0))
    if most <= 0 or height == 0:
        return SMALLEST_OCCLUSION_COST
    counted = np.flatnonzero(seen == most)
    total = _sum_of_kth(left, right, min_disparity, max_disparity, max(1, (most + 2) // 4), counted)
    return max(float(total / (counted.size * height)), SMALLEST_OCCLUSION_COST)


@kernel
def _sum_of_kth(
    left: IntervalImage,
    right: IntervalImage,
    min_disparity: int,
    max_disparity: int,
    k: int,
    columns: NDArray[np.int64],
) -> int:
    """Sum of the k-th smallest costs over the pixels in `columns`."""
    height, width = left.smooth.shape
    costs = np.full((max_disparity - min_disparity + 1, width), CUT * CUT + 1, np.int16)
    total = 0
    for row in range(height):
        for index in range(costs.shape[0]):
            disparity = min_disparity + index
            start, stop = max(0, disparity), min(width, width + disparity)
            if start < stop:
                row_costs(left, right, row, start, disparity, costs[index, start:stop])
        smallest = _kth_smallest(costs, k)
        for column in columns:
            total += smallest[column]
    return total


@kernel
def _kth_smallest(costs: Costs, k: int) -> Costs:
    """Of each column, by bisection: the counting passes run along rows, where the compiler vectorises."""
    width = costs.shape[1]
    low, high = np.zeros(width, np.int16), np.full(width, CUT * CUT + 1, np.int16)
    for _ in range(10):  # 2^10 > CUT^2 + 1
        middle = (low + high) >> np.int16(1)
        count = np.zeros(width, np.int16)
        for index in range(costs.shape[0]):
            for column in range(width):
                count[column] += np.int16(costs[index, column] <= middle[column])
        for column in range(width):
            if count[column] >= k:
                high[column] = middle[column]
            else:
                low[column] = middle[column] + 1
    return high
