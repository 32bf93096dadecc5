"""Depth and points against projections of known points through both cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.reconstruct_scenes import ABOVE, GEOMETRIES, HORIZONTAL, disparity_map, plane_depth, rays
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uw_recon_ros.reconstruct.triangulation import normals_from_slopes, points_from_depth, triangulate
from uw_recon_ros.types import Status, StereoGeometry


def project(points, geometry):
    """Pixels of `points` in both views, written out from the pinhole camera."""
    baseline = geometry.baseline_sign if geometry.baseline_m is None else geometry.baseline_m
    shift = np.array([baseline, 0, 0]) if geometry.axis == "horizontal" else np.array([0, baseline, 0])
    across = geometry.focal_across_px or geometry.focal_px
    pixels = []
    for origin, centre in ((0 * shift, geometry.cx_left), (shift, geometry.cx_right)):
        x, y, z = (points - origin).T
        if geometry.axis == "horizontal":
            pixels.append((geometry.focal_px * x / z + centre, across * y / z + geometry.cy))
        else:
            pixels.append((across * x / z + geometry.cy, geometry.focal_px * y / z + centre))
    return pixels


def points_on_pixels(geometry):
    """Points at random depths that project to whole pixels of the left view."""
    depth = np.random.default_rng(1).uniform(0.8, 5.0, (120, 160))
    return (rays(geometry) * depth[..., None]).reshape(-1, 3)


@pytest.mark.parametrize("name", GEOMETRIES)
def test_points_come_back_from_their_two_projections(name):
    geometry = GEOMETRIES[name]
    truth = points_on_pixels(geometry)
    (left_u, left_v), (right_u, right_v) = project(truth, geometry)
    disparity = left_u - right_u if geometry.axis == "horizontal" else left_v - right_v
    image = disparity.reshape(120, 160).astype(np.float32)
    zero = np.zeros((120, 160), np.uint8)
    depth, _, status = triangulate(image, np.full_like(image, 0.1), zero, geometry)
    points = points_from_depth(depth, geometry, "rectified")
    assert not status.any()
    np.testing.assert_allclose(points.reshape(-1, 3), truth, rtol=2e-5, atol=1e-5)


@settings(max_examples=20)
@given(st.floats(-300, 300), st.floats(-300, 300), st.sampled_from(sorted(GEOMETRIES)))
def test_a_shift_of_either_principal_point_is_taken_out_again(left, right, name):
    """Moving a view's principal point moves its pixels: the same point, another disparity."""
    geometry = GEOMETRIES[name]
    moved = replace(geometry, cx_left=geometry.cx_left + left, cx_right=geometry.cx_right + right)
    disparity = np.float32([[20.0, 10.0]]) * np.float32(np.sign(geometry.baseline_m))
    before = geometry.depth_from_disparity(disparity)
    after, _, _ = triangulate(
        disparity + np.float32(left - right), np.ones_like(disparity), np.zeros((1, 2), np.uint8), moved
    )
    np.testing.assert_allclose(after, before, rtol=1e-4)


def test_unknown_scale_counts_in_baselines():
    metric = disparity_map(plane_depth(HORIZONTAL, (0.1, 0.0, 1.0), 2.0), HORIZONTAL)
    unknown = replace(HORIZONTAL, baseline_m=None)
    depth, _, _ = triangulate(metric.disparity, metric.sigma, metric.status, unknown)
    np.testing.assert_allclose(depth * 0.1, plane_depth(HORIZONTAL, (0.1, 0.0, 1.0), 2.0), rtol=1e-5)


@pytest.mark.parametrize("geometry", [HORIZONTAL, ABOVE])
def test_sigma_is_the_spread_of_depth_under_noise(geometry):
    sigma_px = 0.02
    disparity = np.full((1, 1), 7.0 if geometry is HORIZONTAL else -9.0, np.float32)
    depth, sigma, _ = triangulate(
        disparity, np.full((1, 1), sigma_px, np.float32), np.zeros((1, 1), np.uint8), geometry
    )
    noisy = disparity + np.random.default_rng(0).normal(0, sigma_px, (1, 200_000)).astype(np.float32)
    spread = geometry.depth_from_disparity(noisy).std()
    assert sigma[0, 0] == pytest.approx(spread, rel=0.02)
    assert sigma[0, 0] == pytest.approx(depth[0, 0] ** 2 / (150 * 0.1) * sigma_px, rel=1e-5)


def test_behind_the_camera_and_too_uncertain_are_out_of_range():
    disparity = np.float32([[10.0, -3.5, -20.0, np.nan, -3.0]])  # offset 3.5: infinity at -3.5
    sigma = np.float32([[0.2, 0.2, 0.2, np.nan, 0.2]])
    before = np.uint8([[0, 0, 0, Status.OCCLUDED, 0]])
    depth, depth_sigma, status = triangulate(disparity, sigma, before, HORIZONTAL, max_relative_sigma=0.25)
    out = Status.OUT_OF_RANGE
    assert status.tolist() == [[0, out, out, Status.OCCLUDED, out]]
    assert np.array_equal(np.isfinite(depth), status == 0)
    assert np.array_equal(np.isfinite(depth_sigma), status == 0)
    assert depth.dtype == depth_sigma.dtype == np.float32
    assert status.dtype == np.uint8


def test_optical_frame_undoes_the_rectifying_rotation():
    rect_from_raw = Rotation.from_euler("xyz", [3, -5, 2], degrees=True).as_matrix()
    geometry = replace(HORIZONTAL, rect_from_raw_left=tuple(map(tuple, rect_from_raw)))
    raw = np.random.default_rng(0).uniform([-1, -1, 2], [1, 1, 4], (120 * 160, 3))
    depth = (raw @ rect_from_raw.T)[:, 2].reshape(120, 160).astype(np.float32)
    points = points_from_depth(depth, geometry, "optical").reshape(-1, 3)
    rectified = points_from_depth(depth, geometry, "rectified").reshape(-1, 3)
    np.testing.assert_allclose(points @ rect_from_raw.T, rectified, atol=1e-5)
    np.testing.assert_allclose(rectified[:, 2], depth.ravel(), rtol=1e-6)


def test_an_unknown_frame_is_named():
    with pytest.raises(ValueError, match="frame: expected 'optical' or 'rectified', got 'map'"):
        points_from_depth(np.ones((2, 2), np.float32), HORIZONTAL, "map")  # type: ignore[arg-type]


@pytest.mark.parametrize("name", GEOMETRIES)
@pytest.mark.parametrize("normal", [(0.0, 0.0, 1.0), (0.4, -0.2, 1.0), (-0.3, 0.5, 1.0)])
def test_normals_of_a_plane_are_exact(name, normal):
    geometry = GEOMETRIES[name]
    level = (abs(geometry.focal_times_baseline) / plane_depth(geometry, normal, 2.0)).astype(np.float32)
    signed = level * np.float32(np.sign(geometry.focal_times_baseline))
    slope_v, slope_u = np.gradient(signed.astype(np.float64))
    normals = normals_from_slopes(signed, slope_u.astype(np.float32), slope_v.astype(np.float32), geometry, "rectified")
    towards_camera = -np.array(normal) / np.linalg.norm(normal)
    np.testing.assert_allclose(normals, np.broadcast_to(towards_camera, normals.shape), atol=2e-3)


def test_geometry_default_frame_is_unrotated():
    depth = np.full((3, 4), 2.0, np.float32)
    geometry = StereoGeometry(100.0, 1.5, 1.5, 1.0, baseline_m=0.1)
    assert np.array_equal(points_from_depth(depth, geometry), points_from_depth(depth, geometry, "rectified"))
