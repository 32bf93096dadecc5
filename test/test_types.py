"""Depth and disparity are each other's inverse, offsets and signs included."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.types import StereoGeometry


def test_depth_of_a_projected_point_with_shifted_principal_points() -> None:
    geometry = StereoGeometry(focal_px=400.0, cx_left=310.0, cx_right=330.0, cy=240.0, baseline_m=0.2)
    x, z = 0.35, 1.6
    u_left = 400.0 * x / z + 310.0
    u_right = 400.0 * (x - 0.2) / z + 330.0
    depth = geometry.depth_from_disparity(np.array([u_left - u_right], np.float32))
    assert abs(depth[0] - z) < 1e-5


@settings(max_examples=50)
@given(st.floats(0.2, 50), st.floats(-30, 30), st.sampled_from([0.12, -0.12, None]), st.sampled_from([1, -1]))
def test_round_trip(depth: float, offset: float, baseline: float | None, sign: int) -> None:
    geometry = StereoGeometry(500.0, 300.0, 300.0 + offset, 200.0, baseline, "vertical", sign)
    z = np.array([depth], np.float32)
    assert np.allclose(geometry.depth_from_disparity(geometry.disparity_from_depth(z)), z, rtol=1e-3)


def test_points_at_or_behind_infinity_have_no_depth() -> None:
    geometry = StereoGeometry(500.0, 300.0, 310.0, 200.0, 0.1)
    assert np.isnan(geometry.depth_from_disparity(np.array([-10.0, -11.0, np.nan], np.float32))).all()


def test_sigma_is_the_derivative_of_depth() -> None:
    geometry = StereoGeometry(500.0, 300.0, 310.0, 200.0, -0.1)
    disparity, step = np.array([-60.0], np.float64), 1e-3
    z = [np.float64(geometry.focal_times_baseline) / (disparity + s + geometry.offset_px) for s in (0, step)]
    sigma = geometry.depth_sigma(z[0].astype(np.float32), np.array([1.0], np.float32))
    assert np.allclose(abs(z[1] - z[0]) / step, sigma, rtol=1e-3)
