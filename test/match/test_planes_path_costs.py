"""Paths of the semi-global aggregation against their definition (Hirschmueller, 2008), written down plainly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from uw_recon_ros.match.planes.path_costs import JUMP, STEP, Paths, extend_row

HEIGHT, WIDTH = 5, 7
PREDECESSORS = (0, -1), (-1, -1), (-1, 0), (-1, 1)
Ints = NDArray[np.int64]


def beyond_of_path(costs: Ints, jumps: Ints, first: Ints, step: tuple[int, int]) -> Ints:
    """What the path that arrives from `step` costs beyond the least of the pixel before, (H, W, labels).

    A label k of a pixel is the disparity ``first + k``. Where a jump costs more than a byte holds, all labels take it.
    """
    beyond, path = np.zeros_like(costs), np.zeros_like(costs)
    for v in range(HEIGHT):
        for u in range(WIDTH) if step[1] <= 0 else reversed(range(WIDTH)):
            at = v + step[0], u + step[1]
            inside = 0 <= at[0] < HEIGHT and 0 <= at[1] < WIDTH
            before = path[at] if inside else np.zeros(costs.shape[2], np.int64)
            apart = first[v, u] - first[at] if inside else 0
            for k in range(costs.shape[2]):
                ways = [before.min() + jumps[v, u]]
                steps = (k + apart, 0), (k + apart - 1, STEP), (k + apart + 1, STEP)
                ways += [before[n] + cost for n, cost in steps if 0 <= n < costs.shape[2] and ways[0] < 256]
                beyond[v, u, k] = min(ways) - before.min()
            path[v, u] = beyond[v, u] + costs[v, u]
    return beyond


def half_up(sums: Ints) -> Ints:
    """Rounded up."""
    return (sums + 1) // 2


@pytest.mark.parametrize("backward", [False, True])
@pytest.mark.parametrize(("labels", "spread"), [(1, 0), (5, 0), (32, 0), (33, 0), (70, 0), (5, 9), (32, 3), (32, 80)])
def test_paths_cost_what_their_definition_says(labels: int, spread: int, backward: bool) -> None:
    """First half the sum of four paths; then, where another has been left, the totals and their least."""
    random = np.random.default_rng(labels)
    costs = random.integers(0, 76, (HEIGHT, WIDTH, labels))
    jumps = random.integers(STEP + STEP // 2, JUMP + 1, (4, HEIGHT, WIDTH))
    first = random.integers(0, spread + 1, (HEIGHT, WIDTH))
    turn = (slice(None, None, -1),) * 2 if backward else (slice(None),) * 2
    paths = [
        beyond_of_path(costs[turn], j[turn], first[turn], step)[turn]
        for j, step in zip(jumps, PREDECESSORS, strict=True)
    ]
    half_sum = np.minimum(half_up(paths[0]) + half_up(paths[1] + paths[3]) + half_up(paths[2]), 255)

    flat, penalties = costs.astype(np.uint8).ravel(), jumps.astype(np.uint8)
    left_before = random.integers(0, 256, costs.shape)
    sums, totals = np.empty(flat.size, np.uint8), np.empty((HEIGHT, WIDTH * labels), np.int16)
    least = np.empty((HEIGHT, WIDTH), np.int16)
    for second in (False, True):
        kept = Paths.begin(WIDTH, labels, alike=spread == 0)
        if second:
            sums[:] = left_before.ravel()
        for i in range(HEIGHT):
            v = HEIGHT - 1 - i if backward else i
            extend_row(
                flat, penalties, first.astype(np.int16), v, backward, second, i & 1, kept, sums, totals[v], least[v]
            )
        if not second:
            np.testing.assert_array_equal(sums.reshape(costs.shape), half_sum)
    expected = half_sum + left_before + 4 * costs
    np.testing.assert_array_equal(totals.reshape(costs.shape), expected)
    np.testing.assert_array_equal(least, expected.min(axis=2))
