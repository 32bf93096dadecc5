"""Which tiles take part in a move: against the rule, tile by tile."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.match.kz2.energy import OCCLUDED
from uw_recon_ros.match.kz2.tiles import TILE_HEIGHT, TILE_WIDTH, Tiles, make_tiles, most_runs, note_changes, open_tiles

HEIGHT, WIDTH = 43, 150
ALPHAS = (-20, -3, 0, 7, 40)


def opened_by(tiles: Tiles, label: int, move: int) -> np.ndarray:
    opened = np.zeros(HEIGHT * WIDTH, np.uint8)
    runs = np.zeros((most_runs(HEIGHT, WIDTH), 2), np.int32)
    count = open_tiles(label, ALPHAS[label], move, WIDTH, tiles, opened, runs)
    covered = np.zeros(HEIGHT * WIDTH, np.uint8)
    for first, stop in runs[:count]:
        assert first // WIDTH == (stop - 1) // WIDTH
        covered[first:stop] += 1
    assert np.array_equal(covered, opened)
    return opened.reshape(HEIGHT, WIDTH)


def expected_for(alpha: int, v: int, u: int, disparity: int) -> np.ndarray:
    """Tiles next to the changed pixel's, and tiles that alpha takes next to the changed partner's."""
    expected = np.zeros((HEIGHT, WIDTH), np.uint8)
    for top in range(0, HEIGHT, TILE_HEIGHT):
        for start in range(0, WIDTH, TILE_WIDTH):
            near_row = abs(top // TILE_HEIGHT - v // TILE_HEIGHT) <= 1
            near_left = abs(start // TILE_WIDTH - u // TILE_WIDTH) <= 1
            around = range(start - TILE_WIDTH - alpha, start + 2 * TILE_WIDTH - alpha)
            near_right = (u - disparity) // TILE_WIDTH in {column // TILE_WIDTH for column in around}
            if near_row and (near_left or near_right):
                expected[top : top + TILE_HEIGHT, start : start + TILE_WIDTH] = 1
    return expected


@settings(max_examples=60)
@given(
    st.integers(0, HEIGHT - 1),
    st.integers(0, WIDTH - 1),
    st.sampled_from(ALPHAS),
    st.sampled_from(range(5)),
    st.booleans(),
)
def test_a_change_reopens_what_it_may_concern(v: int, u: int, disparity: int, label: int, dropped: bool) -> None:
    if not 0 <= u - disparity < WIDTH:
        return
    tiles = make_tiles(HEIGHT, WIDTH, len(ALPHAS))
    labels = np.full(HEIGHT * WIDTH, OCCLUDED, np.int16)
    for index in range(len(ALPHAS)):
        assert opened_by(tiles, index, 1 + index).all()
        assert not opened_by(tiles, index, 1 + index).any()
    p = v * WIDTH + u
    if dropped:
        labels[p] = disparity
    node = p + HEIGHT * WIDTH if dropped else p
    note_changes(np.array([node], np.int32), 99 if dropped else disparity, 9, WIDTH, labels, tiles)
    assert np.array_equal(opened_by(tiles, label, 10), expected_for(ALPHAS[label], v, u, disparity))
    assert not opened_by(tiles, label, 11).any()


@pytest.mark.parametrize("label", range(5))
def test_tiles_of_a_move_that_changed_something_are_tried_again(label: int) -> None:
    """What lay outside the move may make more of the change."""
    tiles = make_tiles(HEIGHT, WIDTH, len(ALPHAS))
    opened_by(tiles, label, 1)
    note_changes(np.array([60], np.int32), ALPHAS[label], 1, WIDTH, np.zeros(HEIGHT * WIDTH, np.int16), tiles)
    assert np.array_equal(opened_by(tiles, label, 2), expected_for(ALPHAS[label], 0, 60, ALPHAS[label]))
