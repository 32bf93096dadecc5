"""Maximum flow over any distance, and the smallest minimum cut.

First every source is discharged up to a small height (`push_relabel.push_nearby`): most excess finds room within a few
arcs.
What is left goes on in rounds. A search forward from the nodes with excess finds what they reach, within a radius that
grows from round to round; a search backward from the sinks in there gives exact heights; then they push again. Nodes
that reach no sink rest. When the source reaches no sink any more, what it still reaches is the smallest source side of
a minimum cut. That is unique: the result depends neither on the order of the work nor on how many bands share it, and
no node changes sides that need not.
"""

from __future__ import annotations

from numpy import uint64 as index

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.kz2.graph import (
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
from uw_recon_ros.match.kz2.push_relabel import DEAD, activate, discharge, first_active, leave

_FIRST_RADIUS = 16  # arcs, of the first search forward ...
_WIDER = 4  # ... and by how much each is wider than the last
_PATIENCE = 0.5  # liftings a node of the region until heights are searched anew; as much more every round


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
        leave(int(lists.left[index(i)]), into)
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


@kernel(allocates=False, inline=True)
def _take_in(v: int, base: int, flow: Flow, lists: Lists) -> None:
    """v is in the region; it counts as dead until a sink is found."""
    flow.tag[index(v)] = base + DEAD
    lists.region[index(lists.state[REGION])] = v
    lists.state[REGION] += 1


@kernel(allocates=False)
def _search_forward(radius: int, base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> bool:
    """Put what the nodes left reach into ``lists.region``, sinks into ``lists.active``; whether that is all of it."""
    lists.state[START] = lists.state[END] = lists.state[REGION] = 0
    for i in range(lists.state[LEFT]):
        _take_in(int(lists.left[index(i)]), base, flow, lists)
    done, stop, steps = 0, lists.state[REGION], 0
    while done < lists.state[REGION]:
        if done == stop:
            steps, stop = steps + 1, lists.state[REGION]
            if steps == radius:
                return False
        v = int(lists.region[index(done)])
        done += 1
        for k in range(6):
            _follow(v, k, base, part, graph, flow, lists)
    return True


@kernel(allocates=False, inline=True)
def _follow(v: int, k: int, base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Note what arc k of v leads to, if it has room."""
    if flow.node[index(v * RECORD + 1 + k)] <= 0:
        return
    w = end_of(v, k, part, graph, flow)
    if flow.tag[index(w)] >= base:
        return
    if flow.tag[index(w)] < part.base:
        reach(w, part, graph, flow)
    if flow.node[index(w * RECORD)] < 0:
        flow.tag[index(w)] = base + 1
        activate(w, lists)
    else:
        _take_in(w, base, flow, lists)


@kernel(allocates=False)
def _search_backward(base: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Give every node of the region its true height; it stays dead where there is no way to a sink."""
    done, size = 0, lists.state[END]
    while done < size:
        w = int(lists.active[index(done)])
        done += 1
        for k in range(6):
            v = end_of(w, k, part, graph, flow)
            if v < 0 or v >= 2 * part.pixels or flow.tag[index(v)] != base + DEAD:
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
            if flow.tag[index(v)] == base + DEAD:
                leave(v, lists)
            else:
                activate(v, lists)
    while lists.state[START] != lists.state[END] and patience >= 0:
        patience -= discharge(first_active(lists), DEAD - 1, base, part, graph, flow, lists)
    while lists.state[START] != lists.state[END]:
        leave(first_active(lists), lists)
