"""Pictures on the surface: gains found again, the right view chosen, maps and textures that show what is there."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
import trimesh
from helpers.surface_scenes import Ground, fused, looking_down, paint, photo, taken
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.fuse.frame import PosedFrame, view_of
from uw_recon_ros.texturing.atlas import grown, make_atlas, texels_of
from uw_recon_ros.texturing.best_view import BestViews, sharpness_of
from uw_recon_ros.texturing.gains import Balance, balance_frames, field_terms, look_at, unbalanced
from uw_recon_ros.texturing.raster import MapGrid, heights_of, normals_of, terrain_of
from uw_recon_ros.texturing.simplify import simplified, vertex_normals
from uw_recon_ros.texturing.visibility import in_sight
from uw_recon_ros.types import Matrix

BALL = Ground(((np.array([0.0, 0.0, 0.1]), 0.1),))
UP = np.array([0.0, 0.0, 1.0], np.float32)


def ground_points(step: float = 0.02, half: float = 0.3) -> Matrix:
    x, y = np.meshgrid(np.arange(-half, half, step), np.arange(-half, half, step))
    return np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)


def ups(points: Matrix) -> np.ndarray:
    return np.tile(UP, (len(points), 1))


def balanced(frames: list[PosedFrame], points: Matrix) -> Balance:
    seen = [look_at(points, k, view_of(f), f.left, 0.02) for k, f in enumerate(frames)]
    return balance_frames(seen, len(points), len(frames))


def track(count: int = 12, turn: float = 0.0) -> list[Matrix]:
    return [looking_down(0.12 * (k - count / 2), 0.02 * (k % 2), turn=turn * k) for k in range(count)]


def test_gains_of_frames_are_found_in_every_channel() -> None:
    rng = np.random.default_rng(0)
    true = np.exp(rng.uniform(-0.3, 0.3, (12, 3)))
    frames = [taken(Ground(), pose, gain=g, number=k) for k, (pose, g) in enumerate(zip(track(), true, strict=True))]
    points = np.random.default_rng(1).uniform([-1.2, -0.35, 0], [1.2, 0.35, 0], (3000, 3))
    found = balanced(frames, points).gains
    expected = np.log(true) - np.log(true).mean(axis=0)
    np.testing.assert_allclose(found, expected, atol=0.02)


def test_the_lamps_field_is_found() -> None:
    """A picture darker towards its rim and to one side, alike in all frames, which look in several directions."""
    u, v = np.meshgrid(np.arange(96.0), np.arange(72.0))
    terms = field_terms(u.ravel(), v.ravel(), 96, 72).reshape(72, 96, -1)
    field = np.zeros((6, 3))
    field[2], field[4], field[0] = -0.25, -0.3, 0.1
    shade = np.exp(terms @ field)
    frames = [taken(Ground(), pose, gain=shade, number=k) for k, pose in enumerate(track(turn=0.8))]
    points = np.random.default_rng(1).uniform([-1.2, -0.35, 0], [1.2, 0.35, 0], (3000, 3))
    found = balanced(frames, points)
    left_over = np.exp(terms @ (field - found.field))
    assert (left_over / left_over.mean()).std() < 0.25 * (shade / shade.mean()).std()


def test_without_overlap_nothing_is_changed() -> None:
    frames = [taken(Ground(), looking_down(5.0 * k, 0.0), gain=1 + 0.2 * k, number=k) for k in range(3)]
    points = np.concatenate([ground_points() + np.array([5.0 * k, 0, 0]) for k in range(3)])
    assert np.abs(balanced(frames, points).gains).max() < 0.02
    assert not balance_frames([], 0, 4).gains.any()


def test_what_is_hidden_is_not_in_sight() -> None:
    pose = looking_down(0.35, 0.0)
    view = view_of(taken(BALL, pose))
    top, behind, beside = np.array([[0.0, 0.0, 0.2]]), np.array([[-0.06, 0.0, 0.0]]), np.array([[0.3, 0.1, 0.0]])
    which, u, v = in_sight(np.concatenate([top, behind, beside]), view, 0.01)
    assert which.tolist() == [0, 2]
    again = view.depth[np.rint(v).astype(int), np.rint(u).astype(int)]
    assert np.isfinite(again).all()


def test_colors_come_from_where_the_place_is_seen() -> None:
    points = ground_points()
    best = BestViews(points, ups(points), 0.02)
    for k, pose in enumerate(track()):
        frame = taken(Ground(), pose, number=k)
        best.add(k, view_of(frame), frame.left, unbalanced(12))
    assert best.seen.all()
    assert np.abs(best.colors() - paint(points)).mean() < 2.0


def test_the_nearer_and_sharper_view_wins() -> None:
    points = ground_points(half=0.1)
    frames = [taken(Ground(), looking_down(0.0, 0.0, height), number=k) for k, height in enumerate((1.0, 0.6, 1.4))]
    for sharpness, expected in ((1.0, 1), (0.2, 0)):
        best = BestViews(points, ups(points), 0.02)
        for k, frame in enumerate(frames):
            best.add(k, view_of(frame), frame.left, unbalanced(3), sharpness if k == 1 else 1.0)
        assert set(best.frames.tolist()) == {expected}  # type: ignore[attr-defined]


def test_what_has_moved_on_is_not_in_the_colours() -> None:
    """The ball was there in the best picture only; the ground's depth says so."""
    points = ground_points(half=0.08)
    frames = [taken(BALL, looking_down(0.0, 0.0)), taken(Ground(), looking_down(0.1, 0.0), number=1)]
    white = dataclasses.replace(frames[0], left=np.full_like(frames[0].left, 255))
    best = BestViews(points, ups(points), 0.01)
    for k, frame in enumerate((white, frames[1])):
        best.add(k, view_of(frame), frame.left, unbalanced(2))
    inner = np.hypot(points[:, 0], points[:, 1]) < 0.06
    assert best.colors()[inner].max() < 230
    assert np.abs(best.colors()[inner] - paint(points[inner])).mean() < 3.0


def test_seams_fade() -> None:
    """Two frames of different brightness that nobody balanced: no step from cell to cell as high as between them."""
    x = np.linspace(-0.2, 0.2, 400)
    points = np.stack([x, np.zeros(400), np.zeros(400)], axis=1)
    frames = [taken(Ground(), looking_down(dx, 0.0), number=k) for k, dx in enumerate((-0.2, 0.2))]
    best = BestViews(points, ups(points), 0.02)
    for k, (frame, level) in enumerate(zip(frames, (100, 140), strict=True)):
        best.add(k, view_of(frame), np.full_like(frame.left, level), unbalanced(2))
    colors = best.colors()[:, 0].astype(int)
    assert {int(colors[0]), int(colors[-1])} == {100, 140}
    assert np.abs(np.diff(colors)).max() <= 4


def test_sharpness_tells_smeared_pictures() -> None:
    rng = np.random.default_rng(0)
    sharp = rng.integers(60, 200, (72, 96, 3)).astype(np.uint8)
    smeared = np.stack([np.roll(sharp, k, axis=1) for k in range(7)]).mean(axis=0).astype(np.uint8)
    assert sharpness_of(smeared) < 0.7 * sharpness_of(sharp)


def test_heights_of_a_tilted_plane() -> None:
    corners = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    vertices = np.c_[corners, 0.3 * corners[:, 0] - 0.2 * corners[:, 1] + 5]
    grid = MapGrid(-0.6, 0.8, 0.1, 30, 12)
    heights = heights_of(vertices, np.array([[0, 1, 2], [0, 2, 3]], np.int32), grid)
    x, y = np.meshgrid(*grid.centres())
    inside = (np.abs(x) < 1) & (np.abs(y) < 1)
    np.testing.assert_array_equal(np.isfinite(heights), inside)
    np.testing.assert_allclose(heights[inside], (0.3 * x - 0.2 * y + 5)[inside], atol=1e-5)
    normals = normals_of(heights, 0.1)[inside]
    np.testing.assert_allclose(normals, np.tile([-0.3, 0.2, 1] / np.sqrt(1.13), (len(normals), 1)), atol=1e-4)
    terrain = terrain_of(heights, 0.1, 5)
    np.testing.assert_allclose(terrain.slope[inside], np.degrees(np.arctan(np.hypot(0.3, 0.2))), rtol=1e-3)
    np.testing.assert_allclose(terrain.area[inside], 0.01 * np.sqrt(1.13), rtol=1e-3)
    np.testing.assert_allclose(terrain.rugosity[inside], np.sqrt(1.13), rtol=1e-3)
    assert np.isnan(terrain.rugosity[~inside]).all()


def test_the_uppermost_surface_is_mapped() -> None:
    square = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    vertices = np.concatenate([square + np.array([0, 0, 2]), square])
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]], np.int32)
    for order in (faces, faces[::-1].copy()):
        assert (heights_of(vertices, order, MapGrid(0, 1, 0.1, 10, 10)) == 2).all()


@pytest.fixture(scope="module")
def ball_mesh() -> tuple[Matrix, np.ndarray]:
    frames = [taken(BALL, looking_down(0.08 * k - 0.3, 0.06 * (k % 3) - 0.06), number=k) for k in range(8)]
    patch = fused(frames, 0.01)[1]
    return patch.vertices, patch.faces


def test_simplified_is_smaller_and_in_the_same_place(ball_mesh: tuple[Matrix, np.ndarray]) -> None:
    pytest.importorskip("fast_simplification")
    from uw_recon_ros.evaluate_surface import surface_errors

    vertices, faces = simplified(*ball_mesh, len(ball_mesh[1]) // 10)
    assert len(faces) <= 1.05 * len(ball_mesh[1]) // 10 + 1
    found = surface_errors(vertices, faces, *ball_mesh, samples=20_000)
    assert found.median_m < 5e-4
    assert found.completeness > 0.99


def test_a_texture_shows_what_is_there(ball_mesh: tuple[Matrix, np.ndarray]) -> None:
    """Every texel's place is on the mesh, and a picture sampled there is that of the place."""
    vertices, faces = ball_mesh
    atlas = make_atlas(vertices, faces, 0.01, 512)
    normals = vertex_normals(atlas.vertices, atlas.faces)
    texels = texels_of(atlas, normals, atlas.faces)
    filled = np.zeros((atlas.size, atlas.size), np.bool_)
    filled.ravel()[texels.index] = True
    assert len(texels.index) == filled.sum() > 0.3 * filled.size
    # at each vertex, the texel there lies where the vertex does
    column, row = np.clip(np.rint(atlas.uv * atlas.size - 0.5).astype(int), 0, atlas.size - 1).T
    places = np.full((*filled.shape, 3), np.nan)
    places.reshape(-1, 3)[texels.index] = texels.points
    off = np.linalg.norm(places[row, column] - atlas.vertices, axis=1)
    assert np.nanmedian(off) < 0.01
    assert np.nanquantile(off, 0.99) < 0.02
    frame = taken(BALL, looking_down(0.0, 0.0))
    best = BestViews(texels.points, texels.normals, 0.03)
    best.add(0, view_of(frame), photo(BALL, frame.pose), unbalanced(1))
    wrong = np.abs(best.colors()[best.seen] - paint(texels.points[best.seen]))
    assert np.median(wrong) < 3.0


def _solid() -> tuple[Matrix, np.ndarray]:
    """A closed body with faces in all directions, two of them above each other."""
    body = trimesh.creation.torus(0.3, 0.12)
    return np.asarray(body.vertices, np.float64), np.asarray(body.faces, np.int32)


def test_charts_share_no_texel_and_keep_the_shape_of_all_sides() -> None:
    vertices, faces = _solid()
    atlas = make_atlas(vertices, faces, 0.005, 4096)
    np.testing.assert_array_equal(
        np.unique(np.sort(atlas.vertices[atlas.faces].reshape(len(faces), 9), axis=1).round(9), axis=0),
        np.unique(np.sort(vertices[faces].reshape(len(faces), 9), axis=1).round(9), axis=0),
    )
    owner = np.full(atlas.size**2, -1)
    normals = vertex_normals(atlas.vertices, atlas.faces)
    charts = connected_components(coo_matrix(
        (np.ones(2 * len(faces)), (atlas.faces[:, :2].ravel(), atlas.faces[:, 1:].ravel())), 2 * (len(atlas.vertices),)
    ), directed=False)[1][atlas.faces[:, 0]]  # fmt: skip
    for chart in np.unique(charts):
        index = texels_of(atlas, normals, atlas.faces[charts == chart]).index
        assert (owner[index] == -1).all()
        owner[index] = chart
    a, b, c = np.moveaxis(atlas.vertices[atlas.faces], 1, 0)
    p, q, r = np.moveaxis(atlas.uv[atlas.faces].astype(np.float64) * atlas.size * 0.005, 1, 0)
    true = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    drawn = np.abs((q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0])
    assert (drawn / true).min() > 0.4
    assert (drawn / true).max() < 1.01


@pytest.mark.parametrize("most", [100, 300])
def test_an_atlas_is_no_larger_than_allowed(most: int) -> None:
    assert make_atlas(*_solid(), 0.001, most).size <= most


def test_the_filled_part_of_a_texture_grows_alike_in_bands_and_at_once() -> None:
    rng = np.random.default_rng(3)
    filled = rng.uniform(size=(600, 40)) < 0.01
    image = np.where(filled[..., None], rng.integers(1, 256, (600, 40, 3)), 0).astype(np.uint8)
    grew = grown(image, filled)
    assert (grew[filled] == image[filled]).all()
    assert (grew > 0).any(axis=-1).sum() > 2 * filled.sum()
    np.testing.assert_array_equal(grew[:300], grown(image[:320], filled[:320])[:300])
    np.testing.assert_array_equal(grew[250:], grown(image[240:], filled[240:])[10:])


def test_normals_of_a_mesh_point_outwards(ball_mesh: tuple[Matrix, np.ndarray]) -> None:
    normals = vertex_normals(*ball_mesh)
    flat = (np.hypot(ball_mesh[0][:, 0], ball_mesh[0][:, 1]) > 0.2) & (np.abs(ball_mesh[0][:, 2]) < 0.001)
    assert np.median(normals[flat, 2]) > 0.99
