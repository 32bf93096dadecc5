"""Sigma of places on a mesh's triangles from that of its corners."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros.model.mesh import Shown, within_triangles
from uw_recon_ros.types import Surface


def ground(edge: float, side: int = 40) -> Shown:
    """A flat grid of triangles, sigma 2 mm."""
    row, column = np.divmod(np.arange(side * side), side)
    vertices = np.column_stack([edge * column, edge * row, np.zeros(side * side)]).astype(np.float32)
    corner = np.arange(side * side).reshape(side, side)[:-1, :-1].ravel()
    faces = np.concatenate([corner[:, None] + np.array(way) for way in ([0, 1, side], [1, side + 1, side])])
    surface = Surface(
        vertices, faces.astype(np.int32), np.tile(np.float32([0, 0, 1]), (side * side, 1)),
        np.zeros((side * side, 2), np.float32), np.zeros((side * side, 3), np.uint8), np.zeros((4, 4, 3), np.uint8),
        True, 0, "world",
    )  # fmt: skip
    return Shown(surface, np.full(side * side, 0.002, np.float32), np.full(side * side, 3, np.int32))


def test_it_is_what_corners_that_err_by_themselves_leave() -> None:
    shown, rng = ground(0.03), np.random.default_rng(1)
    heights = 0.002 * rng.standard_normal(len(shown.sigma))
    faces = shown.surface.faces
    places = (rng.dirichlet(np.ones(3), len(faces)) * heights[faces]).sum(axis=1)
    told = within_triangles(shown, 0.01)[faces].mean(axis=1)
    assert np.sqrt(((places / told) ** 2).mean()) == pytest.approx(1.0, abs=0.1)


def test_neighbours_in_the_volume_do_not_err_by_themselves() -> None:
    shown = ground(0.01)
    np.testing.assert_array_equal(within_triangles(shown, 0.01), shown.sigma)
