"""The surface follows the truth, spends vertices where it bends, and bridges nothing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.reconstruct_scenes import (
    ABOVE,
    GEOMETRIES,
    HORIZONTAL,
    VERTICAL,
    depth_map,
    picture,
    plane_depth,
    rays,
    sphere_depth,
)
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.reconstruct.rasters import broken_triangles, misfit
from uw_recon_ros.reconstruct.surface import build_surface
from uw_recon_ros.reconstruct.vertices import choose_vertices

DEFAULTS = {
    "max_vertices": 4000, "tolerance_px": 0.05, "max_jump_px": 1.0, "max_gap_px": 0,
    "max_obliqueness_deg": 85.0, "min_area_px": 0,
}  # fmt: skip


def surface_of(depth, geometry=HORIZONTAL, **changes):
    return build_surface(depth_map(depth, geometry), picture(), **{**DEFAULTS, **changes})


def pixels_of(surface):
    """(N, 2) pixel (u, v) of every vertex, from its texture coordinates."""
    height, width = surface.texture.shape[:2]
    return np.stack([surface.uv[:, 0] * width - 0.5, (1 - surface.uv[:, 1]) * height - 0.5], axis=1)


def covered(corners, height, width):
    """Pixels in the closed triangle `corners` (3, 2): all half planes, all pixels."""
    v, u = np.mgrid[:height, :width]
    a, b, c = np.round(corners).astype(int)
    sides = [(q[0] - p[0]) * (v - p[1]) - (q[1] - p[1]) * (u - p[0]) for p, q in ((a, b), (b, c), (c, a))]
    return np.all([s >= 0 for s in sides], axis=0) | np.all([s <= 0 for s in sides], axis=0)


def coverage(surface):
    height, width = surface.texture.shape[:2]
    seen = np.zeros((height, width), bool)
    for corners in pixels_of(surface)[surface.faces]:
        seen |= covered(corners, height, width)
    return seen


@pytest.mark.parametrize("name", GEOMETRIES)
def test_a_plane_needs_few_vertices_and_is_met_exactly(name):
    geometry, normal = GEOMETRIES[name], np.array([0.3, -0.2, 1.0]) / np.linalg.norm([0.3, -0.2, 1.0])
    surface = surface_of(plane_depth(geometry, tuple(normal), 2.0), geometry)
    assert len(surface.vertices) <= 30
    np.testing.assert_allclose(surface.vertices @ normal, 2.0, rtol=1e-5)
    np.testing.assert_allclose(surface.normals, np.tile(-normal, (len(surface.vertices), 1)), atol=1e-4)
    assert coverage(surface).all()


@pytest.mark.parametrize("geometry", [HORIZONTAL, VERTICAL])
def test_a_sphere_is_met_within_the_tolerance(geometry):
    centre, radius, tolerance = np.array([0.05, -0.02, 2.0]), 0.5, 0.05
    surface = surface_of(sphere_depth(geometry, tuple(centre), radius), geometry, tolerance_px=tolerance)
    corners = surface.vertices[surface.faces].astype(float)
    inside = np.random.default_rng(0).dirichlet([1, 1, 1], 20)
    samples = np.einsum("si,fik->fsk", inside, corners).reshape(-1, 3)
    distance = np.abs(np.linalg.norm(samples - centre, axis=1) - radius)
    # One tolerance in depth at the far rim, and the pixels between whole pixels where it is steepest.
    bound = tolerance * 2.0**2 / (150 * 0.1)
    assert np.quantile(distance, 0.95) < bound
    assert distance.max() < 4 * bound


def test_the_budget_is_kept_and_a_bigger_one_is_closer():
    depth = np.minimum(sphere_depth(HORIZONTAL, (0, 0, 2), 0.6), plane_depth(HORIZONTAL, (0.3, 0.2, 1), 2.2))
    depth = depth * (1 + 0.01 * np.sin(np.arange(160) / 2.0))
    truth = np.float32(15.0) / depth
    errors = []
    for budget in (50, 400, 3000):
        vertices, triangles = choose_vertices(truth.astype(np.float32), budget=budget, tolerance=0.01)
        assert len(vertices) <= budget  # all pixels are valid
        assert len(surface_of(depth, max_vertices=budget).vertices) <= budget
        worst, total = np.empty((len(triangles), 2), np.int32), np.empty(len(triangles), np.float32)
        misfit(truth.astype(np.float32), vertices, triangles, 0.01, 1e9, worst, total)
        errors.append(total.sum())
    assert errors[0] > 2 * errors[1] > 4 * errors[2]


@pytest.mark.parametrize("budget", [60, 300, 1000])
def test_the_budget_is_kept_among_holes(budget):
    depth = plane_depth(HORIZONTAL, (0.3, -0.2, 1.0), 2.0)
    depth[np.random.default_rng(0).random(depth.shape) < 0.1] = np.nan
    vertices, _ = choose_vertices((15.0 / depth).astype(np.float32), budget=budget, tolerance=0.05)
    assert np.isfinite(depth[vertices[:, 1], vertices[:, 0]]).sum() <= budget
    assert len(vertices) <= 1.5 * budget


def test_vertices_are_dense_where_the_surface_bends():
    u = np.arange(160, dtype=np.float32)
    level = np.tile(np.where(u < 80, 10.0, 10 + 2 * np.sin(u / 3.0)), (120, 1)).astype(np.float32)
    level[:, 79:82] = 10.0  # no jump between the halves
    vertices, _ = choose_vertices(level, budget=2000, tolerance=0.1)
    flat, bent = (vertices[:, 0] < 72).sum(), (vertices[:, 0] > 88).sum()
    assert bent > 8 * flat


@pytest.mark.parametrize("geometry", [HORIZONTAL, ABOVE])
@pytest.mark.parametrize("slant", [0.0, 0.35])
def test_no_triangle_bridges_a_step(geometry, slant):
    near, far = plane_depth(geometry, (slant, 0.1, 1.0), 1.2), plane_depth(geometry, (0.1, slant, 1.0), 2.0)
    v, u = np.mgrid[:120, :160]
    in_front = (u - 80) ** 2 + (v - 55) ** 2 < 35**2
    surface = surface_of(np.where(in_front, near, far), geometry)
    sides = in_front[tuple(np.round(pixels_of(surface)).astype(int).T[::-1])][surface.faces]
    assert (sides.all(1) | ~sides.any(1)).all()
    assert coverage(surface).mean() > 0.97


def test_a_jump_below_the_limit_belongs_to_the_surface():
    level = np.full((40, 60), 10.0)
    level[:, 30:] += 0.8
    depth = 15.0 / level
    joined = build_surface(depth_map(depth, HORIZONTAL), picture(40, 60), **{**DEFAULTS, "max_obliqueness_deg": 90.0})
    parted = build_surface(depth_map(depth, HORIZONTAL), picture(40, 60), **{**DEFAULTS, "max_jump_px": 0.5})
    for surface, bridged in ((joined, True), (parted, False)):
        columns = np.round(pixels_of(surface)[:, 0])[surface.faces]
        assert bool(((columns.min(1) < 30) & (columns.max(1) >= 30)).any()) is bridged


def test_whole_pixel_disparities_of_a_slanted_plane_make_one_surface():
    level = np.round(15.0 / plane_depth(HORIZONTAL, (0.6, 0.3, 1.0), 1.0))
    depth = depth_map(15.0 / level, HORIZONTAL, sigma_px=1 / np.sqrt(12))
    assert coverage(build_surface(depth, picture(), **DEFAULTS)).mean() > 0.999


def test_a_jump_of_just_the_limit_is_none_after_the_way_through_depth():
    level = np.tile(60.0 + np.arange(160), (120, 1))
    assert coverage(surface_of(15.0 / level, max_obliqueness_deg=90.0)).all()


def test_oblique_triangles_are_dropped_beyond_noise_only():
    floor = plane_depth(HORIZONTAL, (0.0, 1.0, 0.02), 0.5)  # almost along the rays
    floor[floor < 0] = np.nan
    floor[floor > 5] = np.nan
    assert len(surface_of(floor, max_obliqueness_deg=90).faces) > 0
    steep = surface_of(floor, max_obliqueness_deg=60)
    corners = steep.vertices[steep.faces].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    centres = corners.mean(1)
    cosine = -(normals * centres).sum(1) / np.linalg.norm(normals, axis=1) / np.linalg.norm(centres, axis=1)
    level = 15.0 / steep.vertices[:, 2][steep.faces]
    beyond = (cosine < np.cos(np.deg2rad(60))) & (np.ptp(level, axis=1) > 3 * np.sqrt(2) * 0.1 * 1.001)
    assert not beyond.any()
    assert len(steep.faces) < len(surface_of(floor, max_obliqueness_deg=90).faces)
    uncertain = depth_map(floor, HORIZONTAL, sigma_px=0.7)
    steps = {**DEFAULTS, "tolerance_px": 0.02, "max_obliqueness_deg": 60}
    assert len(build_surface(uncertain, picture(), **steps).faces) > 2 * len(surface_of(floor, **steps).faces)


@settings(max_examples=12)
@given(st.integers(0, 10_000), st.floats(0.002, 0.3))
def test_no_triangle_covers_an_invalid_pixel(seed, share):
    rng = np.random.default_rng(seed)
    depth = plane_depth(HORIZONTAL, (0.2, 0.1, 1.0), 2.0)[:36, :48]
    holes = rng.random(depth.shape) < share
    depth = np.where(holes, np.nan, depth)
    surface = build_surface(depth_map(depth, HORIZONTAL), picture(36, 48), **DEFAULTS)
    seen = coverage(surface)
    assert not (seen & holes).any()
    if share < 0.05:
        assert (seen | holes).mean() > 0.9


def test_a_thin_gap_between_two_surfaces_is_not_crossed():
    depth = np.full((40, 60), 1.5)
    for k in range(40):
        depth[k, 20 + k // 3] = np.nan  # one pixel wide, stepping aside
    surface = build_surface(depth_map(depth, HORIZONTAL), picture(40, 60), **DEFAULTS)
    pixels = np.round(pixels_of(surface)).astype(int)
    left = pixels[:, 0] < 20 + pixels[:, 1] // 3
    sides = left[surface.faces]
    assert (sides.all(1) | ~sides.any(1)).all()


def test_triangles_face_the_camera_counter_clockwise():
    depth = np.minimum(sphere_depth(ABOVE, (0, 0, 2), 0.6), plane_depth(ABOVE, (0.3, 0.2, 1), 2.2))
    surface = surface_of(depth, ABOVE)
    a, b, c = (surface.vertices[surface.faces[:, k]].astype(float) for k in range(3))
    assert ((np.cross(b - a, c - a) * a).sum(1) < 0).all()
    assert ((surface.normals * surface.vertices).sum(1) < 0).all()
    np.testing.assert_allclose(np.linalg.norm(surface.normals, axis=1), 1, atol=1e-5)


def test_texture_coordinates_lead_to_the_vertex_colours():
    surface = surface_of(plane_depth(HORIZONTAL, (0.3, -0.2, 1.0), 2.0))
    height, width = surface.texture.shape[:2]
    column = np.floor(surface.uv[:, 0] * width).astype(int)
    row = np.floor((1 - surface.uv[:, 1]) * height).astype(int)
    assert np.array_equal(surface.texture[row, column], surface.colors)
    ray = rays(HORIZONTAL)[row, column]
    np.testing.assert_allclose(surface.vertices / surface.vertices[:, 2:], ray, atol=1e-5)


def test_arrays_are_dense_used_and_of_the_declared_types():
    depth = plane_depth(HORIZONTAL, (0.3, -0.2, 1.0), 2.0)
    depth[20:60, 30:90] = np.nan
    surface = surface_of(depth)
    assert np.array_equal(np.unique(surface.faces), np.arange(len(surface.vertices)))
    for array, dtype in ((surface.vertices, np.float32), (surface.normals, np.float32), (surface.uv, np.float32)):
        assert array.dtype == dtype
        assert np.isfinite(array).all()
    assert surface.faces.dtype == np.int32
    assert surface.colors.dtype == np.uint8
    assert (surface.stamp_ns, surface.frame_id, surface.metric) == (123, "left_optical_frame", True)


def test_small_pieces_are_dropped():
    depth = np.full((120, 160), np.nan)
    depth[10:100, 10:100] = 1.5
    depth[10:15, 140:145] = 1.5
    assert surface_of(depth, min_area_px=0).uv[:, 0].max() > 0.8
    assert surface_of(depth, min_area_px=50).uv[:, 0].max() < 0.7


def test_nothing_valid_gives_an_empty_surface():
    surface = surface_of(np.full((120, 160), np.nan))
    assert surface.vertices.shape == (0, 3)
    assert surface.faces.shape == (0, 3)
    assert surface.normals.shape == (0, 3)


def test_unknown_scale_is_handed_on():
    geometry = replace(HORIZONTAL, baseline_m=None)
    assert not surface_of(plane_depth(geometry, (0, 0, 1), 20.0), geometry).metric


def test_misfit_agrees_with_barycentric_interpolation():
    rng = np.random.default_rng(2)
    level = rng.normal(0, 1, (24, 31)).astype(np.float32)
    for _ in range(30):
        vertices = rng.integers(0, 24, (3, 2)).astype(np.int32)
        (a, b, c), triangles = vertices.astype(float), np.int32([[0, 1, 2]])
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if area == 0:
            continue
        v, u = np.mgrid[:24, :31]
        weight_b = ((u - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (v - a[1])) / area
        weight_c = ((b[0] - a[0]) * (v - a[1]) - (u - a[0]) * (b[1] - a[1])) / area
        plane = sum(
            w * level[p[1], p[0]] for w, p in zip((1 - weight_b - weight_c, weight_b, weight_c), vertices, strict=True)
        )
        departure = np.where(covered(vertices, 24, 31), np.abs(level - plane), 0)
        worst, total = np.zeros((1, 2), np.int32), np.zeros(1, np.float32)
        misfit(level, vertices, triangles, 0.2, 5.0, worst, total)
        assert total[0] == pytest.approx(np.minimum(departure / 0.2, 5.0)[departure > 0.2].sum(), rel=1e-4)
        if total[0] > 0:
            assert departure[worst[0, 1], worst[0, 0]] == pytest.approx(departure.max(), rel=1e-5)


@pytest.mark.parametrize(
    ("corners", "broken"),
    [
        (((2, 2), (8, 2), (2, 8)), False),  # left of the cut
        (((12, 2), (18, 4), (12, 8)), False),  # right of it
        (((2, 2), (18, 2), (2, 8)), True),  # across
        (((9, 2), (10, 3), (9, 3)), True),  # a sliver without inner pixels
        (((9, 1), (10, 8), (9, 2)), True),
        (((9, 1), (9, 8), (8, 3)), False),  # along the cut
        (((2, 2), (4, 4), (6, 6)), True),  # no area
    ],
)
def test_broken_triangles_on_a_straight_cut(corners, broken):
    cut_right, cut_below = np.zeros((10, 20), bool), np.zeros((10, 20), bool)
    cut_right[:, 9] = True
    out = np.empty(1, bool)
    broken_triangles(cut_right, cut_below, np.int32(corners), np.int32([[0, 1, 2]]), out)
    assert bool(out[0]) is broken
    transposed = np.int32(corners)[:, ::-1].copy()
    broken_triangles(cut_below.T.copy(), cut_right.T.copy(), transposed, np.int32([[0, 1, 2]]), out)
    assert bool(out[0]) is broken


def test_mistakes_are_named():
    with pytest.raises(ValueError, match=r"got \(1, 5\) and 100"):
        choose_vertices(np.ones((1, 5), np.float32), budget=100, tolerance=0.1)
    with pytest.raises(ValueError, match=r"got \(5, 5\) and 3"):
        choose_vertices(np.ones((5, 5), np.float32), budget=3, tolerance=0.1)
