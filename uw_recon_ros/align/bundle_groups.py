"""Which frames are adjusted together: a bounded number at a time, whatever the length of the dive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, identity

from uw_recon_ros.types import Matrix

_HOPS = 3  # relations that may lie between two frames that are matched: what is nearer is known well enough
_PARTNERS = 12  # earlier frames that a frame is matched with, at most
_CORE, _WHOLE = 80, 160  # frames of a group; with those around it
_ROWS = 512  # of the graph at once: memory does not grow with it

Indices = NDArray[np.int64]


def partners(seen: Matrix, radii: Matrix, first: Indices, second: Indices) -> Indices:
    """(M, 2) pairs of frames, the earlier one first, that show a common place and are joined by few relations.

    Parameters
    ----------
    seen : (N, 3) float64
        Footprints, see `uw_recon_ros.align.loops.footprints`.
    radii : (N,) float64
        How far apart two of them may be, m.
    first, second : (E,) int64
        Frames that believed relations join. Without such, a place that only looks alike could be taken for it.
    """
    count = len(seen)
    one = np.ones(len(first), np.float32)
    graph = csr_matrix((one, (first, second)), shape=(count, count))
    graph = (graph + graph.T + identity(count, np.float32, format="csr")).tocsr()
    found = [np.zeros((0, 2), np.int64)]
    for begin in range(0, count, _ROWS):
        reach = graph[begin : begin + _ROWS]
        for _ in range(_HOPS - 1):
            reach = reach @ graph
        reach.sort_indices()
        for row, k in enumerate(range(begin, min(begin + _ROWS, count))):
            before = reach.indices[reach.indptr[row] : reach.indptr[row + 1]].astype(np.int64)
            before = before[before < k]
            apart = np.linalg.norm(seen[before] - seen[k], axis=1)
            near = np.argsort(apart, kind="stable")[:_PARTNERS]
            chosen = np.sort(before[near[apart[near] < radii[k]]])
            found.append(np.stack([chosen, np.full(len(chosen), k)], axis=1))
    return np.concatenate(found)


def groups(seen: Matrix, pairs: Indices) -> list[tuple[Indices, Indices]]:
    """Frames near each other, halved until they are few enough: a group's own frames, and all with those around.

    Every frame belongs to one group; those around it are the frames it is paired with most often.
    """
    found = []
    for own in _halved(seen, np.arange(len(seen), dtype=np.int64)):
        inside = np.zeros(len(seen), np.bool_)
        inside[own] = True
        crossing = pairs[inside[pairs].sum(axis=1) == 1]
        others = crossing[~inside[crossing]]
        frames, often = np.unique(others, return_counts=True)
        around = frames[np.argsort(-often, kind="stable")[: _WHOLE - len(own)]]
        found.append((own, np.sort(np.concatenate([own, around]))))
    return found


def _halved(seen: Matrix, frames: Indices) -> list[Indices]:
    if len(frames) <= _CORE:
        return [frames]
    widest = int(np.ptp(seen[frames], axis=0).argmax())
    order = frames[np.argsort(seen[frames, widest], kind="stable")]
    middle = len(order) // 2
    return _halved(seen, np.sort(order[:middle])) + _halved(seen, np.sort(order[middle:]))
