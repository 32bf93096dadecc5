"""The data cost of a plane against its definition: how far it lies from the start."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uw_recon_ros.match.planes.census import CLOSE
from uw_recon_ros.match.planes.data_cost import (
    FAR_FROM_START,
    NEAR_START,
    CostData,
    cost_weights,
    extend_borders,
    make_workspace,
    plane_cost,
    trust_in,
)

HEIGHT, WIDTH, SIDE = 14, 30, 12
TRUST = 0.3
Map = NDArray[np.float32]


def view(seed: int, start: Map, trust: Map) -> CostData:
    """Two unrelated views, crosses of one pixel."""
    rng = np.random.default_rng(seed)
    softness, sign = cost_weights(0.0)
    gray, other = (rng.integers(-500, 500, (HEIGHT, n)).astype(np.int16) for n in (WIDTH, 4 * WIDTH - 3))
    return CostData(
        extend_borders(gray), np.int16(softness), np.int16(sign), np.int16(12 * (softness + sign)),
        np.full((HEIGHT, WIDTH), 100, np.int16), CLOSE, other, np.zeros((4, HEIGHT, WIDTH), np.uint8),
        np.ones((HEIGHT, WIDTH), np.float32), np.float32(0), np.float32(9), start, trust,
    )  # fmt: skip


def cost(data: CostData, plane: tuple[float, float, float]) -> Map:
    work = make_workspace(SIDE)
    plane_cost(*(np.float32(x) for x in plane), 1, 1 + SIDE, 10, 10 + SIDE, data, work)
    return work.cost.copy()


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 99), a=st.floats(-0.3, 0.3), b=st.floats(-0.3, 0.3), c=st.floats(2, 6))
def test_a_plane_far_from_the_start_costs_more_and_no_other(seed: int, a: float, b: float, c: float) -> None:
    rng = np.random.default_rng(seed)
    start, usable = rng.uniform(1, 8, (HEIGHT, WIDTH)).astype(np.float32), rng.random((HEIGHT, WIDTH)) < 0.6
    without = cost(view(seed, start, np.zeros_like(start)), (a, b, c))
    more = cost(view(seed, start, trust_in(usable, 0.0, TRUST)), (a, b, c)) - without
    v, u = np.mgrid[1 : 1 + SIDE, 10 : 10 + SIDE]
    apart = np.abs(a * u + b * v + c - start[v, u])
    expected = np.interp(apart, (NEAR_START, FAR_FROM_START), (0, TRUST)) * usable[v, u]
    assert np.allclose(more, expected, atol=1e-4)


def test_a_start_of_noisy_images_is_not_believed() -> None:
    usable = np.ones((2, 3), np.bool_)
    assert np.array_equal(trust_in(usable, 1.0, TRUST), np.zeros((2, 3), np.float32))
    assert (trust_in(usable, 0.5, TRUST) < trust_in(usable, 0.0, TRUST)).all()
