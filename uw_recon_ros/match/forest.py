"""Maximum flow, second part: augmenting paths in a search forest that is kept from path to path.

After Boykov and Kolmogorov (2004), one-sided: trees grow from the nodes with excess; where they meet a deficit, flow is
sent down the branch; branches that it cuts off look for a new parent or fall apart, and time stamps save asking twice
how far away the root is. When nothing grows any more, the forest is all that the source still reaches: the smallest
source side of a minimum cut, which is unique. So the result of a move depends neither on the order of the work nor on
how many threads share it, and nothing changes that need not.
"""

from __future__ import annotations

from numpy import uint64 as index

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.graph import (
    ACTIVE,
    CHANGED,
    CLOCK,
    ORPHANS,
    RECORD,
    Flow,
    Graph,
    Lists,
    Part,
    append,
    end_of,
    pop,
    reach,
)

FREE, ROOT, ORPHAN = 0, 7, 8  #: values of `Flow.parent` besides arc + 1
_WAITING, _LISTED = 1, 2  # bits of `Lists.flags`
_FAR = 1 << 30


@kernel(allocates=False)
def plant(flow: Flow, lists: Lists) -> None:
    """Make the nodes in ``lists.changed`` roots."""
    lists.state[ACTIVE] = lists.state[ACTIVE + 1] = 0
    for i in range(lists.state[CHANGED]):
        v = int(lists.changed[index(i)])
        flow.parent[index(v)], flow.distance[index(v)], flow.time[index(v)] = ROOT, 1, 0
        lists.flags[index(v)] = _LISTED
        activate(v, lists)


@kernel(allocates=False, inline=True)
def activate(v: int, lists: Lists) -> None:
    """Let v grow (again)."""
    if lists.flags[index(v)] & _WAITING == 0:
        lists.flags[index(v)] |= _WAITING
        append(v, lists.active, lists.state, ACTIVE)


@kernel(allocates=False)
def grow(part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Grow until the forest holds all that the source reaches; ``lists.changed`` then names its nodes, and others."""
    while lists.state[ACTIVE] != lists.state[ACTIVE + 1]:
        v = pop(lists.active, lists.state, ACTIVE)
        lists.flags[index(v)] &= ~_WAITING
        k = 0
        while k < 6 and flow.parent[index(v)] != FREE:
            if not _grow_along(v, k, part, graph, flow, lists):
                k += 1


@kernel(allocates=False, inline=True)
def _grow_along(v: int, k: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> bool:
    """Take in the end of an arc, or send flow into it; whether the arc may be of further use."""
    if flow.node[index(v * RECORD + 1 + k)] <= 0:
        return False
    w = end_of(v, k, part, graph, flow)
    if flow.tag[index(w)] < part.base:
        reach(w, part, graph, flow)
    if flow.parent[index(w)] != FREE:
        return False
    if flow.node[index(w * RECORD)] < 0:
        _augment(v, k, w, part, graph, flow, lists)
        return True
    flow.parent[index(w)] = 1 + (k ^ (k < 4))
    flow.distance[index(w)], flow.time[index(w)] = flow.distance[index(v)] + 1, flow.time[index(v)]
    _list(w, lists)
    activate(w, lists)
    return False


@kernel(allocates=False, inline=True)
def _list(v: int, lists: Lists) -> None:
    if lists.flags[index(v)] & _LISTED == 0:
        lists.flags[index(v)] |= _LISTED
        lists.changed[index(lists.state[CHANGED])] = v
        lists.state[CHANGED] += 1


@kernel(allocates=False, inline=True)
def _augment(v: int, k: int, w: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Send what v's branch can carry into w, then mend the branch."""
    amount = min(int(flow.node[index(v * RECORD + 1 + k)]), -int(flow.node[index(w * RECORD)]))
    amount = min(amount, _branch_capacity(v, part, graph, flow))
    flow.node[index(v * RECORD + 1 + k)] -= amount
    flow.node[index(w * RECORD + 1 + (k ^ (k < 4)))] += amount
    flow.node[index(w * RECORD)] += amount
    lists.state[ORPHANS] = lists.state[ORPHANS + 1] = 0
    x = v
    while flow.parent[index(x)] != ROOT:
        arc = int(flow.parent[index(x)]) - 1
        above = end_of(x, arc, part, graph, flow)
        flow.node[index(x * RECORD + 1 + arc)] += amount
        down = above * RECORD + 1 + (arc ^ (arc < 4))
        flow.node[index(down)] -= amount
        if flow.node[index(down)] == 0:
            _orphan(x, flow, lists)
        x = above
    flow.node[index(x * RECORD)] -= amount
    if flow.node[index(x * RECORD)] == 0:
        _orphan(x, flow, lists)
    lists.state[CLOCK] += 1
    while lists.state[ORPHANS] != lists.state[ORPHANS + 1]:
        _adopt(pop(lists.orphans, lists.state, ORPHANS), part, graph, flow, lists)


@kernel(allocates=False, inline=True)
def _branch_capacity(v: int, part: Part, graph: Graph, flow: Flow) -> int:
    """What the way from the root to v can carry, and the root has."""
    amount = _FAR
    while flow.parent[index(v)] != ROOT:
        arc = int(flow.parent[index(v)]) - 1
        v = end_of(v, arc, part, graph, flow)
        amount = min(amount, int(flow.node[index(v * RECORD + 1 + (arc ^ (arc < 4)))]))
    return min(amount, int(flow.node[index(v * RECORD)]))


@kernel(allocates=False, inline=True)
def _orphan(v: int, flow: Flow, lists: Lists) -> None:
    flow.parent[index(v)] = ORPHAN
    append(v, lists.orphans, lists.state, ORPHANS)


@kernel(allocates=False, inline=True)
def _adopt(v: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Give v the parent nearest to a root; without one, set it and its children free."""
    nearest, best = _FAR, -1
    for k in range(6):
        w = _member(v, k, part, graph, flow)
        if w >= 0 and flow.node[index(w * RECORD + 1 + (k ^ (k < 4)))] > 0:
            distance = _distance_to_root(w, part, graph, flow, lists.state[CLOCK])
            if distance < nearest:
                nearest, best = distance, k
    if best >= 0:
        flow.parent[index(v)] = best + 1
        flow.distance[index(v)], flow.time[index(v)] = nearest + 1, lists.state[CLOCK]
        return
    flow.parent[index(v)] = FREE
    for k in range(6):
        w = _member(v, k, part, graph, flow)
        if w >= 0:
            back = k ^ (k < 4)
            if flow.parent[index(w)] == back + 1:
                _orphan(w, flow, lists)
            if flow.node[index(w * RECORD + 1 + back)] > 0:
                activate(w, lists)


@kernel(allocates=False, inline=True)
def _member(v: int, k: int, part: Part, graph: Graph, flow: Flow) -> int:
    """The node of the forest at the end of arc k, whether or not the arc has room; -1 if there is none."""
    w = end_of(v, k, part, graph, flow)
    if w < 0 or w >= 2 * part.pixels or flow.tag[index(w)] < part.base or flow.parent[index(w)] == FREE:
        return -1
    if k == 5 and flow.node[index(w * RECORD + 7)] != v:
        return -1
    return w


@kernel(allocates=False, inline=True)
def _distance_to_root(v: int, part: Part, graph: Graph, flow: Flow, now: int) -> int:
    """Arcs from v to the root of its tree; `_FAR` if the way up ends at an orphan. Notes it along the way."""
    steps, x = 0, v
    while flow.time[index(x)] != now:
        parent = int(flow.parent[index(x)])
        if parent in (FREE, ORPHAN):
            return _FAR
        if parent == ROOT:
            flow.time[index(x)], flow.distance[index(x)] = now, 1
            break
        x = end_of(x, parent - 1, part, graph, flow)
        steps += 1
    distance = steps + int(flow.distance[index(x)])
    x, remaining = v, distance
    while flow.time[index(x)] != now:
        flow.time[index(x)], flow.distance[index(x)] = now, remaining
        x = end_of(x, int(flow.parent[index(x)]) - 1, part, graph, flow)
        remaining -= 1
    return distance


@kernel(allocates=False)
def join_bands(seam: int, lists: Lists, whole: Part, graph: Graph, flow: Flow, into: Lists) -> None:
    """Open the arcs across a seam and hand a band's forest over to `into`, to be grown further.

    Parameters
    ----------
    seam : int
        First pixel of the band.
    lists, into : Lists
        Of that band, and of all.
    whole : Part
        All rows.
    """
    for i in range(lists.state[CHANGED]):
        into.changed[index(into.state[CHANGED] + i)] = lists.changed[index(i)]
    into.state[CHANGED] += lists.state[CHANGED]
    into.state[CLOCK] = max(into.state[CLOCK], lists.state[CLOCK])
    width = graph.steps[2]
    for layer in range(2):
        for p in range(seam - width, seam + width):
            v, k = p + layer * whole.pixels, 2 if p < seam else 3
            if flow.tag[index(v)] >= whole.base:
                flow.node[index(v * RECORD + 1 + k)] = graph.weights[index(int(graph.links[index(v)]) * 4 + k)]
                if flow.parent[index(v)] != FREE:
                    activate(v, into)


@kernel(allocates=False)
def gather(flow: Flow, lists: Lists) -> int:
    """Keep in ``lists.changed`` what is in the forest, clear all flags; return the excess that found no sink."""
    kept, excess = 0, 0
    for i in range(lists.state[CHANGED]):
        v = int(lists.changed[index(i)])
        lists.flags[index(v)] = 0
        if flow.parent[index(v)] != FREE:
            excess += max(int(flow.node[index(v * RECORD)]), 0)
            lists.changed[index(kept)] = v
            kept += 1
    lists.state[CHANGED] = kept
    return excess
