"""The max-flow on random graphs of its kind against scipy's: amount of flow and smallest source side."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from helpers.match_scenes import random_labels
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

from uw_recon_ros.match.kz2.assignments import make_graph
from uw_recon_ros.match.kz2.constants import Constants
from uw_recon_ros.match.kz2.energy import OCCLUDED
from uw_recon_ros.match.kz2.graph import FORBIDDEN, REGION, ROUND, Flow, Graph, Lists, Part, make_flow, make_lists
from uw_recon_ros.match.kz2.max_flow import join_band, left_over, push_far
from uw_recon_ros.match.kz2.push_relabel import push_nearby

CONSTANTS = Constants(denominator=1, occlusion_cost=0, smoothness=7, smoothness_at_edge=3)
MUCH = 10**6


def random_graph(seed: int, height: int, width: int, alpha: int) -> Graph:
    """Everything at random, but for what every graph of an expansion keeps to."""
    random = np.random.RandomState(seed)
    graph = make_graph(height, width, CONSTANTS)
    pixels = height * width
    graph.label[:] = random_labels(random, height, width, -2, 3).ravel()
    for p in np.flatnonzero(graph.label != OCCLUDED):
        graph.partner[p - graph.label[p]] = p
    graph.gain[:] = random.randint(-20, 16, 2 * pixels)
    graph.opened[:] = random.rand(pixels) < 0.9
    column = np.arange(pixels) % width
    absent = np.r_[(graph.label == alpha) | (column - alpha < 0) | (column - alpha >= width), graph.label == OCCLUDED]
    graph.gain[absent] = -FORBIDDEN
    graph.gain[pixels:][graph.label == alpha] = -FORBIDDEN  # keeps its assignment: no node
    absent[pixels:] |= graph.label == alpha
    for v in np.flatnonzero(~absent):
        p = v % pixels
        for k, there, exists in ((0, 1, column[p] + 1 < width), (2, width, p + width < pixels)):
            if exists and not absent[v + there]:
                kind = random.randint(3)
                graph.links[v] |= kind << 2 * k
                graph.links[v + there] |= kind << 2 * (k + 1)
    return graph


def as_matrix(graph: Graph, alpha: int) -> csr_matrix:
    """The same network, arc by arc; source and sink come last."""
    pixels, steps = graph.label.size, graph.steps
    matrix = np.zeros((2 * pixels + 2, 2 * pixels + 2), np.int32)
    source, sink = 2 * pixels, 2 * pixels + 1
    for v in range(2 * pixels):
        p = v % pixels
        gain = int(graph.gain[v]) if graph.opened[p] else -MUCH
        matrix[source, v], matrix[v, sink] = max(gain, 0), min(max(-gain, 0), MUCH)
        for k in range(4):
            kind = graph.links[v] >> 2 * k & 3
            if kind:
                matrix[v, v + steps[k]] = (0, CONSTANTS.smoothness_at_edge, CONSTANTS.smoothness)[kind]
    for p in range(pixels):
        if graph.gain[p] > -FORBIDDEN:
            dropped = graph.partner[p - alpha]
            if graph.label[p] != OCCLUDED:
                matrix[p, pixels + p] = MUCH
            if dropped >= 0:
                matrix[p, pixels + dropped] = MUCH
    return csr_matrix(matrix)


def reference(graph: Graph, alpha: int) -> tuple[int, set[int]]:
    """Gain that cannot be drained, and what the source still reaches."""
    network = as_matrix(graph, alpha)
    source, sink = network.shape[0] - 2, network.shape[0] - 1
    result = maximum_flow(network, source, sink)
    residual = network - result.flow
    residual.data = (residual.data > 0).astype(np.int32)
    residual.eliminate_zeros()
    reached = set(breadth_first_order(residual, source, return_predecessors=False).tolist()) - {source}
    return int(network[source].sum()) - result.flow_value, reached


def runs_of(graph: Graph, first: int, stop: int) -> NDArray[np.int32]:
    return np.array([(p, p + 1) for p in range(first, stop) if graph.opened[p]], np.int32).reshape(-1, 2)


def solve(graph: Graph, alpha: int, rows: int, bands: int) -> tuple[int, set[int]]:
    pixels = graph.label.size
    flow: Flow = make_flow(pixels)
    width = pixels // rows
    cuts = [rows * index // bands * width for index in range(bands + 1)]
    whole = Part(alpha, ROUND, pixels, 0, pixels)
    lists: list[Lists] = []
    for first, stop in pairwise(cuts):
        lists.append(make_lists(pixels))
        part = whole._replace(first=first, stop=stop)
        push_nearby(runs_of(graph, first, stop), part, graph, flow, lists[-1])
        push_far(part, graph, flow, lists[-1])
    for other, seam in zip(lists[1:], cuts[1:-1], strict=True):
        join_band(seam, other, whole, graph, flow, lists[0])
    push_far(whole, graph, flow, lists[0])
    return left_over(flow, lists[0]), set(lists[0].region[: lists[0].state[REGION]].tolist())


@pytest.mark.parametrize("bands", [1, 2, 3])
@settings(max_examples=60)
@given(st.integers(0, 10**6), st.integers(3, 6), st.integers(1, 7), st.integers(-2, 3))
def test_flow_and_source_side_equal_scipys(bands: int, seed: int, height: int, width: int, alpha: int) -> None:
    graph = random_graph(seed, height, width, alpha)
    assert solve(graph, alpha, height, bands) == reference(graph, alpha)


def test_long_ways_to_the_sink() -> None:
    """One source at one end of a corridor, one sink at the other: far beyond what push-relabel is allowed."""
    height, width = 3, 60
    graph = make_graph(height, width, CONSTANTS)
    pixels = height * width
    graph.opened[:] = 1
    graph.gain[:pixels] = 0
    graph.gain[0], graph.gain[pixels - 1] = 25, -9
    for p in range(pixels):
        right, lower = (p % width) + 1 < width, p + width < pixels
        for k, there, exists in ((0, 1, right), (2, width, lower)):
            if exists:
                graph.links[p] |= 2 << 2 * k
                graph.links[p + there] |= 2 << 2 * (k + 1)
    left, changed = solve(graph, 0, height, 1)
    assert left == 25 - 9
    assert (left, changed) == reference(graph, 0)
