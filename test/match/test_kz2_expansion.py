"""Every move against all moves there are, on images of a few pixels; larger ones against the oracle."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest
from helpers.match_scenes import random_pair
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uw_recon_ros.match.kz2.constants import Constants, make_constants
from uw_recon_ros.match.kz2.data_cost import make_interval_image
from uw_recon_ros.match.kz2.energy import OCCLUDED, check_unique, energy
from uw_recon_ros.match.kz2.expansion import Expansion
from uw_recon_ros.match.kz2.matcher import kz2

Image = NDArray[np.uint8]
SHAPES = st.sampled_from([(1, 5), (2, 2), (5, 1), (1, 4), (2, 3), (3, 1), (1, 1)])


def moves(labels: NDArray[np.int16], alpha: int, alpha_stays: bool) -> Iterator[NDArray[np.int16]]:
    """All labellings within one expansion: each active assignment kept or not, each one of alpha active or not."""
    pixels = [tuple(index) for index in np.argwhere(labels != 1000)]
    choices = []
    for v, u in pixels:
        possible = {int(labels[v, u]), int(OCCLUDED)}
        if alpha_stays and labels[v, u] == alpha:
            possible = {alpha}
        elif 0 <= u - alpha < labels.shape[1]:
            possible.add(alpha)
        choices.append(sorted(possible))
    for chosen in itertools.product(*choices):
        candidate = np.array(chosen, np.int16).reshape(labels.shape)
        try:
            check_unique(candidate)
        except ValueError:
            continue
        yield candidate


def best(left: Image, right: Image, constants: Constants, candidates: Iterator[NDArray[np.int16]]) -> int:
    return min(energy(left, right, labels, constants) for labels in candidates)


@settings(max_examples=40)
@given(st.integers(0, 10**6), SHAPES, st.sampled_from([1, 3]), st.sampled_from([40.0, 120.0, 300.0]))
def test_each_move_is_the_best_there_is(
    seed: int, shape: tuple[int, int], channels: int, occlusion_cost: float
) -> None:
    random = np.random.RandomState(seed)
    left, right = random_pair(random, *shape, channels)
    constants = make_constants(occlusion_cost, random.choice([5.0, 30.0]))
    expansion = Expansion(make_interval_image(left), make_interval_image(right), -1, 2, constants)
    with ThreadPoolExecutor(1) as executor:
        for alpha in random.randint(-1, 3, 4).tolist():
            expected = best(left, right, constants, moves(expansion.labels, alpha, alpha_stays=True))
            expansion.expand(alpha, executor)
            assert expansion.energy == energy(left, right, expansion.labels, constants) == expected


@settings(max_examples=25)
@given(st.integers(0, 10**6), SHAPES, st.sampled_from([40.0, 120.0]))
def test_in_the_end_no_expansion_helps_not_even_one_that_drops_alpha(
    seed: int, shape: tuple[int, int], occlusion_cost: float
) -> None:
    random = np.random.RandomState(seed)
    left, right = random_pair(random, *shape, 3)
    result = kz2(left, right, -1, 2, sweeps=20, seed=seed, occlusion_cost=occlusion_cost, smoothness=12.0)
    assert len(result.energies) < 20
    for alpha in range(-1, 3):
        assert best(left, right, result.constants, moves(result.labels, alpha, alpha_stays=False)) >= result.energy


@settings(max_examples=20)
@given(st.integers(0, 10**6), st.integers(1, 60), st.integers(1, 60), st.integers(-9, 3), st.integers(1, 8))
def test_reported_energy_is_true_and_never_rises(seed: int, height: int, width: int, low: int, extent: int) -> None:
    left, right = random_pair(np.random.RandomState(seed), height, width, 3)
    energies = []
    for sweeps in range(1, 4):
        result = kz2(left, right, low, low + extent, sweeps=sweeps, seed=seed, occlusion_cost=150.0)
        assert result.energy == energy(left, right, result.labels, result.constants)
        assert energies == list(result.energies[: len(energies)])
        energies = list(result.energies)
    assert [0, *energies] == sorted([0, *energies], reverse=True)
    assert set(np.unique(result.labels)) <= {OCCLUDED, *range(low, low + extent + 1)}


@pytest.mark.parametrize("threads", [2, 3, 7])
def test_same_bits_whatever_the_number_of_threads(threads: int) -> None:
    random = np.random.RandomState(3)
    left = random.randint(0, 256, (190, 120, 3)).astype(np.uint8)
    right = np.clip(np.roll(left, -3, axis=1) + random.normal(0, 15, left.shape), 0, 255).astype(np.uint8)
    alone = kz2(left, right, 0, 7)
    shared = kz2(left, right, 0, 7, threads=threads)
    assert alone.energies == shared.energies
    assert np.array_equal(alone.labels, shared.labels)


def test_tags_may_be_cleared_between_moves(monkeypatch: pytest.MonkeyPatch) -> None:
    left, right = random_pair(np.random.RandomState(8), 30, 50, 3)
    usual = kz2(left, right, 0, 9)
    monkeypatch.setattr("uw_recon_ros.match.kz2.expansion._LAST_ROUND", 2)
    assert np.array_equal(kz2(left, right, 0, 9).labels, usual.labels)


def test_resting_tiles_cost_next_to_nothing() -> None:
    """Against all tiles open in every move."""
    random = np.random.RandomState(5)
    texture = cv2.GaussianBlur(random.uniform(0, 255, (96, 200, 3)), (0, 0), 3)
    left = cv2.normalize(texture, None, 0, 255, cv2.NORM_MINMAX).astype(np.uint8)
    shift = np.repeat([3, 5, 4, 6], 24)
    right = np.stack([np.roll(row, -d, axis=0) for row, d in zip(left, shift, strict=True)])
    right = np.clip(right + random.normal(0, 20, left.shape), 0, 255).astype(np.uint8)
    order = [random.permutation(10).tolist() for _ in range(4)]
    energies = []
    for always in (False, True):
        expansion = Expansion(make_interval_image(left), make_interval_image(right), 0, 9, make_constants(60.0, 12.0))
        after = []
        with ThreadPoolExecutor(1) as executor:
            for labels in order:
                for alpha in labels:
                    if always:
                        expansion.tiles.tried[:] = -1
                    expansion.expand(alpha, executor)
                after.append(expansion.energy)
        energies.append(after)
    assert energies[1][3] < energies[1][0]
    assert energies[0] == pytest.approx(energies[1], rel=1e-4)
