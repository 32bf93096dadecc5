"""The compiled cost and the constants against plain readings of their definitions."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from helpers.match_scenes import STEREO, cost, random_pair
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.files.images import read_image
from uw_recon_ros.match.kz2.constants import Constants, automatic_occlusion_cost, make_constants
from uw_recon_ros.match.kz2.data_cost import make_interval_image, row_costs

#: K, lambda_1, lambda_2 of the reference, exactly.
TABLE = {
    "tsukuba": (16, Constants(9, 125, 75, 25)),
    "venus": (20, Constants(15, 170, 102, 34)),
    "teddy": (60, Constants(16, 1079, 647, 216)),
    "cones": (60, Constants(8, 835, 501, 167)),
}


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 4), st.integers(1, 9), st.sampled_from([1, 3]), st.integers(-4, 4))
def test_row_costs_are_symmetric_birchfield_tomasi(
    seed: int, height: int, width: int, channels: int, disparity: int
) -> None:
    left, right = random_pair(np.random.RandomState(seed), height, width, channels)
    start, stop = max(0, disparity), min(width, width + disparity)
    for row in range(height):
        costs = np.zeros(max(stop - start, 0), np.int16)
        row_costs(make_interval_image(left), make_interval_image(right), row, start, disparity, costs)
        assert costs.tolist() == [cost(left, right, row, u, disparity) for u in range(start, stop)]


@settings(max_examples=30)
@given(st.integers(0, 10**6), st.integers(1, 3), st.integers(1, 12), st.integers(-5, 3), st.integers(0, 9))
def test_occlusion_cost_is_the_mean_quartile_of_the_costs(
    seed: int, height: int, width: int, low: int, extent: int
) -> None:
    left, right = random_pair(np.random.RandomState(seed), height, width, 3)
    columns = [[d for d in range(low, low + extent + 1) if 0 <= u - d < width] for u in range(width)]
    most = max(len(labels) for labels in columns)
    k = max(1, (most + 2) // 4)
    smallest = [
        sorted(cost(left, right, v, u, d) for d in labels)[k - 1]
        for v in range(height)
        for u, labels in enumerate(columns)
        if labels and len(labels) == most
    ]
    found = automatic_occlusion_cost(make_interval_image(left), make_interval_image(right), low, low + extent)
    assert found == pytest.approx(max(1.0, float(np.mean(smallest)) if smallest else 1.0))


@settings(max_examples=50)
@given(st.floats(1, 1000), st.floats(0.2, 300))
def test_fractions_are_the_best_of_their_kind(occlusion_cost: float, smoothness: float) -> None:
    constants = make_constants(occlusion_cost, smoothness)
    wanted = [Fraction(occlusion_cost), 3 * Fraction(smoothness), Fraction(smoothness)]

    def error(numerators: list[int], denominator: int) -> Fraction:
        return sum((abs(n / (denominator * w) - 1) for n, w in zip(numerators, wanted, strict=True)), Fraction(0))

    found = [constants.occlusion_cost, constants.smoothness, constants.smoothness_at_edge]
    others = [error([round(m * w) for w in wanted], m) for m in range(1, 17)]
    assert 1 <= constants.denominator <= 16
    assert error(found, constants.denominator) <= min(others) + Fraction(1, 10**9)


@pytest.mark.parametrize("name", TABLE)
def test_reference_constants(name: str) -> None:
    if not STEREO.is_dir():
        pytest.skip(f"{STEREO} is not here")
    labels, expected = TABLE[name]
    left, right = (make_interval_image(read_image(STEREO / name / f"{side}.png")) for side in ("left", "right"))
    occlusion_cost = automatic_occlusion_cost(left, right, 0, labels - 1)
    assert make_constants(occlusion_cost, occlusion_cost / 5) == expected
