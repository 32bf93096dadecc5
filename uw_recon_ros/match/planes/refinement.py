"""Passes of moves over overlapping tiles, in groups whose members cannot meet: any number of threads, the same bits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.data_cost import CostData, Workspace, make_workspace, plane_cost
from uw_recon_ros.match.planes.expansion import Labelling, expand, possible_gain, take_cheaper
from uw_recon_ros.match.planes.min_cut import GridGraph, make_grid
from uw_recon_ros.match.planes.proposals import Sources, disparities, propose, seed_random
from uw_recon_ros.match.planes.thread_pool import run_parallel
from uw_recon_ros.types import FloatImage, Mask

CELL, MARGIN = 24, 8  #: planes are taken from a cell and expanded over it and a margin, px
_APART = 3  # tiles of a group are this many cells apart


class Pass(NamedTuple):
    """One pass over all tiles.

    Parameters
    ----------
    way : int
        How planes are proposed: FIT, POINTS, OWN, NEAR, SHAKEN or BEFORE of `proposals`.
    planes : int
        Proposals a tile.
    cut : bool
        Expand by minimum cuts; else take the cheaper plane, pixel by pixel.
    """

    way: int
    planes: int
    cut: bool


def tile_groups(height: int, width: int, shift: int) -> list[NDArray[np.int64]]:
    """Cells of a grid shifted by `shift`, (N, 4), in groups: no two of a group are near enough to touch."""

    def spans(size: int) -> list[tuple[int, int]]:
        edges = [*range(shift - CELL if shift else 0, size, CELL), size]
        return [(max(a, 0), min(a + CELL, size)) for a in edges[:-1]]

    rows, columns = spans(height), spans(width)
    groups = []
    for i in range(min(_APART, len(rows))):
        for j in range(min(_APART, len(columns))):
            groups.append(np.array([(*r, *c) for r in rows[i::_APART] for c in columns[j::_APART]], np.int64))
    return groups


@kernel
def run_tiles(
    tiles: NDArray[np.int64],
    way: int,
    planes: int,
    cut: bool,
    least_gain: float,
    seed: int,
    sources: Sources,
    view: CostData,
    state: Labelling,
    work: Workspace,
    grid: GridGraph,
) -> None:
    """Try planes in some tiles, one after the other."""
    height, width = state.costs.shape
    random = np.zeros(1, np.uint64)
    for n in range(tiles.shape[0]):
        row, last_row, column, last_column = tiles[n, 0], tiles[n, 1], tiles[n, 2], tiles[n, 3]
        top, bottom = max(0, row - MARGIN), min(height, last_row + MARGIN)
        left, right = max(0, column - MARGIN), min(width, last_column + MARGIN)
        seed_random(seed, row, column, random)
        for trial in range(planes):
            a, b, c, found = propose(
                way, trial, row, last_row, column, last_column, CELL, state.planes, sources, random
            )
            if not found:
                continue
            plane_cost(a, b, c, top, bottom, left, right, view, work)
            if not cut:
                take_cheaper(a, b, c, top, bottom, left, right, work.cost, state)
            elif possible_gain(work.cost, top, bottom, left, right, state.costs) >= least_gain:
                expand(a, b, c, top, bottom, left, right, work.cost, state, grid)


def refine(
    passes: Sequence[Pass],
    least_gain: float,
    seed: int,
    sources: Sources,
    blank: Mask,
    view: CostData,
    state: Labelling,
    threads: int,
) -> None:
    """Run all passes on a labelling, in place.

    Parameters
    ----------
    passes : sequence of Pass
    least_gain : float
        A plane that could save less data cost than this in a tile is not tried by a cut.
    seed : int
    sources : Sources
    blank : (H, W) bool
        Nothing is cut in tiles that lie within it altogether: what they show is left out of the result.
    view : CostData
    state : Labelling
    threads : int
    """
    height, width = blank.shape
    side = CELL + 2 * MARGIN
    memory = [(make_workspace(side), make_grid(side)) for _ in range(threads)]
    for number, one in enumerate(passes):
        for group in tile_groups(height, width, number * CELL // 2 % CELL):
            if one.cut:
                group = group[_textured(group, blank)]

            def work(worker: int, group: NDArray[np.int64] = group, one: Pass = one, number: int = number) -> None:
                workspace, grid = memory[worker]
                mine = np.ascontiguousarray(group[worker::threads])
                seeds = seed * 1000 + number
                run_tiles(mine, one.way, one.planes, one.cut, least_gain, seeds, sources, view, state, workspace, grid)

            run_parallel(work, range(threads), threads)


def _textured(tiles: NDArray[np.int64], blank: Mask) -> NDArray[np.bool_]:
    """Whether any pixel that a move in the tile could change is not blank."""
    height, width = blank.shape
    count = cv2.integral(blank.view(np.uint8))
    top, left = np.maximum(tiles[:, [0, 2]] - MARGIN, 0).T
    bottom, right = np.minimum(tiles[:, 1] + MARGIN, height), np.minimum(tiles[:, 3] + MARGIN, width)
    inside = count[bottom, right] - count[top, right] - count[bottom, left] + count[top, left]
    return np.asarray(inside < (bottom - top) * (right - left))


def disparity_of(planes: FloatImage) -> FloatImage:
    """The map of a labelling, px."""
    disparity = np.empty((planes.shape[1], planes.shape[2]), np.float32)
    disparities(planes, 0, disparity.shape[0], disparity)
    return disparity
