"""Cuts against scipy's maximum flow, moves against brute force, energy against its definition."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from uw_recon_ros.match.planes.expansion import Labelling, energy, expand
from uw_recon_ros.match.planes.min_cut import MOVE, clear, cut, make_grid
from uw_recon_ros.match.planes.refinement import MARGIN, tile_groups

UNITS = 32.0
STEPS = ((0, 1), (1, 1), (1, 0), (1, -1))


def random_grid(random: np.random.RandomState, height: int, width: int) -> tuple[object, int, int]:
    grid, row = make_grid(max(height, width)), width + 2
    nodes = row * (height + 2)
    clear(grid, nodes)
    for v in range(height):
        for u in range(width):
            i = (v + 1) * row + u + 1
            grid.excess[i] = random.randint(-30, 31)
            for direction, (dv, du) in enumerate(STEPS):
                if 0 <= v + dv < height and 0 <= u + du < width:
                    grid.arcs[direction * nodes + i] = random.randint(0, 25)
                    grid.arcs[(direction + 4) * nodes + i + dv * row + du] = random.randint(0, 25)
    return grid, nodes, row


def flow_by_scipy(grid: object, nodes: int, row: int) -> tuple[int, NDArray[np.bool_]]:
    """The greatest flow, and the nodes that still reach the sink then."""
    source, sink = nodes, nodes + 1
    arcs = []
    for direction, (dv, du) in enumerate(STEPS):
        for i in range(nodes):
            j = i + dv * row + du
            if grid.arcs[direction * nodes + i]:
                arcs.append((i, j, grid.arcs[direction * nodes + i]))
            if 0 <= j < nodes and grid.arcs[(direction + 4) * nodes + j]:
                arcs.append((j, i, grid.arcs[(direction + 4) * nodes + j]))
    for i in range(nodes):
        if grid.excess[i] > 0:
            arcs.append((source, i, grid.excess[i]))
        elif grid.excess[i] < 0:
            arcs.append((i, sink, -grid.excess[i]))
    tails, heads, capacities = (np.array(x) for x in zip(*arcs, strict=True))
    graph = coo_array((capacities.astype(np.int32), (tails, heads)), shape=(nodes + 2, nodes + 2)).tocsr()
    result = maximum_flow(graph, source, sink)
    residual = (graph - result.flow).tocsr()
    residual.data[residual.data < 0] = 0
    residual.eliminate_zeros()
    reached = breadth_first_order(residual.T.tocsr(), sink, return_predecessors=False)
    return int(result.flow_value), np.isin(np.arange(nodes), reached)


def check_cut(grid: object, nodes: int, row: int) -> NDArray[np.bool_]:
    """Cut, and compare with a flow; returns what moved."""
    before_arcs, before_excess = grid.arcs.copy(), grid.excess.copy()
    flow, must_move = flow_by_scipy(grid, nodes, row)
    assert cut(grid, nodes, row, 1 << 40)
    moved = grid.tree[:nodes] == MOVE
    cost = sum(int(e) for e, m in zip(before_excess[:nodes], moved, strict=True) if e > 0 and m)
    cost += sum(-int(e) for e, m in zip(before_excess[:nodes], moved, strict=True) if e < 0 and not m)
    for direction, (dv, du) in enumerate(STEPS):
        for i in range(nodes):
            j = i + dv * row + du
            if 0 <= j < nodes:
                cost += int(before_arcs[direction * nodes + i]) * bool(not moved[i] and moved[j])
                cost += int(before_arcs[(direction + 4) * nodes + j]) * bool(not moved[j] and moved[i])
    assert cost == flow
    assert np.array_equal(moved, must_move)  # the smallest of all minimum cuts
    return moved


@pytest.mark.parametrize("seed", range(12))
def test_cut_is_as_cheap_as_the_flow_is_large(seed: int) -> None:
    random = np.random.RandomState(seed)
    check_cut(*random_grid(random, random.randint(1, 9), random.randint(1, 9)))


@pytest.mark.parametrize("seed", range(4))
def test_demand_finds_sources_that_are_far(seed: int) -> None:
    random = np.random.RandomState(seed)
    grid, nodes, row = random_grid(random, 6, 40)
    inner = np.flatnonzero(grid.excess[:nodes])
    grid.excess[:nodes] = 0
    grid.excess[inner[inner % row < 8]] = -random.randint(10, 16)
    grid.excess[inner[inner % row > 34]] = random.randint(14, 20)
    moved = check_cut(grid, nodes, row)
    assert 0 < moved.sum() < inner.size  # a cut somewhere between


def test_cut_gives_up_where_it_is_told_to() -> None:
    needed = []
    for most in range(2000):
        grid, nodes, row = random_grid(np.random.RandomState(1), 8, 8)
        needed.append(cut(grid, nodes, row, most))
    assert not needed[10]
    assert needed[-1]
    assert sorted(needed) == needed  # the same work every time


def random_labelling(random: np.random.RandomState, height: int, width: int) -> Labelling:
    planes = np.stack(
        [random.uniform(-0.3, 0.3, (height, width)), random.uniform(-0.3, 0.3, (height, width)),
         random.uniform(0, 6, (height, width))]
    ).astype(np.float32)  # fmt: skip
    weights = random.uniform(0.05, 1, (4, height, width)).astype(np.float32)
    costs = random.uniform(0, 2, (height, width)).astype(np.float32)
    return Labelling(planes, costs, weights, np.float32(0.7), np.float32(2), np.float32(UNITS))


def total(state: Labelling) -> int:
    return sum(energy(state))


def plain_energy(state: Labelling) -> float:
    """From the formula, in real numbers."""
    _, height, width = state.planes.shape
    result = float(state.costs.sum())
    for v, u in itertools.product(range(height), range(width)):
        for direction, (dv, du) in enumerate(STEPS):
            if 0 <= v + dv < height and 0 <= u + du < width:
                f, g = state.planes[:, v, u].astype(float), state.planes[:, v + dv, u + du].astype(float)
                apart = sum(abs((f - g) @ [x, y, 1]) for x, y in ((u, v), (u + du, v + dv)))
                result += float(state.smoothness) * float(state.weights[direction, v, u]) * min(apart, 2.0)
    return result


def test_energy_is_the_formula() -> None:
    state = random_labelling(np.random.RandomState(3), 6, 7)
    terms = 6 * 7 * 5
    assert abs(total(state) / UNITS - plain_energy(state)) < terms / UNITS


def copied(state: Labelling) -> Labelling:
    return state._replace(planes=state.planes.copy(), costs=state.costs.copy())


@pytest.mark.parametrize("seed", range(10))
def test_expansion_is_the_best_of_all_choices(seed: int) -> None:
    random = np.random.RandomState(seed)
    height, width = 5, 6
    state = random_labelling(random, height, width)
    top, bottom, left, right = 1, 4, 1, 4  # nine pixels, surrounded by others that stay
    a, b, c = np.float32(0.1), np.float32(-0.1), np.float32(2.5)
    cost = random.uniform(0, 2, (8, 8)).astype(np.float32)
    best = total(state)
    for choice in itertools.product((False, True), repeat=9):
        tried = copied(state)
        for n, taken in enumerate(choice):
            v, u = top + n // 3, left + n % 3
            if taken:
                tried.planes[:, v, u] = a, b, c
                tried.costs[v, u] = cost[v - top, u - left]
        best = min(best, total(tried))
    expand(a, b, c, top, bottom, left, right, cost, state, make_grid(8))
    # rounding may break the triangle inequality by a unit a pair
    assert best <= total(state) <= best + 12


def test_moves_never_raise_the_energy() -> None:
    random = np.random.RandomState(7)
    state, grid = random_labelling(random, 24, 30), make_grid(16)
    before = total(state)
    for _ in range(60):
        top, left = random.randint(0, 9), random.randint(0, 15)
        cost = random.uniform(0, 2, (16, 16)).astype(np.float32)
        a, b, c = (np.float32(x) for x in (random.uniform(-0.3, 0.3), random.uniform(-0.3, 0.3), random.uniform(0, 6)))
        expand(a, b, c, top, top + 15, left, left + 15, cost, state, grid)
        after = total(state)
        assert after <= before
        before = after
    assert after < total(random_labelling(np.random.RandomState(7), 24, 30)) - 100


@pytest.mark.parametrize(("height", "width"), [(1, 1), (23, 60), (100, 131), (97, 25)])
@pytest.mark.parametrize("shift", [0, 12])
def test_tiles_cover_everything_and_never_meet(height: int, width: int, shift: int) -> None:
    covered: NDArray[np.int64] = np.zeros((height, width), np.int64)
    for group in tile_groups(height, width, shift):
        touched = np.zeros((height, width), bool)
        for top, bottom, left, right in group:
            covered[top:bottom, left:right] += 1
            reach = MARGIN + 1
            region = np.s_[max(0, top - reach) : bottom + reach, max(0, left - reach) : right + reach]
            assert not touched[region].any()
            touched[region] = True
    assert (covered == 1).all()
