"""Minimum cut on a small grid with eight neighbours: augmenting paths in two search trees.

After Boykov and Kolmogorov (2004), with time stamps and distances to the root. The graph is implicit: node i's
neighbour in direction d is ``i + offset[d]``, the grid has a frame of nodes without arcs, and all arrays are reused
from cut to cut. The longest module-level function here is one algorithm whose steps share all their state.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel

_TERMINAL, _ORPHAN, _NONE = 100, 101, -1
KEEP, MOVE = 1, 2  #: sides of the cut in `Grid.tree`; 0 belongs to either


class Grid(NamedTuple):
    """A graph of at most `capacity` nodes, and the memory of its search.

    Parameters
    ----------
    arcs : (8 * capacity,) int32
        Residual capacity of the arc from node i in direction d at ``d * nodes + i``.
    excess : (capacity,) int32
        Capacity from the source minus capacity to the sink.
    tree : (capacity,) int8
        After `cut`: KEEP what the source reaches, MOVE what reaches the sink.
    """

    arcs: NDArray[np.int32]
    excess: NDArray[np.int32]
    tree: NDArray[np.int8]
    parent: NDArray[np.int8]
    distance: NDArray[np.int32]
    stamp: NDArray[np.int32]
    queue: NDArray[np.int32]
    queued: NDArray[np.uint8]
    orphans: NDArray[np.int32]


def make_grid(side: int) -> Grid:
    """Memory for regions of at most `side` x `side` pixels."""
    n = (side + 2) * (side + 2)

    def zeros(count: int) -> NDArray[np.int32]:
        return np.zeros(count, np.int32)

    return Grid(
        zeros(8 * n), zeros(n), np.zeros(n, np.int8), np.zeros(n, np.int8), zeros(n), zeros(n), zeros(n + 1),
        np.zeros(n, np.uint8), zeros(n + 1),
    )  # fmt: skip


_HEAD, _TAIL, _COUNT, _CLOCK, _STEPS = 0, 1, 2, 3, 4  # of the queue, in `state`; and nodes looked at yet


@kernel(allocates=False)
def clear(grid: Grid, nodes: int) -> None:
    """No arcs, no excess."""
    for i in range(8 * nodes):
        grid.arcs[i] = 0
    for i in range(nodes):
        grid.excess[i] = 0


@kernel(allocates=False, inline=True)
def _offset(direction: int, row: int) -> int:
    """Index step to a neighbour: right, lower right, below, lower left, and their opposites."""
    step = (1, row + 1, row, row - 1)[direction & 3]
    return step if direction < 4 else -step


@kernel(allocates=False, inline=True)
def _activate(i: int, grid: Grid, state: NDArray[np.int64]) -> None:
    if grid.queued[i] == 0:
        grid.queued[i] = 1
        grid.queue[state[_TAIL]] = i
        state[_TAIL] = state[_TAIL] + 1 if state[_TAIL] + 1 < grid.queue.size else 0
        state[_COUNT] += 1


@kernel
def cut(grid: Grid, nodes: int, row: int, most: int) -> bool:
    """Find a minimum cut of a padded grid of `nodes` nodes, `row` nodes a row; the sides are in ``grid.tree``.

    Returns False, and no cut, where `most` nodes looked at (in growing, adopting, on the way to a root) did not do.
    """
    state = np.zeros(5, np.int64)
    _plant(grid, nodes, state)
    active = -1
    while state[_STEPS] < most:
        if active < 0 or grid.tree[active] == 0:
            active = _next_active(grid, state)
            if active < 0:
                return True
        tail, direction = _grow(active, grid, nodes, row, state)
        state[_CLOCK] += 1
        state[_STEPS] += 1
        if tail < 0:
            active = -1
            continue
        _augment(tail, direction, grid, nodes, row, state)
    return False


@kernel(allocates=False)
def _plant(grid: Grid, nodes: int, state: NDArray[np.int64]) -> None:
    """Every node with excess or deficit is a root."""
    for i in range(nodes):
        grid.queued[i] = 0
        grid.stamp[i] = 0
        grid.distance[i] = 0
        grid.tree[i] = 0
        grid.parent[i] = _NONE
        if grid.excess[i] != 0:
            grid.tree[i] = KEEP if grid.excess[i] > 0 else MOVE
            grid.parent[i] = _TERMINAL
            grid.distance[i] = 1
            _activate(i, grid, state)


@kernel(allocates=False)
def _next_active(grid: Grid, state: NDArray[np.int64]) -> int:
    while state[_COUNT] > 0:
        i = grid.queue[state[_HEAD]]
        state[_HEAD] = state[_HEAD] + 1 if state[_HEAD] + 1 < grid.queue.size else 0
        state[_COUNT] -= 1
        grid.queued[i] = 0
        if grid.tree[i] != 0:
            return int(i)
    return -1


@kernel(allocates=False)
def _grow(i: int, grid: Grid, nodes: int, row: int, state: NDArray[np.int64]) -> tuple[int, int]:
    """Take free neighbours into i's tree; where the other tree is met: the arc (tail, direction) between them."""
    side = grid.tree[i]
    for direction in range(8):
        j, back = i + _offset(direction, row), (direction + 4) & 7
        residual = grid.arcs[direction * nodes + i] if side == KEEP else grid.arcs[back * nodes + j]
        if residual <= 0:
            continue
        if grid.tree[j] == 0:
            grid.tree[j] = side
            grid.parent[j], grid.stamp[j], grid.distance[j] = back, grid.stamp[i], grid.distance[i] + 1
            _activate(j, grid, state)
        elif grid.tree[j] != side:
            return (i, direction) if side == KEEP else (j, back)
        elif grid.stamp[j] <= grid.stamp[i] and grid.distance[j] > grid.distance[i]:
            grid.parent[j], grid.stamp[j], grid.distance[j] = back, grid.stamp[i], grid.distance[i] + 1
    return -1, 0


@kernel(allocates=False)
def _augment(tail: int, direction: int, grid: Grid, nodes: int, row: int, state: NDArray[np.int64]) -> None:
    """Send as much as fits along the path through the arc; find new parents for what it cuts off."""
    head = tail + _offset(direction, row)
    flow = grid.arcs[direction * nodes + tail]
    flow = _narrowest(tail, KEEP, flow, grid, nodes, row)
    flow = _narrowest(head, MOVE, flow, grid, nodes, row)
    grid.arcs[direction * nodes + tail] -= flow
    grid.arcs[((direction + 4) & 7) * nodes + head] += flow
    waiting = _send(tail, KEEP, flow, grid, nodes, row, 0)
    waiting = _send(head, MOVE, flow, grid, nodes, row, waiting)
    _adopt(waiting, grid, nodes, row, state)


@kernel(allocates=False)
def _narrowest(x: int, side: int, flow: int, grid: Grid, nodes: int, row: int) -> int:
    """Least residual from x to its root."""
    while grid.parent[x] != _TERMINAL:
        up = np.int64(grid.parent[x])
        y = x + _offset(up, row)
        residual = grid.arcs[((up + 4) & 7) * nodes + y] if side == KEEP else grid.arcs[up * nodes + x]
        flow = min(flow, residual)
        x = y
    return int(min(flow, abs(grid.excess[x])))


@kernel(allocates=False)
def _send(x: int, side: int, flow: int, grid: Grid, nodes: int, row: int, waiting: int) -> int:
    """Take `flow` from the residuals up to the root; nodes whose arc to the parent fills up become orphans."""
    while grid.parent[x] != _TERMINAL:
        up = np.int64(grid.parent[x])
        y, down = x + _offset(up, row), (up + 4) & 7
        to_child, to_parent = down * nodes + y, up * nodes + x
        if side == MOVE:
            to_child, to_parent = to_parent, to_child
        grid.arcs[to_child] -= flow
        grid.arcs[to_parent] += flow
        if grid.arcs[to_child] == 0:
            grid.parent[x] = _ORPHAN
            grid.orphans[waiting] = x
            waiting += 1
        x = y
    grid.excess[x] += -flow if side == KEEP else flow
    if grid.excess[x] == 0:
        grid.parent[x] = _ORPHAN
        grid.orphans[waiting] = x
        waiting += 1
    return waiting


@kernel(allocates=False)
def _adopt(waiting: int, grid: Grid, nodes: int, row: int, state: NDArray[np.int64]) -> None:
    """Give every orphan the nearest parent that still reaches a root, or set it free with its children orphaned."""
    first, room = 0, grid.orphans.size
    while waiting > 0:
        x = np.int64(grid.orphans[first])
        first = first + 1 if first + 1 < room else 0
        waiting -= 1
        state[_STEPS] += 1
        side, best, nearest = grid.tree[x], -1, 1 << 30
        for direction in range(8):
            y, back = x + _offset(direction, row), (direction + 4) & 7
            if grid.tree[y] != side:
                continue
            residual = grid.arcs[back * nodes + y] if side == KEEP else grid.arcs[direction * nodes + x]
            if residual > 0:
                far = _distance(y, grid, row, state)
                if 0 < far < nearest:
                    nearest, best = far, direction
        if best >= 0:
            grid.parent[x], grid.stamp[x], grid.distance[x] = best, state[_CLOCK], nearest + 1
            continue
        for direction in range(8):
            y, back = x + _offset(direction, row), (direction + 4) & 7
            if grid.tree[y] != side:
                continue
            residual = grid.arcs[back * nodes + y] if side == KEEP else grid.arcs[direction * nodes + x]
            if residual > 0:
                _activate(y, grid, state)
            if grid.parent[y] == back:
                grid.parent[y] = _ORPHAN
                grid.orphans[(first + waiting) % room] = y
                waiting += 1
        grid.tree[x], grid.parent[x] = 0, _NONE


@kernel(allocates=False)
def _distance(y: int, grid: Grid, row: int, state: NDArray[np.int64]) -> int:
    """Steps from y to its root; 0: it has none any more. Stamps the way."""
    x, far, now = y, 0, state[_CLOCK]
    while grid.stamp[x] != now:
        up = grid.parent[x]
        if up in (_ORPHAN, _NONE):
            return 0
        far += 1
        state[_STEPS] += 1
        if up == _TERMINAL:
            grid.stamp[x], grid.distance[x] = now, 1
            far -= 1
            break
        x += _offset(np.int64(up), row)
    far += grid.distance[x]
    x, left = y, far
    while grid.stamp[x] != now:
        grid.stamp[x], grid.distance[x] = now, left
        left -= 1
        x += _offset(np.int64(grid.parent[x]), row)
    return int(far)
