"""Maximum flow by push-relabel (Goldberg and Tarjan 1988) on the implicit graph of an expansion.

First every source is discharged, first in, first out, up to a small height: most excess finds room within a few arcs.
What is left goes on in rounds. A search forward from the nodes with excess finds what they reach, within a radius that
grows from round to round; a search backward from the sinks in there gives exact heights; then they push again. Nodes
that reach no sink rest. When the source reaches no sink any more, what it still reaches is the smallest source side of
a minimum cut. That is unique: the result depends neither on the order of the work nor on how many bands share it, and
no node changes sides that need not.
"""

from __future__ import annotations

import numpy as np
from numpy import uint64 as index
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.graph import (
    END,
    LEFT,
    RECORD,
    REGION,
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
_FIRST_RADIUS = 16  # arcs, of the first search forward ...
_WIDER = 4  # ... and by how much each is wider than the last
_DEAD = ROUND - 1  # height of a node that reaches no sink
_PATIENCE = 0.5  # liftings a node of the region until heights are searched anew; as much more every round
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
                    _discharge(v, NEARBY, part.base, part, graph, flow, lists)
        if run + 1 == runs.shape[0] or runs[run + 1, 0] // _BLOCK != runs[run, 0] // _BLOCK:
            while lists.state[START] != lists.state[END]:
                _discharge(_first_active(lists), NEARBY, part.base, part, graph, flow, lists)


@kernel(allocates=False)
def push_far(part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Send the excess of the nodes left to whatever sinks it reaches; ``lists.region`` is then the source side."""
    radius, patience = _FIRST_RADIUS, 0.0
    while lists.state[LEFT] > 0:
        lists.state[ROUNDS] += 1
        base = lists.state[ROUNDS] * ROUND
        whole = _search_forward(radius, base, part, graph, flow, lists)
        if lists.state[END] == 0 and whole:
            return
        radius, patience = radius * _WIDER, patience + _PATIENCE
        if lists.state[END] > 0:
            _search_backward(base, part, graph, flow, lists)
            _push_round(base, int(patience * lists.state[REGION]), part, graph, flow, lists)
    lists.state[REGION] = 0


@kernel(allocates=False)
def join_band(seam: int, lists: Lists, whole: Part, graph: Graph, flow: Flow, into: Lists) -> None:
    """Open the arcs across a seam and hand what a band has left over to `into`, for `push_far`.

    Parameters
    ----------
    seam : int
        First pixel of the band.
    lists, into : Lists
        Of that band, and of all.
    whole : Part
        All rows.
    """
    for i in range(lists.state[LEFT]):
        _leave(lists.left[index(i)], into)
    into.state[ROUNDS] = max(into.state[ROUNDS], lists.state[ROUNDS])
    width = graph.steps[2]
    for layer in range(2):
        for p in range(seam - width, seam + width):
            v, k = p + layer * whole.pixels, 2 if p < seam else 3
            if flow.tag[index(v)] >= whole.base:
                flow.node[index(v * RECORD + 1 + k)] = graph.weights[index(int(graph.links[index(v)]) * 4 + k)]


@kernel(allocates=False)
def left_over(flow: Flow, lists: Lists) -> int:
    """The excess that found no sink: by so much the move lowers the energy."""
    excess = 0
    for i in range(lists.state[LEFT]):
        excess += int(flow.node[index(int(lists.left[index(i)]) * RECORD)])
    return excess


@kernel(allocates=False)
def _search_forward(radius: int, base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> bool:
    """Put what the nodes left reach into ``lists.region``, sinks into ``lists.active``; whether that is all of it."""
    sinks, size = 0, 0
    for i in range(lists.state[LEFT]):
        v = int(lists.left[index(i)])
        flow.tag[index(v)] = base + _DEAD
        lists.region[index(size)] = v
        size += 1
    done, stop, steps = 0, size, 0
    while done < size:
        if done == stop:
            steps, stop = steps + 1, size
            if steps == radius:
                break
        v = int(lists.region[index(done)])
        done += 1
        for k in range(6):
            if flow.node[index(v * RECORD + 1 + k)] <= 0:
                continue
            w = end_of(v, k, part, graph, flow)
            tag = flow.tag[index(w)]
            if tag >= base:
                continue
            if tag < part.base:
                reach(w, part, graph, flow)
            if flow.node[index(w * RECORD)] < 0:
                flow.tag[index(w)] = base + 1
                lists.active[index(sinks)] = w
                sinks += 1
            else:
                flow.tag[index(w)] = base + _DEAD
                lists.region[index(size)] = w
                size += 1
    lists.state[START], lists.state[END], lists.state[REGION] = 0, sinks, size
    return done == size


@kernel(allocates=False)
def _search_backward(base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Give every node of the region its true height; it stays dead where there is no way to a sink."""
    done, size = 0, lists.state[END]
    while done < size:
        w = int(lists.active[index(done)])
        done += 1
        for k in range(6):
            v = end_of(w, k, part, graph, flow)
            if v < 0 or v >= 2 * part.pixels or flow.tag[index(v)] != base + _DEAD:
                continue
            if k == 5 and flow.node[index(v * RECORD + 7)] != w:
                continue
            if flow.node[index(v * RECORD + 1 + (k ^ (k < 4)))] > 0:
                flow.tag[index(v)] = flow.tag[index(w)] + 1
                lists.active[index(size)] = v
                size += 1


@kernel(allocates=False)
def _push_round(base: int, patience: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Discharge the nodes of the region; stop after `patience` liftings: heights have grown stale."""
    lists.state[START] = lists.state[END] = lists.state[LEFT] = 0
    for i in range(lists.state[REGION]):
        v = int(lists.region[index(i)])
        if flow.node[index(v * RECORD)] > 0:
            if flow.tag[index(v)] == base + _DEAD:
                _leave(v, lists)
            else:
                _activate(v, lists)
    while lists.state[START] != lists.state[END] and patience >= 0:
        patience -= _discharge(_first_active(lists), _DEAD - 1, base, part, graph, flow, lists)
    while lists.state[START] != lists.state[END]:
        _leave(_first_active(lists), lists)


@kernel(allocates=False, inline=True)
def _discharge(v: int, ceiling: int, base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> int:
    """Push from v, lifting it as needed, until its excess is gone or it is above the ceiling; return the liftings."""
    record, lifts = v * RECORD, 0
    excess, height = int(flow.node[index(record)]), int(flow.tag[index(v)]) & (ROUND - 1)
    while height <= ceiling:
        lowest = _DEAD - 1
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
        _leave(v, lists)
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
        _activate(w, lists)
    below = int(flow.tag[index(w)]) & (ROUND - 1)
    if below >= height:
        return excess, min(lowest, below)
    amount = min(excess, capacity)
    flow.node[index(room)] = capacity - amount
    flow.node[index(w * RECORD + 1 + (k ^ (k < 4)))] += amount
    before = int(flow.node[index(w * RECORD)])
    flow.node[index(w * RECORD)] = before + amount
    if before <= 0 < before + amount:
        _activate(w, lists)
    return excess - amount, lowest


@kernel(allocates=False, inline=True)
def _activate(v: int, lists: Lists) -> None:
    """Put v at the end of the ring of active nodes."""
    place = lists.state[END]
    lists.active[index(place)] = v
    lists.state[END] = place + 1 if place + 1 < lists.active.size else 0


@kernel(allocates=False, inline=True)
def _first_active(lists: Lists) -> int:
    """Take it from the ring."""
    place = lists.state[START]
    lists.state[START] = place + 1 if place + 1 < lists.active.size else 0
    return int(lists.active[index(place)])


@kernel(allocates=False, inline=True)
def _leave(v: int, lists: Lists) -> None:
    """Note v, which keeps its excess for now."""
    lists.left[index(lists.state[LEFT])] = v
    lists.state[LEFT] += 1
