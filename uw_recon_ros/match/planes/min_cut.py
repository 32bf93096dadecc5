"""Minimum cut on a small grid with eight neighbours: push-relabel (Goldberg and Tarjan, 1988).

The nodes that want to move are few, and most find what outweighs them a few arcs away. So it is their demand that is
passed on, from node to node towards the sources: first up to a small height without any search, then in rounds, with
exact heights from a search at the start of each. What no source can be reached from wants to move in the end, and what
it reaches moves with it: the smallest sink side of a minimum cut, whatever the order of the work. No node moves that
need not.

The graph is implicit: node i's neighbour in direction d is ``i + offset[d]``, the grid has a frame of nodes without
arcs, and all arrays are reused from cut to cut.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import uint64 as index  # unsigned indices spare the test for negative ones
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel

MOVE = 1  #: what wants to move, in `GridGraph.tree`; 0: what need not
_NEARBY = 10  # height up to which demand is passed on without a search
_DEAD = 1 << 20  # height of a node from which no source is reached: more than any way is long
_BLOCK = 256  # nodes whose demand is worked off before the next ones
_PATIENCE = 0.5  # liftings a node until heights are searched anew; as much more every round


class GridGraph(NamedTuple):
    """A graph of at most `capacity` nodes, and the memory of its search.

    Parameters
    ----------
    arcs : (8 * capacity,) int32
        Residual capacity of the arc from node i in direction d at ``d * nodes + i``.
    excess : (capacity,) int32
        Capacity from the source minus capacity to the sink; a demand if negative.
    tree : (capacity,) int8
        After `cut`: MOVE what reaches the sink.
    height : (capacity,) int32
        A lower bound of the number of arcs to a source, its own included.
    queue : (capacity + 1,) int32
        A ring: nodes whose demand is to be passed on.
    left : (capacity,) int32
        Nodes that could not get rid of theirs.
    """

    arcs: NDArray[np.int32]
    excess: NDArray[np.int32]
    tree: NDArray[np.int8]
    height: NDArray[np.int32]
    queue: NDArray[np.int32]
    left: NDArray[np.int32]


def make_grid(side: int) -> GridGraph:
    """Memory for regions of at most `side` x `side` pixels."""
    n = (side + 2) * (side + 2)
    arcs, excess, height, queue, left = (np.zeros(size, np.int32) for size in (8 * n, n, n, n + 1, n))
    return GridGraph(arcs, excess, np.zeros(n, np.int8), height, queue, left)


_HEAD, _TAIL, _LEFT, _STEPS = 0, 1, 2, 3  # of the queue, in `state`; number of nodes left, and of steps made


@kernel(allocates=False)
def clear(grid: GridGraph, nodes: int) -> None:
    """No arcs, no excess."""
    for i in range(8 * nodes):
        grid.arcs[index(i)] = 0
    for i in range(nodes):
        grid.excess[index(i)] = 0


@kernel(allocates=False, inline=True)
def _offset(direction: int, row: int) -> int:
    """Index step to a neighbour: right, lower right, below, lower left, and their opposites."""
    step = (1, row + 1, row, row - 1)[direction & 3]
    return step if direction < 4 else -step


@kernel
def cut(grid: GridGraph, nodes: int, row: int, most: int) -> bool:
    """Find a minimum cut of a padded grid of `nodes` nodes, `row` nodes a row; its sink side is in ``grid.tree``.

    Returns False, and no cut, where `most` steps (looks at all arcs of a node to pass its demand on) did not do.
    """
    state = np.zeros(4, np.int64)
    _pass_nearby(grid, nodes, row, state)
    patience = 0.0
    while state[_LEFT] > 0:
        _measure_heights(grid, nodes, row)
        if not _resume(grid, state):
            break
        patience += _PATIENCE
        _pass_far(int(patience * nodes), grid, nodes, row, state)
        if state[_STEPS] > most:
            return False
    _mark(grid, nodes, row, state)
    return bool(state[_STEPS] <= most)


@kernel(allocates=False)
def _pass_nearby(grid: GridGraph, nodes: int, row: int, state: NDArray[np.int64]) -> None:
    for i in range(nodes):
        grid.tree[index(i)] = 0
        grid.height[index(i)] = 1 if grid.excess[index(i)] > 0 else 2
    for i in range(nodes):
        if grid.excess[index(i)] < 0:
            _discharge(i, _NEARBY, grid, nodes, row, state)
        if i % _BLOCK == _BLOCK - 1 or i == nodes - 1:
            while state[_HEAD] != state[_TAIL]:
                _discharge(_first(grid, state), _NEARBY, grid, nodes, row, state)


@kernel(allocates=False, inline=True)
def _first(grid: GridGraph, state: NDArray[np.int64]) -> int:
    """Take it from the ring."""
    place = state[_HEAD]
    state[_HEAD] = place + 1 if place + 1 < grid.queue.size else 0
    return int(grid.queue[index(place)])


@kernel(allocates=False, inline=True)
def _enqueue(i: int, grid: GridGraph, state: NDArray[np.int64]) -> None:
    place = state[_TAIL]
    grid.queue[index(place)] = i
    state[_TAIL] = place + 1 if place + 1 < grid.queue.size else 0


@kernel(allocates=False, inline=True)
def _leave(i: int, grid: GridGraph, state: NDArray[np.int64]) -> None:
    """Note a node that keeps its demand for now."""
    grid.left[index(state[_LEFT])] = i
    state[_LEFT] += 1


@kernel(allocates=False)
def _discharge(i: int, ceiling: int, grid: GridGraph, nodes: int, row: int, state: NDArray[np.int64]) -> int:
    """Pass on the demand of i, lifting it as needed, until it is gone or i above the ceiling; return the liftings."""
    wanted, height, lifts = -int(grid.excess[index(i)]), int(grid.height[index(i)]), 0
    state[_STEPS] += 1
    while height <= ceiling:
        lowest = _DEAD
        for direction in range(8):
            wanted, lowest = _pass_along(i, direction, wanted, height, lowest, grid, nodes, row, state)
        if wanted == 0:
            break
        height = lowest + 1
        lifts += 1
    state[_STEPS] += lifts
    grid.height[index(i)] = height
    grid.excess[index(i)] = -wanted
    if wanted > 0:
        _leave(i, grid, state)
    return lifts


@kernel(allocates=False, inline=True)
def _pass_along(
    i: int, direction: int, wanted: int, height: int, lowest: int, grid: GridGraph, nodes: int, row: int,
    state: NDArray[np.int64],
) -> tuple[int, int]:  # fmt: skip
    """Ask a neighbour that lies lower; return the demand that remains, and the lowest neighbour yet that is higher."""
    j = i + _offset(direction, row)
    arc = index(((direction + 4) & 7) * nodes + j)
    room = int(grid.arcs[arc])
    if wanted == 0 or room <= 0:
        return wanted, lowest
    below = int(grid.height[index(j)])
    if below >= height:
        return wanted, min(lowest, below)
    amount, before = min(room, wanted), int(grid.excess[index(j)])
    grid.arcs[arc] = room - amount
    grid.arcs[index(direction * nodes + i)] += amount
    grid.excess[index(j)] = before - amount
    if before >= 0 and before < amount:
        grid.height[index(j)] = max(below, 2)
        _enqueue(j, grid, state)
    return wanted - amount, lowest


@kernel(allocates=False)
def _measure_heights(grid: GridGraph, nodes: int, row: int) -> None:
    """True heights, by a search from the sources."""
    for i in range(nodes):
        grid.height[index(i)] = 1 if grid.excess[index(i)] > 0 else _DEAD
    size = 0
    for i in range(row + 1, nodes - row - 1):
        if grid.height[index(i)] == _DEAD and _beside_source(i, grid, nodes, row):
            grid.height[index(i)] = 2
            grid.queue[index(size)] = i
            size += 1
    done = 0
    while done < size:
        j = int(grid.queue[index(done)])
        done += 1
        for direction in range(8):
            i = j + _offset(direction, row)
            if grid.arcs[index(direction * nodes + j)] > 0 and grid.height[index(i)] == _DEAD:
                grid.height[index(i)] = grid.height[index(j)] + 1
                grid.queue[index(size)] = i
                size += 1


@kernel(allocates=False, inline=True)
def _beside_source(i: int, grid: GridGraph, nodes: int, row: int) -> bool:
    for direction in range(8):
        j = i + _offset(direction, row)
        if grid.height[index(j)] == 1 and grid.arcs[index(((direction + 4) & 7) * nodes + j)] > 0:
            return True
    return False


@kernel(allocates=False)
def _resume(grid: GridGraph, state: NDArray[np.int64]) -> bool:
    """Put the nodes left that reach a source into the queue; whether there are any."""
    count = state[_LEFT]
    state[_HEAD] = state[_TAIL] = state[_LEFT] = 0
    for n in range(count):
        i = int(grid.left[index(n)])
        if grid.height[index(i)] < _DEAD:
            _enqueue(i, grid, state)
        else:
            _leave(i, grid, state)
    return bool(state[_TAIL] > 0)


@kernel(allocates=False)
def _pass_far(patience: int, grid: GridGraph, nodes: int, row: int, state: NDArray[np.int64]) -> None:
    """Discharge what is in the queue; stop after `patience` liftings: heights have grown stale."""
    while state[_HEAD] != state[_TAIL] and patience >= 0:
        patience -= _discharge(_first(grid, state), _DEAD - 1, grid, nodes, row, state)
    while state[_HEAD] != state[_TAIL]:
        _leave(_first(grid, state), grid, state)


@kernel(allocates=False)
def _mark(grid: GridGraph, nodes: int, row: int, state: NDArray[np.int64]) -> None:
    """Mark all that has a way to a node with demand."""
    size = 0
    for n in range(state[_LEFT]):
        i = int(grid.left[index(n)])
        grid.tree[index(i)] = MOVE
        grid.queue[index(size)] = i
        size += 1
    done = 0
    while done < size:
        j = int(grid.queue[index(done)])
        done += 1
        for direction in range(8):
            i = j + _offset(direction, row)
            if grid.arcs[index(((direction + 4) & 7) * nodes + i)] > 0 and grid.tree[index(i)] == 0:
                grid.tree[index(i)] = MOVE
                grid.queue[index(size)] = i
                size += 1
