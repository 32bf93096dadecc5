"""Maximum flow, first part: push-relabel near the sources.

Most excess finds room within a few arcs: first in, first out, heights up to `HIGHEST`. What is left above goes to the
search forest, which is better at long ways (see `forest`).
"""

from __future__ import annotations

import numpy as np
from numpy import uint64 as index
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.graph import ACTIVE, CHANGED, RECORD, Flow, Graph, Lists, Part, append, end_of, pop, reach

HIGHEST = 12
_OUT_OF_REACH = 1 << 30


@kernel(allocates=False)
def push_relabel(runs: NDArray[np.int32], part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Send the excess of all sources in `runs` as far as it gets.

    Parameters
    ----------
    runs : (m, 2) int32
        First pixel, and one past the last, of the stretches of rows that take part.

    The nodes that keep an excess are in ``lists.changed`` afterwards.
    """
    lists.state[:] = 0
    for run in range(runs.shape[0]):
        for p in range(runs[run, 0], runs[run, 1]):
            if graph.gain[index(p)] > 0 and flow.tag[index(p)] < part.base:
                _start(p, part, graph, flow, lists)
            drop = p + part.pixels
            if (
                graph.gain[index(drop)] > 0
                and graph.label[index(p)] != part.alpha
                and flow.tag[index(drop)] < part.base
            ):
                _start(drop, part, graph, flow, lists)
    while lists.state[ACTIVE] != lists.state[ACTIVE + 1]:
        v = pop(lists.active, lists.state, ACTIVE)
        _discharge(v, part, graph, flow, lists)


@kernel(allocates=False, inline=True)
def _start(v: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Discharge a source at once: what it needs is still near at hand."""
    reach(v, part, graph, flow)
    _discharge(v, part, graph, flow, lists)


@kernel(allocates=False, inline=True)
def _discharge(v: int, part: Part, graph: Graph, flow: Flow, lists: Lists) -> None:
    """Push from v, lifting it as needed, until its excess is gone or it is too high."""
    record = v * RECORD
    excess, height = int(flow.node[index(record)]), int(flow.tag[index(v)]) - part.base
    while height <= HIGHEST:
        lowest = _OUT_OF_REACH
        for turn in range(6):
            k = turn + 4 if turn < 2 else turn - 2  # what is dropped first: the sinks are there
            capacity = int(flow.node[index(record + 1 + k)])
            if capacity <= 0:
                continue
            w = end_of(v, k, part, graph, flow)
            below = int(flow.tag[index(w)]) - part.base
            if below < 0:
                if reach(w, part, graph, flow) > 0:
                    append(w, lists.active, lists.state, ACTIVE)
                below = int(flow.tag[index(w)]) - part.base
            if below >= height:
                lowest = min(lowest, below)
                continue
            amount = min(excess, capacity)
            flow.node[index(record + 1 + k)] = capacity - amount
            _receive(w, k, amount, flow, lists)
            excess -= amount
            if excess == 0:
                break
        if excess == 0:
            break
        height = lowest + 1
        flow.tag[index(v)] = part.base + min(height, HIGHEST + 1)
    flow.node[index(record)] = excess
    if excess > 0:
        lists.changed[lists.state[CHANGED]] = v
        lists.state[CHANGED] += 1


@kernel(allocates=False, inline=True)
def _receive(w: int, k: int, amount: int, flow: Flow, lists: Lists) -> None:
    """Flow arrives at w through an arc of number k."""
    record = w * RECORD
    flow.node[index(record + 1 + (k ^ (k < 4)))] += amount
    before = int(flow.node[index(record)])
    flow.node[index(record)] = before + amount
    if before <= 0 < before + amount:
        append(w, lists.active, lists.state, ACTIVE)
