import numpy as np
import pytest

from uw_recon_ros.rectify.plane_at_infinity import DEPTH_RATIO, baseline_side, infinity_shift

NEAR = np.linspace(20, 60, 50)
BOTH = np.linspace(-30, 30, 50)


@pytest.mark.parametrize(
    ("parallax", "sigma", "lens", "side"),
    [
        (NEAR, 1.0, 5.0, 1),
        (-NEAR, 1.0, 5.0, -1),
        (NEAR, 20.0, 20.0, 0),  # infinity badly known
        (-NEAR, 1.0, 30.0, 0),  # another lens would turn it round
        (BOTH, 0.1, 0.1, 0),
    ],
)
def test_side(parallax, sigma, lens, side):
    assert baseline_side(parallax, sigma, lens) == side


def test_a_few_wrong_matches_do_not_turn_the_rig():
    parallax = NEAR.copy()
    parallax[:2] = -100
    assert baseline_side(parallax, 1.0) == 1


def test_infinity_stays_where_all_points_lie_in_front():
    assert infinity_shift(NEAR) == 0.0


@pytest.mark.parametrize("parallax", [BOTH, NEAR - 19.9, NEAR - 200.0])
def test_infinity_moves_until_the_depth_ratio_is_met(parallax):
    moved = parallax + infinity_shift(parallax)
    far, near = np.quantile(moved, [0.02, 0.98])
    assert far > 0
    assert near / far == pytest.approx(DEPTH_RATIO)
