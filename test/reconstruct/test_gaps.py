"""Pinholes within a surface are covered; gaps at discontinuities are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from helpers.reconstruct_scenes import HORIZONTAL, depth_map, picture

from uw_recon_ros.reconstruct.gaps import close_gaps
from uw_recon_ros.reconstruct.planes import fit_planes, flat_planes
from uw_recon_ros.reconstruct.surface import build_surface

HEIGHT, WIDTH = 40, 60
V, U = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)


def close(level, gap=6, jump=1.0):
    planes, band = flat_planes(level), np.full(level.shape, 1.0, np.float32)
    for step in (1, 1, 2):
        planes = fit_planes(planes, band, step)
    return close_gaps(replace(planes, value=level.astype(np.float32)), gap, jump)


def slanted():
    return (12 + 0.3 * U - 0.2 * V).astype(np.float32)


def test_a_pinhole_in_a_slanted_plane_is_interpolated():
    level = slanted()
    level[10:14, 20:24] = np.nan
    closed = close(level)
    assert np.isfinite(closed).all()
    np.testing.assert_allclose(closed, slanted(), atol=0.05)


def test_measured_pixels_are_left_alone():
    level = slanted()
    level[10:14, 20:24] = np.nan
    there = np.isfinite(level)
    assert np.array_equal(close(level)[there], level[there])


def test_a_hole_wider_than_the_limit_keeps_its_middle():
    level = slanted()
    level[10:25, 20:35] = np.nan
    assert np.isnan(close(level, gap=6)[17, 27])
    assert np.isfinite(close(level, gap=16)).all()


def test_the_width_of_a_gap_counts_not_the_way_to_its_sides():
    level = slanted()
    level[:, 20:29] = np.nan  # nine wide: its middle is five from either side
    assert np.isnan(close(level, gap=8)[:, 24]).all()
    assert np.isfinite(close(level, gap=9)).all()


def test_a_gap_between_two_depths_stays_open():
    level = np.where(U < 30, 10.0, 14.0).astype(np.float32)
    level[:, 28:33] = np.nan
    assert np.array_equal(np.isnan(close(level)), np.isnan(level))


def test_a_step_within_the_jump_limit_is_closed():
    level = np.where(U < 30, 10.0, 10.8).astype(np.float32)
    level[:, 28:33] = np.nan
    assert np.isfinite(close(level)).all()


def test_a_gap_at_the_image_border_stays_open():
    level = slanted()
    level[:, :3] = np.nan
    assert np.isnan(close(level)[:, :3]).all()


def test_no_gap_allowed_nothing_closed():
    level = slanted()
    level[5, 5] = np.nan
    assert np.isnan(close(level, gap=0)[5, 5])


def build(level, gap):
    return build_surface(
        depth_map(15.0 / level, HORIZONTAL), picture(HEIGHT, WIDTH), max_vertices=2000, tolerance_px=0.1,
        max_jump_px=1.0, max_gap_px=gap, max_obliqueness_deg=85.0, min_area_px=0,
    )  # fmt: skip


def image_area(surface):
    a, b, c = (surface.uv[surface.faces[:, k]] * [WIDTH, HEIGHT] for k in range(3))
    (au, av), (bu, bv), (cu, cv) = a.T, b.T, c.T
    return np.abs((bu - au) * (cv - av) - (cu - au) * (bv - av)).sum() / 2


def test_the_surface_covers_pinholes_with_triangles_between_measured_pixels():
    level = slanted()
    level[np.random.default_rng(0).random(level.shape) < 0.03] = np.nan
    level[10:14, 20:24] = np.nan
    closed, strict = build(level, 8), build(level, 0)
    assert image_area(closed) > 0.97 * (HEIGHT - 1) * (WIDTH - 1)
    assert image_area(strict) < 0.93 * (HEIGHT - 1) * (WIDTH - 1)
    assert len(closed.vertices) < len(strict.vertices) / 5
    pixels = np.stack([closed.uv[:, 0] * WIDTH - 0.5, (1 - closed.uv[:, 1]) * HEIGHT - 0.5], axis=1).round().astype(int)
    assert np.isfinite(level[pixels[:, 1], pixels[:, 0]]).all()
