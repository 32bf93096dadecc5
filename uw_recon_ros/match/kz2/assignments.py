"""The state of the matcher: which assignments are active, and what every switch in the next move would gain alone."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import uint64 as index
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.kz2.constants import Constants
from uw_recon_ros.match.kz2.data_cost import SMOOTH_DOWN, SMOOTH_RIGHT, IntervalImage, row_costs
from uw_recon_ros.match.kz2.energy import OCCLUDED
from uw_recon_ros.match.kz2.graph import FORBIDDEN, Graph, Part

_NO_LABEL = int(OCCLUDED)


class PreparedPair(NamedTuple):
    """What does not change: the images and the constants of the energy.

    Parameters
    ----------
    left, right : IntervalImage
    height, width : int
        px.
    denominator, occlusion_cost : int
        As in `Constants`.
    """

    left: IntervalImage
    right: IntervalImage
    height: int
    width: int
    denominator: int
    occlusion_cost: int


class Costs(NamedTuple):
    """Data costs, squared gray levels: of the assignments (p, p - alpha) now tried, and of the active ones.

    Parameters
    ----------
    tried, active : (n,) int16
    """

    tried: NDArray[np.int16]
    active: NDArray[np.int16]


def _weights(constants: Constants) -> NDArray[np.int32]:
    """Capacities of arcs 0 to 3 by value of `Graph.links`, (1024,) int32."""
    classes = np.array([0, constants.smoothness_at_edge, constants.smoothness, 0], np.int32)
    links = np.arange(256)
    return np.stack([classes[(links >> 2 * k) & 3] for k in range(4)], axis=1).ravel()


def make_graph(height: int, width: int, constants: Constants) -> Graph:
    """Of an empty labelling: nothing is matched."""
    pixels = height * width
    return Graph(
        label=np.full(pixels, OCCLUDED, np.int16),
        partner=np.full(pixels, -1, np.int32),
        gain=np.full(2 * pixels, -FORBIDDEN, np.int32),
        links=np.zeros(2 * pixels, np.uint8),
        opened=np.zeros(pixels, np.uint8),
        weights=_weights(constants),
        steps=np.array([1, -1, width, -width], np.int64),
    )


@kernel
def prepare(runs: NDArray[np.int32], part: Part, scene: PreparedPair, costs: Costs, graph: Graph) -> None:
    """Compute gain and links of switching on (p, p - alpha), for the open pixels of a part."""
    for run in range(runs.shape[0]):
        first, stop = runs[run, 0], runs[run, 1]
        graph.gain[first:stop] = -FORBIDDEN
        row = first // scene.width
        u = max(first - row * scene.width, part.alpha, 0)
        end = min(stop - row * scene.width, min(scene.width, scene.width + part.alpha))
        if u < end:
            _prepare_run(row, u, end, part.alpha, scene, costs, graph)
    first, stop = max(part.first - scene.width, 0), min(part.stop + scene.width, part.pixels)
    for p in range(first, stop):
        if graph.label[index(p)] == part.alpha:
            _keep(p, part, graph)


@kernel
def _prepare_run(row: int, u: int, end: int, alpha: int, scene: PreparedPair, costs: Costs, graph: Graph) -> None:
    """As if no assignment of alpha were active: every loop over plain rows, for the compiler to vectorise.

    Arcs over the first and the last row are closed by `graph.reach`, like all that leave a band.
    """
    start, stop = row * scene.width + u, row * scene.width + end
    tried, gain, links = costs.tried[start:stop], graph.gain[start:stop], graph.links[start:stop]
    row_costs(scene.left, scene.right, row, u, alpha, tried)
    smooth_left, smooth_right = scene.left.smooth, scene.right.smooth
    here_left, here_right = smooth_left[row, u:end], smooth_right[row, u - alpha : end - alpha]
    above = max(row - 1, 0)
    above_left, above_right = smooth_left[above, u:end], smooth_right[above, u - alpha : end - alpha]
    for i in range(stop - start):
        j = index(i)
        here, over = here_left[j] & here_right[j], above_left[j] & above_right[j]
        right, lower, upper = 1 + (here & 1), 1 + (here >> 1), 1 + (over >> 1)
        links[j] = right | lower << 4 | upper << 6
        gain[j] = scene.occlusion_cost - scene.denominator * tried[j]
    _link_left(row, u, end, alpha, scene, links)
    if end == min(scene.width, scene.width + alpha):
        links[links.size - 1] &= np.uint8(0xFC)


@kernel
def _link_left(row: int, u: int, end: int, alpha: int, scene: PreparedPair, links: NDArray[np.uint8]) -> None:
    """The arcs to the left neighbours: their pixels' arcs to the right."""
    skip = 1 if u == max(alpha, 0) else 0
    left = scene.left.smooth[row, u + skip - 1 : end - 1]
    right = scene.right.smooth[row, u + skip - 1 - alpha : end - 1 - alpha]
    target = links[skip:]
    for i in range(target.size):
        j = index(i)
        target[j] |= (1 + (left[j] & right[j] & 1)) << 2


@kernel(allocates=False, inline=True)
def _keep(p: int, part: Part, graph: Graph) -> None:
    """p has alpha and keeps it: neighbours gain by following, and there is no node for p."""
    for k in range(4):
        m, back = p + graph.steps[k], k ^ 1
        if part.first <= m < part.stop and graph.opened[index(m)]:
            graph.gain[index(m)] += graph.weights[index(int(graph.links[index(m)]) * 4 + back)]
            graph.links[index(m)] &= ~(3 << 2 * back)
    if part.first <= p < part.stop and graph.opened[index(p)]:
        graph.gain[index(p)] = -FORBIDDEN
        graph.links[index(p)] = 0


@kernel
def apply_switches(
    changed: NDArray[np.int32],
    move: int,
    part: Part,
    scene: PreparedPair,
    costs: Costs,
    graph: Graph,
    fresh: NDArray[np.int32],
) -> None:
    """Switch the nodes in `changed`; `fresh` remembers the last move each pixel was brought up to date in."""
    pixels = part.pixels
    for v in changed:
        if v >= pixels:
            p = v - pixels
            graph.partner[p - graph.label[p]] = -1
            graph.label[p] = _NO_LABEL
    for v in changed:
        if v < pixels:
            graph.partner[v - part.alpha] = v
            graph.label[v] = part.alpha
            costs.active[v] = costs.tried[v]
    for v in changed:
        p = v if v < pixels else v - pixels
        for k in range(5):
            m = p + graph.steps[k] if k < 4 else p
            if 0 <= m < pixels and fresh[m] != move:
                fresh[m] = move
                _refresh(m, scene, costs, graph)


@kernel(allocates=False, inline=True)
def _refresh(p: int, scene: PreparedPair, costs: Costs, graph: Graph) -> None:
    """Compute gain and links of dropping the active assignment of p."""
    disparity, drop = int(graph.label[p]), p + graph.label.size
    if disparity == _NO_LABEL:
        graph.gain[drop], graph.links[drop] = -FORBIDDEN, 0
        return
    row = p // scene.width
    gain, links = scene.denominator * int(costs.active[p]) - scene.occlusion_cost, 0
    for k in range(4):
        link = _link(row, p - row * scene.width, disparity, k, scene) << 2 * k
        if link and graph.label[p + graph.steps[k]] == disparity:
            links |= link
        elif link:
            gain += int(graph.weights[4 * link + k])
    graph.gain[drop], graph.links[drop] = gain, links


@kernel(allocates=False, inline=True)
def _link(row: int, u: int, disparity: int, k: int, scene: PreparedPair) -> int:
    """Two bits of `Graph.links` for the neighbour in direction k of the assignment (row, u) - (row, u - disparity)."""
    if k == 0:
        exists, bit = u + 1 < min(scene.width, scene.width + disparity), SMOOTH_RIGHT
    elif k == 1:
        exists, bit, u = u > max(disparity, 0), SMOOTH_RIGHT, u - 1
    elif k == 2:
        exists, bit = row + 1 < scene.height, SMOOTH_DOWN
    else:
        exists, bit, row = row > 0, SMOOTH_DOWN, row - 1
    if not exists:
        return 0
    return 2 if scene.left.smooth[row, u] & scene.right.smooth[row, u - disparity] & bit else 1
