"""The oracle against an even plainer reading of the definition, and by hand."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from helpers.match_scenes import cost, random_labels, random_pair
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uw_recon_ros.match.kz2.constants import Constants
from uw_recon_ros.match.kz2.energy import OCCLUDED, check_unique, energy

CONSTANTS = Constants(denominator=3, occlusion_cost=200, smoothness=90, smoothness_at_edge=31)


def exist(one: tuple[int, int, int], other: tuple[int, int, int], height: int, width: int) -> bool:
    return all(v < height and 0 <= u < width and 0 <= u - d < width for v, u, d in (one, other))


def by_definition(left: NDArray[np.uint8], right: NDArray[np.uint8], labels: NDArray[np.int16], c: Constants) -> int:
    """Sums over assignments and over pairs of neighbouring assignments, as the formula says."""
    height, width = labels.shape
    active = {(v, u, int(labels[v, u])) for v, u in np.argwhere(labels != OCCLUDED).tolist()}
    total = sum(c.denominator * cost(left, right, *a) - c.occlusion_cost for a in active)
    for v, u, (dv, du) in itertools.product(range(height), range(width), ((0, 1), (1, 0))):
        for d in range(-width, width + 1):
            one, other = (v, u, d), (v + dv, u + du, d)
            if not all(
                row < height and 0 <= column < width and 0 <= column - d < width for row, column, _ in (one, other)
            ):
                continue
            if (one in active) != (other in active):
                steps = [
                    abs(image[v, u + shift].astype(int) - image[v + dv, u + du + shift]).max()
                    for image, shift in ((left, 0), (right, -d))
                ]
                total += c.smoothness if max(steps) < 8 else c.smoothness_at_edge
    return total


@settings(max_examples=40)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 7), st.sampled_from([1, 3]))
def test_energy_is_the_sum_the_definition_asks_for(seed: int, height: int, width: int, channels: int) -> None:
    random = np.random.RandomState(seed)
    left, right = random_pair(random, height, width, channels)
    labels = random_labels(random, height, width, -2, 3)
    images = (left, right) if channels == 3 else (left[:, :, 0], right[:, :, 0])
    assert energy(*images, labels, CONSTANTS) == by_definition(left, right, labels, CONSTANTS)


def test_energy_by_hand() -> None:
    """Two pixels, same gray everywhere; one assignment switched on breaks one link."""
    flat = np.full((1, 2), 100, np.uint8)
    labels = np.array([[0, OCCLUDED]], np.int16)
    assert energy(flat, flat, labels, CONSTANTS) == -200 + 90
    assert energy(flat, flat, np.zeros((1, 2), np.int16), CONSTANTS) == -400
    assert energy(flat, flat, np.full((1, 2), OCCLUDED, np.int16), CONSTANTS) == 0
    edge = np.array([[100, 108]], np.uint8)  # a difference of 8 is an edge; D stays 0
    assert energy(edge, flat, labels, CONSTANTS) == -200 + 31


def test_labelling_must_be_unique_and_inside() -> None:
    with pytest.raises(ValueError, match="at most one assignment a right pixel"):
        check_unique(np.array([[0, 1]], np.int16))
    with pytest.raises(ValueError, match="inside the right image"):
        check_unique(np.array([[1, OCCLUDED]], np.int16))
