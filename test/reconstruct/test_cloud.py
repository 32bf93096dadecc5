"""Organised clouds carry true normals; the thinned cloud is dense, bounded and made of its voxels' points."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.reconstruct_scenes import (
    ABOVE,
    GEOMETRIES,
    HORIZONTAL,
    depth_map,
    picture,
    plane_depth,
    rays,
    sphere_depth,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.reconstruct.cloud import organised_cloud, thin_cloud
from uw_recon_ros.types import PointCloud


def angle_deg(a, b):
    return np.rad2deg(np.arccos(np.clip((a * b).sum(-1), -1, 1)))


def loose_cloud(points):
    points = np.asarray(points, np.float32)
    normals = np.tile(np.float32([0, 0, -1]), (len(points), 1))
    return PointCloud(points, np.full((len(points), 3), 100, np.uint8), normals, True, 5, "frame")


@pytest.mark.parametrize("name", GEOMETRIES)
def test_normals_of_a_sphere_point_from_its_centre(name):
    geometry, centre = GEOMETRIES[name], np.array([0.05, -0.02, 2.0])
    cloud = organised_cloud(depth_map(sphere_depth(geometry, tuple(centre), 0.5), geometry), picture())
    truth = (cloud.points - centre) / 0.5
    frontal = (truth * rays(geometry)).sum(-1) < -0.5
    assert frontal.sum() > 1000
    assert np.max(angle_deg(cloud.normals, truth)[frontal]) < 8
    assert np.median(angle_deg(cloud.normals, truth)[frontal]) < 0.5


def test_normals_beside_a_step_belong_to_one_side_or_the_other():
    near = plane_depth(HORIZONTAL, (0, 0, 1), 1.0)
    depth = np.where(np.arange(160) < 80, near, plane_depth(HORIZONTAL, (0, 0, 1), 2.0))
    cloud = organised_cloud(depth_map(depth, HORIZONTAL), picture())
    assert np.max(angle_deg(cloud.normals, np.array([0, 0, -1.0]))) < 1


def test_organised_cloud_is_nan_exactly_where_depth_is():
    depth = plane_depth(ABOVE, (0.1, 0.2, 1.0), 2.0)
    depth[30:50, 40:90] = np.nan
    cloud = organised_cloud(depth_map(depth, ABOVE), picture())
    holes = np.isnan(depth)
    for array in (cloud.points, cloud.normals):
        assert array.shape == (120, 160, 3)
        assert array.dtype == np.float32
        assert np.array_equal(np.isnan(array).any(-1), holes)
        assert np.array_equal(np.isnan(array).all(-1), holes)
    assert (cloud.stamp_ns, cloud.frame_id, cloud.metric) == (123, "left_optical_frame", True)


def test_normals_are_unit_and_face_the_camera():
    depth = np.minimum(sphere_depth(HORIZONTAL, (0, 0, 2), 0.6), plane_depth(HORIZONTAL, (0.3, 0.2, 1), 2.2))
    cloud = organised_cloud(depth_map(depth, HORIZONTAL), picture())
    np.testing.assert_allclose(np.linalg.norm(cloud.normals, axis=-1), 1, atol=1e-5)
    assert ((cloud.normals * cloud.points).sum(-1) < 0).mean() > 0.995  # the sphere's rim is seen edge-on


def test_cloud_frames_differ_by_the_rectifying_rotation():
    c, s = np.cos(0.2), np.sin(0.2)
    rotation = ((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))
    depth = depth_map(plane_depth(HORIZONTAL, (0.1, 0.2, 1.0), 2.0), replace(HORIZONTAL, rect_from_raw_left=rotation))
    optical, rectified = (organised_cloud(depth, picture(), frame) for frame in ("optical", "rectified"))
    for a, b in ((optical.points, rectified.points), (optical.normals, rectified.normals)):
        np.testing.assert_allclose(a @ np.array(rotation).T, b, atol=1e-5)


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.floats(0.02, 0.7))
def test_thinned_points_are_the_means_of_their_voxels(seed, voxel):
    points = np.random.default_rng(seed).uniform(-1, 1, (400, 3)).astype(np.float32)
    points[:100] = points[100:200]
    thin = thin_cloud(loose_cloud(points), min_range=0.0, max_range=9.0, voxel=voxel, max_points=400)
    cells = np.floor(points / np.float32(voxel)).astype(int)
    groups = {tuple(c): points[(cells == c).all(1)].mean(0) for c in np.unique(cells, axis=0)}
    expected = np.array(sorted(groups.values(), key=tuple))
    found = np.array(sorted(thin.points, key=tuple))
    np.testing.assert_allclose(found, expected, atol=1e-5)


@settings(max_examples=15)
@given(st.integers(0, 10_000), st.integers(8, 400))
def test_the_thinned_cloud_is_bounded_in_number(seed, most):
    points = np.random.default_rng(seed).uniform(-1, 1, (400, 3))
    thin = thin_cloud(loose_cloud(points), min_range=0.0, max_range=9.0, voxel=0.02, max_points=most)
    assert most / 8 <= len(thin.points) <= most
    assert np.isfinite(thin.points).all()


def test_every_thinned_point_shares_a_voxel_with_a_measured_one():
    depth = np.minimum(sphere_depth(HORIZONTAL, (0, 0, 2), 0.6), plane_depth(HORIZONTAL, (0.3, 0.2, 1), 2.2))
    depth[20:60, 30:50] = np.nan
    cloud = organised_cloud(depth_map(depth, HORIZONTAL), picture())
    thin = thin_cloud(cloud, min_range=0.1, max_range=20, voxel=0.05, max_points=10**6)
    measured = cloud.points.reshape(-1, 3)
    cells = {tuple(c) for c in np.floor(measured[np.isfinite(measured[:, 0])] / 0.05).astype(int)}
    inside = [tuple(c) in cells for c in np.floor(thin.points.astype(float) / 0.05).astype(int)]
    assert np.mean(inside) > 0.99  # all but means that round onto a voxel's border
    assert len(thin.points) == len(cells)
    np.testing.assert_allclose(np.linalg.norm(thin.normals, axis=1), 1, atol=1e-5)
    for array in (thin.points, thin.normals):
        assert array.dtype == np.float32
        assert np.isfinite(array).all()


def test_range_is_measured_along_the_ray():
    points = [[0, 0, 1.0], [1.0, 0, 1.0], [0, 0, 3.0], [np.nan, 0, 1]]
    thin = thin_cloud(loose_cloud(points), min_range=0.5, max_range=1.2, voxel=0.01, max_points=10)
    np.testing.assert_allclose(thin.points, [[0, 0, 1.0]])
    assert (thin.metric, thin.stamp_ns, thin.frame_id) == (True, 5, "frame")


def test_colours_are_averaged_in_a_voxel():
    cloud = replace(loose_cloud([[0.1, 0.1, 1.1], [0.2, 0.2, 1.2]]), colors=np.uint8([[10, 20, 30], [20, 40, 61]]))
    thin = thin_cloud(cloud, min_range=0, max_range=9, voxel=1.0, max_points=10)
    assert thin.colors.tolist() == [[15, 30, 46]]


def test_an_empty_cloud_stays_empty():
    thin = thin_cloud(loose_cloud(np.full((4, 3), np.nan)), min_range=0, max_range=9, voxel=0.1, max_points=10)
    assert thin.points.shape == thin.colors.shape == thin.normals.shape == (0, 3)


@pytest.mark.parametrize(("voxel", "most"), [(0.0, 5), (-1.0, 5), (0.1, 7)])
def test_mistakes_are_named(voxel, most):
    with pytest.raises(ValueError, match="voxel, max_points, max_range: expected > 0, >= 8 and finite, got"):
        thin_cloud(loose_cloud([[0, 0, 1]]), min_range=0, max_range=9, voxel=voxel, max_points=most)
