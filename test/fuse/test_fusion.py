"""Fusion against surfaces known in closed form, and against itself moved, reordered and divided otherwise."""

from __future__ import annotations

import dataclasses
from collections import Counter

import numpy as np
import pytest
from helpers.surface_scenes import NOWHERE, RADIUS, Ground, around, fused, looking_down, taken

from uw_recon_ros import rigid
from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code
from uw_recon_ros.fuse.blocks import pack, tiles_of, unpack
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.fuse.integrate import Volume, empty_volume
from uw_recon_ros.fuse.layout import LayoutBuilder, round_step
from uw_recon_ros.fuse.marching_cubes import TABLE, Patch, extract, joined
from uw_recon_ros.fuse.surface_pieces import seen_by, without_loose_pieces

BALL = Ground(((np.zeros(3), RADIUS),), plane=False)
VOXEL = 0.02


def ball_frames(**given: object) -> list[PosedFrame]:
    return [taken(BALL, pose, number=k, **given) for k, pose in enumerate(around())]  # type: ignore[arg-type]


def directed_edges(patch: Patch) -> Counter[tuple[int, int]]:
    return Counter((int(f[k]), int(f[(k + 1) % 3])) for f in patch.faces for k in range(3))


def volume_of(patch: Patch) -> float:
    a, b, c = np.moveaxis(patch.vertices[patch.faces], 1, 0)
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


def main_piece(patch: Patch) -> Patch:
    return without_loose_pieces(patch, 1000)


def test_a_ball_is_closed_and_where_it_is() -> None:
    _, found = fused(ball_frames(), VOXEL)
    ball = main_piece(found)
    edges = directed_edges(ball)
    assert all(edges[b, a] == count == 1 for (a, b), count in edges.items())  # watertight, turned one way
    assert volume_of(ball) == pytest.approx(4 / 3 * np.pi * RADIUS**3, rel=0.02)  # positive: counter-clockwise outside
    off = np.linalg.norm(ball.vertices, axis=1) - RADIUS
    assert np.median(np.abs(off)) < 0.08 * VOXEL
    assert np.abs(off).max() < 0.5 * VOXEL


def test_a_plane_is_exact_and_faces_up() -> None:
    frames = [taken(Ground(), looking_down(0.1 * k, 0.05)) for k in range(4)]
    _, plane = fused(frames, VOXEL)
    assert np.abs(plane.vertices[:, 2]).max() < 1e-4
    a, b, c = np.moveaxis(plane.vertices[plane.faces], 1, 0)
    normals = np.cross(b - a, c - a)
    assert (normals[:, 2] > 0).mean() > 0.999
    assert set(np.unique(plane.views)) <= {1, 2, 3, 4}
    assert plane.views.max() == 4


def test_every_case_of_the_table_closes_against_its_neighbours() -> None:
    """Voxels of random sign: all cases, all pairs of neighbours. Only the rim may be open."""
    rng = np.random.default_rng(0)
    blocks = np.stack(np.meshgrid(*[np.arange(-1, 2)] * 3, indexing="ij"), -1).reshape(-1, 3)
    volume = empty_volume(np.sort(pack(blocks)), 1.0)
    volume.distance[:] = rng.uniform(0.1, 1.0, volume.distance.shape) * rng.choice([-1, 1], volume.distance.shape)
    volume.weight[:] = 1
    found = extract(volume)
    edges = directed_edges(found)
    low, high = -8, 15
    for (a, b), count in edges.items():
        ends = found.vertices[[a, b]]
        on_rim = any(((ends[:, k] == low) | (ends[:, k] == high)).all() for k in range(3))
        assert count == 1
        assert edges[b, a] == 1 or on_rim, ends
    assert (TABLE[:, 0] > 0).sum() == 254


def test_tiles_joined_are_the_whole() -> None:
    """The ball lies across eight tiles."""
    volume, whole = fused(ball_frames(), VOXEL)
    tiles = np.unique(tiles_of(volume.keys), axis=0)
    assert len(tiles) == 8
    parts = joined([extract(volume, tile) for tile in tiles])
    assert len(parts.vertices) == len(whole.vertices)
    assert len(parts.faces) == len(whole.faces)
    order = np.argsort(whole.keys)
    np.testing.assert_array_equal(parts.vertices, whole.vertices[order])
    corners = [{tuple(sorted(row)) for row in p.keys[p.faces].tolist()} for p in (whole, parts)]
    assert corners[0] == corners[1]


def test_a_tile_alone_is_the_same_as_in_the_whole() -> None:
    """Fused from its own blocks and frames, as a long dive is: to the bit."""
    frames = ball_frames()
    builder = LayoutBuilder(VOXEL, 3.0)
    from uw_recon_ros.fuse.frame import view_of

    views = [view_of(frame) for frame in frames]
    for view in views:
        builder.add(view)
    layout = builder.finish()
    volume, _ = fused(frames, VOXEL)
    np.testing.assert_array_equal(layout.keys, volume.keys)
    for tile in layout.tiles:
        own = empty_volume(layout.blocks_of(tile), VOXEL)
        for k in layout.frames_of(tile):
            own.add(views[k], layout.band)
        alone, within = extract(own, tile), extract(volume, tile)
        np.testing.assert_array_equal(alone.vertices, within.vertices)
        np.testing.assert_array_equal(alone.faces, within.faces)


def test_frames_that_see_a_tile_are_found() -> None:
    builder = LayoutBuilder(0.005, 3.0)  # tiles of 1.92 m
    from uw_recon_ros.fuse.frame import view_of

    for x in (0.5, 10.0, 1.6):
        builder.add(view_of(taken(Ground(), looking_down(x, 0.5))))
    layout = builder.finish()
    assert layout.frames_of(np.array([0, 0, 0])).tolist() == [0, 2]
    assert layout.frames_of(np.array([1, 0])).tolist() == [2]  # a column; the first one's picture ends before it
    assert layout.frames_of(np.array([5, 0])).tolist() == [1]


@pytest.mark.parametrize("seed", [0, 1])
def test_a_world_turned_and_moved_gives_the_same_ball(seed: int) -> None:
    rng = np.random.default_rng(seed)
    world = rigid.exp(np.r_[rng.uniform(-3, 3, 3), rng.uniform(-1.5, 1.5, 3)])
    frames = [taken(BALL, pose, number=k, noise_m=0.003, world=world) for k, pose in enumerate(around())]
    still = main_piece(fused(ball_frames(noise_m=0.003), VOXEL)[1])
    moved = main_piece(fused(frames, VOXEL)[1])
    off = [np.linalg.norm(p.vertices - c, axis=1) - RADIUS for p, c in ((still, np.zeros(3)), (moved, world[:3, 3]))]
    assert volume_of(moved) == pytest.approx(volume_of(still), rel=2e-3)
    assert np.sqrt((off[1] ** 2).mean()) == pytest.approx(np.sqrt((off[0] ** 2).mean()), rel=0.1)


def test_the_order_of_frames_does_not_matter() -> None:
    frames = ball_frames(noise_m=0.003)
    one, two = fused(frames, VOXEL)[1], fused(frames[::-1], VOXEL)[1]
    places = [patch.vertices[np.argsort(patch.keys)] for patch in (one, two)]
    np.testing.assert_allclose(places[0], places[1], atol=1e-5)


def test_noise_averages_out_and_sigma_says_how_much() -> None:
    noise = 0.004
    frames = [taken(Ground(), looking_down(0.01 * k, 0.0), noise_m=noise, sigma_m=noise, number=k) for k in range(12)]
    few, many = fused(frames[:1], 0.01)[1], fused(frames, 0.01)[1]
    middle = [np.abs(p.vertices[:, :2]).max(axis=1) < 0.25 for p in (few, many)]
    errors = [p.vertices[m, 2].std() for p, m in zip((few, many), middle, strict=True)]
    assert errors[1] < 0.45 * errors[0]
    assert errors[1] < np.median(many.sigma[middle[1]]) < noise  # views have errors in common that this noise has not


def test_what_moved_on_is_voted_out() -> None:
    """A ball that is there in three frames of ten leaves no trace; one that stays is kept."""
    stays = (np.array([0.25, 0.0, 0.08]), 0.08)
    crawls = (np.array([-0.2, 0.05, 0.07]), 0.07)
    frames = []
    for k in range(10):
        ground = Ground((stays, crawls) if k in (2, 3, 4) else (stays,))
        frames.append(taken(ground, looking_down(0.01 * k - 0.05, 0.02 * (k % 3)), number=k))
    _, found = fused(frames, 0.01)
    kept = without_loose_pieces(seen_by(found, 2), 400)
    near = np.linalg.norm(kept.vertices[:, :2] - crawls[0][:2], axis=1) < 0.06
    assert near.sum() > 50  # the ground below it is there
    assert np.abs(kept.vertices[near, 2]).max() < 0.01
    top = np.linalg.norm(kept.vertices[:, :2] - stays[0][:2], axis=1) < 0.03
    assert kept.vertices[top, 2].max() == pytest.approx(0.16, abs=0.005)


def test_uncertain_depths_weigh_less() -> None:
    good = [taken(Ground(), looking_down(0.01 * k, 0.0), sigma_m=0.002, number=k) for k in range(3)]
    wrong = [dataclasses.replace(f, depth=f.depth - np.float32(0.01), sigma=f.sigma * np.float32(5)) for f in good]
    _, found = fused([*good, *wrong], 0.01)
    middle = np.abs(found.vertices[:, :2]).max(axis=1) < 0.2
    assert np.median(found.vertices[middle, 2]) == pytest.approx(0.01 / 26, abs=2e-4)


def test_nothing_in_view_gives_nothing() -> None:
    frame = taken(Ground(((NOWHERE, 0.1),), plane=False), looking_down(0.0, 0.0))
    volume, found = fused([frame], VOXEL)
    assert len(volume.keys) == len(found.vertices) == len(found.faces) == 0
    assert isinstance(volume, Volume)


def test_names_of_blocks() -> None:
    rng = np.random.default_rng(0)
    blocks = rng.integers(-60_000, 60_000, (1000, 3))
    np.testing.assert_array_equal(unpack(pack(blocks)), blocks)
    ordered = blocks[np.lexsort(blocks.T[::-1])]
    assert (np.diff(pack(ordered)) >= 0).all()


def test_utm_coordinates_without_an_origin_are_refused() -> None:
    world = np.eye(4)
    world[:3, 3] = 500_000.0, 4_800_000.0, 0.0
    with pytest.raises(ModelError, match="subtract an origin") as caught:
        fused([taken(Ground(), looking_down(0.0, 0.0), world=world)], VOXEL)
    assert caught.value.code is Code.MODEL_TOO_LARGE


@pytest.mark.parametrize(("length", "expected"), [(0.0047, 0.005), (0.0053, 0.005), (0.0056, 0.01), (0.021, 0.02)])
def test_sizes_of_voxels_are_round(length: float, expected: float) -> None:
    assert round_step(length) == expected
