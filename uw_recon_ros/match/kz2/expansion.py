"""Alpha-expansion after Kolmogorov and Zabih (2002): the best labelling that one label can make of the present one."""

from __future__ import annotations

from concurrent.futures import Executor
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.kz2.assignments import Costs, PreparedPair, apply_switches, make_graph, prepare
from uw_recon_ros.match.kz2.constants import Constants
from uw_recon_ros.match.kz2.data_cost import IntervalImage
from uw_recon_ros.match.kz2.energy import Labels
from uw_recon_ros.match.kz2.graph import REGION, ROUND, ROUNDS, Flow, Graph, Lists, Part, make_flow, make_lists
from uw_recon_ros.match.kz2.max_flow import join_band, left_over, push_far
from uw_recon_ros.match.kz2.push_relabel import push_nearby
from uw_recon_ros.match.kz2.tiles import make_tiles, most_runs, note_changes, open_tiles

_LAST_ROUND = 1024  # tags are cleared when a move would start beyond: they are 32-bit integers
_LEAST_BAND = 24  # rows: smaller bands are not worth their seams


class Expansion:
    """A labelling that gets better move by move. At first nothing is matched: energy 0.

    Parameters
    ----------
    left, right : IntervalImage
    min_disparity, max_disparity : int
        Inclusive, px.
    constants : Constants
    threads : int
        At most so many share a move. The result does not depend on it.

    Attributes
    ----------
    energy : int
        Of the present labelling, times ``constants.denominator``, as the flows give it.
    """

    def __init__(
        self,
        left: IntervalImage,
        right: IntervalImage,
        min_disparity: int,
        max_disparity: int,
        constants: Constants,
        threads: int = 1,
    ) -> None:
        height, width = left.smooth.shape
        self.energy = 0
        self._min_disparity = min_disparity
        self._move = 0
        self._scene = PreparedPair(left, right, height, width, constants.denominator, constants.occlusion_cost)
        self._graph = make_graph(height, width, constants)
        self._costs = Costs(np.zeros(height * width, np.int16), np.zeros(height * width, np.int16))
        self._flow = make_flow(height * width)
        self.tiles = make_tiles(height, width, max_disparity - min_disparity + 1)
        self._runs = np.zeros((most_runs(height, width), 2), np.int32)
        self._fresh = np.zeros(height * width, np.int32)
        self._bands = _make_bands(height, width, threads)
        self._lists = [
            make_lists(height * width if index == 0 else stop - first)
            for index, (first, stop) in enumerate(self._bands)
        ]
        self._round = 0

    @property
    def labels(self) -> Labels:
        """(H, W) int16: disparities of the left pixels, px; `OCCLUDED` = none. A copy."""
        labels: Labels = self._graph.label.reshape(self._scene.height, self._scene.width).copy()
        return labels

    def expand(self, alpha: int, executor: Executor) -> int:
        """Make the best move that keeps or drops each active assignment and switches on any of disparity `alpha`.

        Only tiles that may have changed their mind since `alpha` was last tried take part (see `tiles`).

        Returns
        -------
        int
            By how much the energy fell.
        """
        self._move += 1
        label, width = alpha - self._min_disparity, self._scene.width
        count = open_tiles(label, alpha, self._move, width, self.tiles, self._graph.opened, self._runs)
        if count == 0:
            return 0
        whole = Part(alpha, self._next_base(), self._graph.label.size, 0, self._graph.label.size)
        self._solve_bands(whole, self._runs[:count], executor)
        if len(self._lists) > 1:
            self._join(whole)
        self._round = int(self._lists[0].state[ROUNDS])
        return self._act(whole) if self._lists[0].state[REGION] else 0

    def _next_base(self) -> int:
        """Least tag of a new move."""
        if self._round >= _LAST_ROUND:
            self._flow.tag[:] = 0
            self._round = 0
        return (self._round + 1) * ROUND

    def _solve_bands(self, whole: Part, runs: NDArray[np.int32], executor: Executor) -> None:
        parts = [whole._replace(first=first, stop=stop) for first, stop in self._bands]
        cuts = np.searchsorted(runs[:, 0], [part.first for part in parts] + [whole.pixels])
        pieces = [runs[first:stop] for first, stop in pairwise(cuts)]

        def solve(part: Part, piece: NDArray[np.int32], lists: Lists) -> None:
            _solve(piece, part, self._scene, self._costs, self._graph, self._flow, lists)

        if len(parts) == 1:
            solve(parts[0], pieces[0], self._lists[0])
        else:
            list(executor.map(solve, parts, pieces, self._lists))

    def _join(self, whole: Part) -> None:
        for lists, (first, _) in zip(self._lists[1:], self._bands[1:], strict=True):
            join_band(first, lists, whole, self._graph, self._flow, self._lists[0])
        push_far(whole, self._graph, self._flow, self._lists[0])

    def _act(self, whole: Part) -> int:
        lists = self._lists[0]
        fall = int(left_over(self._flow, lists))
        region = lists.region[: lists.state[REGION]]
        note_changes(region, whole.alpha, self._move, self._scene.width, self._graph.label, self.tiles)
        apply_switches(region, self._move, whole, self._scene, self._costs, self._graph, self._fresh)
        self.energy -= fall
        return fall


@kernel
def _solve(
    runs: NDArray[np.int32], part: Part, scene: PreparedPair, costs: Costs, graph: Graph, flow: Flow, lists: Lists
) -> None:
    """All of a move that concerns one band alone."""
    prepare(runs, part, scene, costs, graph)
    push_nearby(runs, part, graph, flow, lists)
    push_far(part, graph, flow, lists)


def _make_bands(height: int, width: int, threads: int) -> list[tuple[int, int]]:
    """First and one past the last pixel of each band of rows."""
    count = max(1, min(threads, height // _LEAST_BAND))
    rows = [height * index // count for index in range(count + 1)]
    return [(first * width, stop * width) for first, stop in pairwise(rows)]
