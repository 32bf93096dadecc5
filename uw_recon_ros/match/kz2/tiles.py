"""Which parts of the image are worth trying again with a label: those where something changed since the last try.

An expansion depends on the labels around a pixel in the left view, and, by uniqueness, on those around its partner in
the right view. A tile takes part in a move if either neighbourhood changed in or after the last move of that label in
which it took part; the rest stays as it is for this move.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel

TILE_WIDTH, TILE_HEIGHT = 16, 8


class Tiles(NamedTuple):
    """When each tile changed and was tried: numbers of moves.

    Parameters
    ----------
    changed_left, changed_right : (rows, columns) int32
        Last change of a label in the left view, of a partner in the right view.
    tried : (labels, rows, columns) int32
        Last move of each label in which the tile took part; -1: never.
    """

    changed_left: NDArray[np.int32]
    changed_right: NDArray[np.int32]
    tried: NDArray[np.int32]


def make_tiles(height: int, width: int, labels: int) -> Tiles:
    """All tiles untried."""
    shape = -(-height // TILE_HEIGHT), -(-width // TILE_WIDTH)
    return Tiles(np.zeros(shape, np.int32), np.zeros(shape, np.int32), np.full((labels, *shape), -1, np.int32))


def most_runs(height: int, width: int) -> int:
    """How many runs `open_tiles` can write at most."""
    return height * (-(-width // TILE_WIDTH) // 2 + 1)


@kernel
def open_tiles(
    label: int,
    alpha: int,
    move: int,
    width: int,
    tiles: Tiles,
    opened: NDArray[np.uint8],
    runs: NDArray[np.int32],
) -> int:
    """Open the tiles that take part in a move and close the others.

    Parameters
    ----------
    label : int
        Index of the disparity `alpha`, px.
    move : int
        Number of the move.
    width : int
        px.
    opened : (n,) uint8
        Written: 1 for the pixels that take part.
    runs : (m, 2) int32
        Written: first pixel, and one past the last, of the stretches of rows that take part, in order.

    Returns
    -------
    int
        Number of runs.
    """
    rows, columns = tiles.changed_left.shape
    height = opened.size // width
    for i in range(rows):
        for j in range(columns):
            dirty = _last_change(i, j, alpha, tiles) >= tiles.tried[label, i, j]
            if dirty:
                tiles.tried[label, i, j] = move
            for v in range(i * TILE_HEIGHT, min(height, (i + 1) * TILE_HEIGHT)):
                opened[v * width + j * TILE_WIDTH : v * width + min(width, (j + 1) * TILE_WIDTH)] = dirty
    return _find_runs(width, opened, runs)


@kernel
def _last_change(i: int, j: int, alpha: int, tiles: Tiles) -> int:
    """Of a tile or its neighbours, and of the tiles of the right view that alpha takes them to."""
    rows, columns = tiles.changed_left.shape
    first = max(0, ((j - 1) * TILE_WIDTH - alpha) // TILE_WIDTH)
    last = min(columns - 1, ((j + 2) * TILE_WIDTH - 1 - alpha) // TILE_WIDTH)
    latest = 0
    for m in range(max(0, i - 1), min(rows, i + 2)):
        for n in range(max(0, j - 1), min(columns, j + 2)):
            latest = max(latest, tiles.changed_left[m, n])
        for n in range(first, last + 1):
            latest = max(latest, tiles.changed_right[m, n])
    return latest


@kernel
def _find_runs(width: int, opened: NDArray[np.uint8], runs: NDArray[np.int32]) -> int:
    count = 0
    for row in range(opened.size // width):
        before = 0
        for p in range(row * width, (row + 1) * width):
            if opened[p] and not before:
                runs[count, 0] = p
            if before and not opened[p]:
                runs[count, 1] = p
                count += 1
            before = opened[p]
        if before:
            runs[count, 1] = (row + 1) * width
            count += 1
    return count


@kernel
def note_changes(
    changed: NDArray[np.int32], alpha: int, move: int, width: int, label: NDArray[np.int16], tiles: Tiles
) -> None:
    """Note which tiles a move changes; to be called before it is made.

    Parameters
    ----------
    changed : (m,) int32
        Nodes: pixel that gets alpha, or number of pixels + pixel that loses its label.
    label : (n,) int16
        Labels before the move.
    """
    for v in changed:
        p = v if v < label.size else v - label.size
        disparity = alpha if v < label.size else int(label[p])
        row, u = p // width, p % width
        tiles.changed_left[row // TILE_HEIGHT, u // TILE_WIDTH] = move
        tiles.changed_right[row // TILE_HEIGHT, (u - disparity) // TILE_WIDTH] = move
