"""The graph of one alpha-expansion: never built, read off the labelling node by node where flow arrives.

Nodes
-----
With n pixels, node p (0 <= p < n) *switches on* the assignment (p, p - alpha), node n + p *drops* the active assignment
of p. A node that ends on the source side of the minimum cut is switched, so the present labelling is the empty set.
What a switch gains alone is the node's `gain`: capacity from the source if positive, to the sink if negative.

Arcs (number k of a node; the same number leads back, but for 0 <-> 1 and 2 <-> 3)
-----
====  =====================================================================================================
0..3  right, left, lower, upper neighbour of the same kind: V, the cost of switching just one of them.
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
from uw_recon_ros.match.kz2.energy import OCCLUDED

UNBOUNDED = 1 << 29  #: capacity of a uniqueness arc
FORBIDDEN = 1 << 28  #: what the switch of a node outside the move costs
ROUND = 1 << 20  #: tags a round: more than any way is long
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
        Of each switch alone.
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
        Round of the search in which the node was last seen, times `ROUND`, + its height: a lower bound of the number of
        arcs to the sink.
    """

    node: NDArray[np.int32]
    tag: NDArray[np.int32]


class Lists(NamedTuple):
    """Lists of nodes, one set a band.

    Parameters
    ----------
    active : (m + 1,) int32
        A ring: nodes waiting to be worked off.
    left : (m,) int32
        Nodes with an excess that they could not get rid of.
    region : (m,) int32
        Nodes that the source reaches; in the end, the source side of the minimum cut.
    state : (5,) int64
        `START` and `END` of `active`, numbers of `LEFT` and `REGION`, the last `ROUNDS` number used.
    """

    active: NDArray[np.int32]
    left: NDArray[np.int32]
    region: NDArray[np.int32]
    state: NDArray[np.int64]


START, END, LEFT, REGION, ROUNDS = range(5)


class Part(NamedTuple):
    """A band of rows of one move.

    Parameters
    ----------
    alpha : int
        Label.
    base : int
        Least tag of this move: its first round times `ROUND`.
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
    return Flow(np.zeros(2 * pixels * RECORD, np.int32), np.zeros(2 * pixels, np.int32))


def make_lists(pixels: int) -> Lists:
    """Room for the nodes of a band of `pixels`."""
    active, left, region = (np.zeros(2 * pixels + 1, np.int32) for _ in range(3))
    return Lists(active, left, region, np.zeros(5, np.int64))


@kernel(allocates=False, inline=True)
def end_of(v: int, k: int, part: Part, graph: Graph, flow: Flow) -> int:
    """Node at the end of arc k of node v."""
    if k < 4:
        return v + int(graph.steps[index(k)])
    if k == 4:
        return v + part.pixels if v < part.pixels else v - part.pixels
    return int(flow.node[index(v * RECORD + 7)])


@kernel(allocates=False)
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
