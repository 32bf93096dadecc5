"""Maximum flow, one node at a time: push-relabel (Goldberg and Tarjan 1988) on the implicit graph of an expansion."""

from __future__ import annotations

import numpy as np
from numpy import uint64 as index
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.kz2.graph import (
    END,
    LEFT,
    RECORD,
    ROUND,
    ROUNDS,
    START,
    Flow,
    Graph,
    Lists,
    Part,
    end_of,
    reach,
)

NEARBY = 20  #: height up to which sources are discharged without any search
DEAD = ROUND - 1  #: height of a node that reaches no sink
_BLOCK = 2048  # pixels whose sources are worked off before the next ones, while they are in the cache


@kernel(allocates=False)
def push_nearby(runs: NDArray[np.int32], part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Send the excess of all sources in `runs` as far as it gets without a search; note what is left.

    Parameters
    ----------
    runs : (m, 2) int32
        First pixel, and one past the last, of the stretches of rows that take part.
    """
    lists.state[:] = 0
    lists.state[ROUNDS] = part.base // ROUND
    for run in range(runs.shape[0]):
        for p in range(runs[run, 0], runs[run, 1]):
            for v in range(p, p + part.pixels + 1, part.pixels):
                keeps = v > p and graph.label[index(p)] == part.alpha
                if graph.gain[index(v)] > 0 and not keeps and flow.tag[index(v)] < part.base:
                    reach(v, part, graph, flow)
                    discharge(v, NEARBY, part.base, part, graph, flow, lists)
        if run + 1 == runs.shape[0] or runs[run + 1, 0] // _BLOCK != runs[run, 0] // _BLOCK:
            while lists.state[START] != lists.state[END]:
                discharge(first_active(lists), NEARBY, part.base, part, graph, flow, lists)


@kernel(allocates=False, inline=True)
def discharge(v: int, ceiling: int, base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> int:
    """Push from v, lifting it as needed, until its excess is gone or it is above the ceiling; return the liftings."""
    record, lifts = v * RECORD, 0
    excess, height = int(flow.node[index(record)]), int(flow.tag[index(v)]) & (ROUND - 1)
    while height <= ceiling:
        lowest = DEAD - 1
        # Arc by arc, each with its number known to the compiler; what is dropped first: the sinks are there.
        excess, lowest = _push_along(v, 4, excess, height, lowest, part, graph, flow, lists)
        excess, lowest = _push_along(v, 5, excess, height, lowest, part, graph, flow, lists)
        excess, lowest = _push_along(v, 0, excess, height, lowest, part, graph, flow, lists)
        excess, lowest = _push_along(v, 1, excess, height, lowest, part, graph, flow, lists)
        excess, lowest = _push_along(v, 2, excess, height, lowest, part, graph, flow, lists)
        excess, lowest = _push_along(v, 3, excess, height, lowest, part, graph, flow, lists)
        if excess == 0:
            break
        height = lowest + 1
        lifts += 1
        flow.tag[index(v)] = base + height
    flow.node[index(record)] = excess
    if excess > 0:
        leave(v, lists)
    return lifts


@kernel(allocates=False, inline=True)
def _push_along(
    v: int, k: int, excess: int, height: int, lowest: int, part: Part, graph: Graph, flow: Flow, lists: Lists
) -> tuple[int, int]:
    """Push along arc k if it leads down; return the excess that remains, and the lowest end yet of arcs with room."""
    room = v * RECORD + 1 + k
    capacity = int(flow.node[index(room)])
    if excess == 0 or capacity <= 0:
        return excess, lowest
    w = end_of(v, k, part, graph, flow)
    if flow.tag[index(w)] < part.base and reach(w, part, graph, flow) > 0:
        activate(w, lists)
    below = int(flow.tag[index(w)]) & (ROUND - 1)
    if below >= height:
        return excess, min(lowest, below)
    amount = min(excess, capacity)
    flow.node[index(room)] = capacity - amount
    flow.node[index(w * RECORD + 1 + (k ^ (k < 4)))] += amount
    before = int(flow.node[index(w * RECORD)])
    flow.node[index(w * RECORD)] = before + amount
    if before <= 0 < before + amount:
        activate(w, lists)
    return excess - amount, lowest


@kernel(allocates=False, inline=True)
def activate(v: int, lists: Lists) -> None:
    """Put v at the end of the ring of active nodes."""
    place = lists.state[END]
    lists.active[index(place)] = v
    lists.state[END] = place + 1 if place + 1 < lists.active.size else 0


@kernel(allocates=False, inline=True)
def first_active(lists: Lists) -> int:
    """Take it from the ring."""
    place = lists.state[START]
    lists.state[START] = place + 1 if place + 1 < lists.active.size else 0
    return int(lists.active[index(place)])


@kernel(allocates=False, inline=True)
def leave(v: int, lists: Lists) -> None:
    """Note v, which keeps its excess for now."""
    lists.left[index(lists.state[LEFT])] = v
    lists.state[LEFT] += 1
