"""Maps from above against a slope and a picture that are known."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.fuse_scenes import fused, looking_down, plane_view, view_of

from uw_recon_ros.drape.from_above import Grid, Mosaic, elevation, grid_over


def test_the_height_of_a_slope_is_that_of_its_cells_centres() -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.5], [1.0, 1.0, 0.7], [0.0, 1.0, 0.2]])
    grid = grid_over(corners, 0.1, 10_000)
    heights = elevation(corners, np.array([[0, 1, 2], [0, 2, 3]], np.int32), grid)
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell_m
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell_m
    known = np.isfinite(heights)
    assert known.sum() == 100
    np.testing.assert_allclose(heights[known], (0.5 * x[None] + 0.2 * y[:, None])[known], atol=1e-6)


def test_the_highest_of_two_surfaces_is_seen() -> None:
    low = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    both = np.concatenate([low + np.array([0.0, 0.0, 1.0]), low])
    heights = elevation(both, np.array([[0, 1, 2], [3, 4, 5]], np.int32), grid_over(low, 0.1, 10_000))
    assert np.nanmin(heights) == np.nanmax(heights) == 1.0


def test_too_many_cells_are_doubled() -> None:
    grid = grid_over(np.array([[0.0, 0.0, 0.0], [10.0, 10.0, 0.0]]), 0.01, 100_000)
    assert grid.rows * grid.columns <= 100_000
    assert grid.cell_m == 0.04


def test_a_cell_has_the_colour_of_the_place_below_it() -> None:
    poses = [looking_down(0.0), looking_down(0.2, 0.1, 1.1)]
    views = []
    for pose in poses:
        view = plane_view(pose)
        v, u = np.mgrid[: view.depth.shape[0], : view.depth.shape[1]]
        fx, fy, cx, cy = view.intrinsics
        x = pose[0, 3] + (u - cx) / fx * view.depth
        y = pose[1, 3] - (v - cy) / fy * view.depth
        color = np.stack([100 + 100 * x, 100 + 100 * y, np.full_like(x, 7)], axis=-1)
        views.append(view_of(view.depth, pose))
        views[-1].color[:] = np.rint(color)
    mesh = fused(views)
    grid = grid_over(mesh.vertices, 0.01, 1_000_000)
    heights = elevation(mesh.vertices, mesh.faces, grid)
    mosaic = Mosaic(grid, heights)
    for k, view in enumerate(views):
        mosaic.add(k, view.color, view.depth, view.pose, view.intrinsics, 0.05)
    there = mosaic.best >= 0
    assert there.sum() > 0.9 * np.isfinite(heights).sum()
    assert set(np.unique(mosaic.best)) == {-1, 0, 1}
    x = grid.west + (np.arange(grid.columns) + 0.5) * grid.cell_m
    y = grid.north - (np.arange(grid.rows) + 0.5) * grid.cell_m
    np.testing.assert_allclose(mosaic.colors[..., 0][there], np.broadcast_to(100 + 100 * x, there.shape)[there], atol=2)
    np.testing.assert_allclose(
        mosaic.colors[..., 1][there], np.broadcast_to(100 + 100 * y[:, None], there.shape)[there], atol=2
    )


def test_a_place_that_something_hides_takes_no_colour() -> None:
    view = plane_view(looking_down(0.0, z=1.0), 0.5)
    mosaic = Mosaic(Grid(-0.2, 0.2, 0.1, 4, 4), np.zeros((4, 4), np.float32))
    mosaic.add(0, view.color, view.depth, view.pose, view.intrinsics, 0.05)
    assert (mosaic.best == -1).all()


def test_no_points_have_no_grid() -> None:
    with pytest.raises(ValueError, match="expected at least one"):
        grid_over(np.zeros((0, 3)), 0.1, 10)
