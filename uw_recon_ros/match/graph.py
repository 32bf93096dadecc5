"""The graph of one alpha-expansion: never built, read off the labelling node by node where flow arrives.

Nodes
-----
With n pixels, node p (0 <= p < n) *switches on* the assignment (p, p - alpha), node n + p *drops* the active assignment
of p. A node that ends on the source side of the minimum cut does its deed, so the present labelling is the empty set.
What a deed gains alone is the node's `gain`: capacity from the source if positive, to the sink if negative.

Arcs (number k of a node; the same number leads back, but for 0 <-> 1 and 2 <-> 3)
-----
====  =====================================================================================================
0..3  right, left, lower, upper neighbour of the same kind: V, the cost of just one of them doing its deed.
      Two neighbouring assignments of alpha; or two neighbouring active ones of equal disparity.
4     p -> n + p, unbounded: who switches on at the left pixel drops what is active there (uniqueness) ...
5     p -> n + p', unbounded: ... and what is active at the right pixel, that of the left pixel p'.
====  =====================================================================================================

Truth table of a uniqueness arc (a = on, b = dropped): E(0, 0) = E(0, 1) = E(1, 1) = 0, E(1, 0) = infinite; of a
smoothness arc: E(0, 0) = E(1, 1) = 0, E(0, 1) = E(1, 0) = V. Both are submodular: a minimum cut is an optimal move
(Kolmogorov and Zabih 2002). Assignments of alpha that are active already stay: dropping them is a move of every other
label, and by submodularity a labelling that neither kind of move improves is not improved by both at once.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import uint64 as index  # unsigned indices spare the test for negative ones
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.energy import OCCLUDED

UNBOUNDED = 1 << 29  #: capacity of a uniqueness arc
FORBIDDEN = 1 << 28  #: what the deed of a node outside the move costs
RECORD = 8  #: int32 values a node: excess (a deficit if negative), residual capacity of arcs 0 to 5, end of arc 5

_NO_LABEL = OCCLUDED


class Graph(NamedTuple):
    """What the graph of a move follows from. Flat arrays, pixels row by row.

    Parameters
    ----------
    label : (n,) int16
        Disparity of the active assignment, or `OCCLUDED`.
    partner : (n,) int32
        Left pixel of a right pixel's active assignment, or -1.
    gain : (2 n,) int32
        Of each deed alone.
    links : (2 n,) uint8
        Arcs 0 to 3, two bits each: 0 none, 1 across an edge, 2 smooth.
    opened : (n,) uint8
        Whether the pixel takes part in the move.
    weights : (4 * 256,) int32
        Capacities of arcs 0 to 3 by value of `links`.
    steps : (6,) int64
        From a node to the end of its arcs 0 to 3.
    """

    label: NDArray[np.int16]
    partner: NDArray[np.int32]
    gain: NDArray[np.int32]
    links: NDArray[np.uint8]
    opened: NDArray[np.uint8]
    weights: NDArray[np.int32]
    steps: NDArray[np.int64]


class Flow(NamedTuple):
    """What is known of the nodes that flow has reached; the same arrays serve move after move.

    Parameters
    ----------
    node : (RECORD * 2 n,) int32
        See `RECORD`.
    tag : (2 n,) int32
        ``Part.base`` + a lower bound of the number of arcs to the sink; less than the base: not yet reached.
    parent : (2 n,) int8
        Search forest: the arc to the parent + 1, or one of the constants in `forest`.
    distance, time : (2 n,) int32
        Search forest: arcs to the root, and when that was known.
    """

    node: NDArray[np.int32]
    tag: NDArray[np.int32]
    parent: NDArray[np.int8]
    distance: NDArray[np.int32]
    time: NDArray[np.int32]


class Lists(NamedTuple):
    """Lists of nodes, one set a band. A ring holds one node less than its size.

    Parameters
    ----------
    active, orphans : (m,) int32
        Rings: nodes waiting to be worked off.
    changed : (m,) int32
        Nodes left with an excess, then those of the search forest; in the end, the source side.
    flags : (2 n,) uint8
        Of the search: bit 0, waits in `active`; bit 1, stands in `changed`. Common to all bands.
    state : (6,) int64
        Start and end of `active` (`ACTIVE`), of `orphans` (`ORPHANS`), length of `changed` (`CHANGED`), `CLOCK`.
    """

    active: NDArray[np.int32]
    orphans: NDArray[np.int32]
    changed: NDArray[np.int32]
    flags: NDArray[np.uint8]
    state: NDArray[np.int64]


ACTIVE, ORPHANS, CHANGED, CLOCK = 0, 2, 4, 5


class Part(NamedTuple):
    """A band of rows of one move.

    Parameters
    ----------
    alpha : int
        Label.
    base : int
        Greater than any tag of earlier moves.
    pixels : int
        n.
    first, stop : int
        The band's pixels. Arcs across its border are closed.
    """

    alpha: int
    base: int
    pixels: int
    first: int
    stop: int


def make_flow(pixels: int) -> Flow:
    """Nothing reached yet."""
    return Flow(
        node=np.zeros(2 * pixels * RECORD, np.int32),
        tag=np.zeros(2 * pixels, np.int32),
        parent=np.zeros(2 * pixels, np.int8),
        distance=np.zeros(2 * pixels, np.int32),
        time=np.zeros(2 * pixels, np.int32),
    )


def make_lists(pixels: int, flags: NDArray[np.uint8]) -> Lists:
    """Room for the nodes of a band of `pixels`; `flags` as in `Lists`."""
    return Lists(
        active=np.zeros(2 * pixels + 1, np.int32),
        orphans=np.zeros(2 * pixels + 1, np.int32),
        changed=np.zeros(2 * pixels, np.int32),
        flags=flags,
        state=np.zeros(6, np.int64),
    )


@kernel(allocates=False, inline=True)
def append(v: int, ring: NDArray[np.int32], state: NDArray[np.int64], which: int) -> None:
    """Put v at the end of a ring, `ACTIVE` or `ORPHANS`."""
    place = state[index(which + 1)]
    ring[index(place)] = v
    state[index(which + 1)] = place + 1 if place + 1 < ring.size else 0


@kernel(allocates=False, inline=True)
def pop(ring: NDArray[np.int32], state: NDArray[np.int64], which: int) -> int:
    """Take the first node of a ring that is not empty."""
    place = state[index(which)]
    state[index(which)] = place + 1 if place + 1 < ring.size else 0
    return int(ring[index(place)])


@kernel(allocates=False, inline=True)
def end_of(v: int, k: int, part: Part, graph: Graph, flow: Flow) -> int:
    """Node at the end of arc k of node v."""
    if k < 4:
        return v + int(graph.steps[index(k)])
    if k == 4:
        return v + part.pixels if v < part.pixels else v - part.pixels
    return int(flow.node[index(v * RECORD + 7)])


@kernel(allocates=False, inline=True)
def reach(v: int, part: Part, graph: Graph, flow: Flow) -> int:
    """Fill in the record of a node that flow reaches for the first time; return its excess."""
    record, links = v * RECORD, int(graph.links[index(v)]) * 4
    for k in range(4):
        flow.node[index(record + 1 + k)] = graph.weights[index(links + k)]
    p = v if v < part.pixels else v - part.pixels
    if p + graph.steps[2] >= part.stop:
        flow.node[index(record + 3)] = 0
    if p - graph.steps[2] < part.first:
        flow.node[index(record + 4)] = 0
    excess = _reach_on(p, part, graph, flow) if v == p else _reach_drop(p, part, graph, flow)
    if graph.opened[index(p)] == 0:
        excess = -FORBIDDEN
    flow.node[index(record)] = excess
    flow.parent[index(v)] = 0
    flow.tag[index(v)] = part.base + (1 if excess < 0 else 2)
    return excess


@kernel(allocates=False, inline=True)
def _reach_on(p: int, part: Part, graph: Graph, flow: Flow) -> int:
    """Arcs 4 and 5 of the node that switches on (p, p - alpha); return its excess."""
    dropped = int(graph.partner[index(p - part.alpha)])
    flow.node[index(p * RECORD + 5)] = UNBOUNDED if graph.label[index(p)] != _NO_LABEL else 0
    flow.node[index(p * RECORD + 6)] = UNBOUNDED if dropped >= 0 else 0
    flow.node[index(p * RECORD + 7)] = dropped + part.pixels
    return int(graph.gain[index(p)])


@kernel(allocates=False, inline=True)
def _reach_drop(p: int, part: Part, graph: Graph, flow: Flow) -> int:
    """Arcs 4 and 5 of the node that drops the assignment of p; return its excess."""
    v = p + part.pixels
    flow.node[index(v * RECORD + 5)] = 0
    flow.node[index(v * RECORD + 6)] = 0
    flow.node[index(v * RECORD + 7)] = p - graph.label[index(p)] + part.alpha
    return int(graph.gain[index(v)])
