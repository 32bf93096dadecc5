"""Fusion against shapes that are known exactly: where it lies, that it is closed, and what it does not depend on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from helpers.fuse_scenes import HOW, fused, looking_down, looking_in, plane_view, sphere_view, view_of

from uw_recon_ros import rigid
from uw_recon_ros.fuse.blocks import coordinates_of, keys_of
from uw_recon_ros.fuse.cubes import EDGES, make_table
from uw_recon_ros.fuse.extract import FusedMesh

RADIUS = 0.3


@pytest.fixture(scope="module")
def sphere() -> FusedMesh:
    return fused(looking_in(RADIUS))


def triangles(mesh: FusedMesh) -> np.ndarray:
    return np.unique(np.sort(mesh.faces, axis=1), axis=0)


def test_every_cell_is_cut_along_its_crossed_edges_and_no_other() -> None:
    table = make_table()
    for inside in range(256):
        cut = {k for k, (corner, axis) in enumerate(EDGES) if (inside >> corner ^ inside >> (corner | 1 << axis)) & 1}
        assert set(table[inside][table[inside] >= 0].tolist()) == cut


def test_names_of_places_are_in_order_and_come_back() -> None:
    places = np.random.default_rng(1).integers(-(1 << 19), 1 << 19, (500, 3))
    places = places[np.lexsort(places.T[::-1])]
    keys = keys_of(places)
    assert (np.diff(keys) > 0).all()
    np.testing.assert_array_equal(coordinates_of(keys), places)
    with pytest.raises(ValueError, match="coordinates: expected within"):
        keys_of(np.array([[1 << 19, 0, 0]]))


def test_a_sphere_lies_where_it_is_and_is_closed(sphere: FusedMesh) -> None:
    away = np.linalg.norm(sphere.vertices, axis=1) - RADIUS
    assert abs(np.median(away)) < 2e-4
    assert np.percentile(np.abs(away), 95) < 4e-3  # of 10 mm voxels, seen as flat as 70 degrees
    mesh = trimesh.Trimesh(sphere.vertices, sphere.faces, process=False)
    assert mesh.is_watertight
    assert mesh.is_winding_consistent
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.01)


@pytest.mark.parametrize("tile_m", [0.1, 0.24])
def test_tiles_leave_no_seam(sphere: FusedMesh, tile_m: float) -> None:
    tiled = fused(looking_in(RADIUS), replace(HOW, tile_m=tile_m))
    np.testing.assert_array_equal(tiled.vertices, sphere.vertices)
    np.testing.assert_array_equal(tiled.sigma, sphere.sigma)
    np.testing.assert_array_equal(triangles(tiled), triangles(sphere))


def test_the_same_views_give_the_same_bytes(sphere: FusedMesh) -> None:
    again = fused(looking_in(RADIUS))
    for name in ("vertices", "faces", "colors", "sigma", "views"):
        assert getattr(again, name).tobytes() == getattr(sphere, name).tobytes()


def test_the_order_of_frames_does_not_matter(sphere: FusedMesh) -> None:
    turned = fused(looking_in(RADIUS)[::-1])
    np.testing.assert_array_equal(turned.keys, sphere.keys)
    np.testing.assert_allclose(turned.vertices, sphere.vertices, atol=1e-5)


def test_a_rigid_motion_moves_the_surface_along() -> None:
    motion = rigid.exp(np.array([0.313, -0.127, 0.051, 0.2, -0.4, 0.3]))
    moved = fused(looking_in(RADIUS, motion))
    away = np.linalg.norm(moved.vertices - motion[:3, 3], axis=1) - RADIUS
    assert abs(np.median(away)) < 2e-4
    assert np.percentile(np.abs(away), 95) < 4e-3  # of 10 mm voxels, seen as flat as 70 degrees
    assert trimesh.Trimesh(moved.vertices, moved.faces, process=False).is_watertight


def test_views_count_by_how_sure_they_are() -> None:
    pose = looking_down(0.0)
    mesh = fused([plane_view(pose, 0.0, sigma=0.001), plane_view(pose, 0.009, sigma=0.003)])
    expected = 0.009 * 0.1  # weights 9 and 1
    np.testing.assert_allclose(np.median(mesh.vertices[:, 2]), expected, atol=1e-4)
    assert np.median(mesh.views) == 2
    assert np.median(mesh.sigma) == pytest.approx(np.sqrt(2 / (1 / 0.001**2 + 1 / 0.003**2)), rel=1e-3)
    two = fused([plane_view(pose, sigma=0.002, gray=10), plane_view(pose, sigma=0.004, gray=210)])
    assert np.median(two.colors) == pytest.approx((10 * 4 + 210) / 5, abs=1)


def test_pixels_less_sure_than_the_limit_say_nothing() -> None:
    mesh = fused([plane_view(looking_down(0.0), sigma=0.002), plane_view(looking_down(0.0), 0.02, sigma=0.021)])
    assert np.abs(mesh.vertices[:, 2]).max() < 1e-4
    assert mesh.views.max() == 1


def test_a_thing_that_moved_on_is_voted_out() -> None:
    bottom = [plane_view(looking_down(x)) for x in (-0.1, -0.05, 0.05, 0.1)]
    pose = looking_down(0.0)
    ball = sphere_view(pose, 0.1, np.array([0.0, 0.0, 0.15])).depth
    with_ball = view_of(np.where(np.isfinite(ball), ball, plane_view(pose).depth), pose)
    assert fused([with_ball]).vertices[:, 2].max() > 0.2
    assert fused([*bottom[:2], with_ball, *bottom[2:]]).vertices[:, 2].max() < 0.01


def test_a_surface_that_one_view_saw_can_be_asked_out() -> None:
    views = [plane_view(looking_down(0.0)), plane_view(looking_down(0.3))]
    assert fused(views).views.min() == 1
    both = fused(views, replace(HOW, min_views=2))
    assert both.views.min() == 2
    assert both.vertices[:, 0].min() > 0.3 - 0.6
    assert both.vertices[:, 0].max() < 0.6
