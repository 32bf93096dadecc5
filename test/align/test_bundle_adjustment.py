"""Bundle adjustment of made-up views: against the truth, its own covariance, and key points that deceive."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers.track_scenes import GEOMETRY, bottom, descriptors, motion, seen

from uw_recon_ros import rigid
from uw_recon_ros.align.bundle_adjustment import Adjusted, adjust
from uw_recon_ros.align.bundle_groups import groups, partners
from uw_recon_ros.align.point_tracks import Observations, guided_matches, join_tracks
from uw_recon_ros.track.keypoints import PackedKeypoints, RigError, constants, packed
from uw_recon_ros.track.relate import projected
from uw_recon_ros.types import Matrix

LENS = np.array(constants(GEOMETRY, RigError()))


def views(rng: np.random.Generator, count: int = 8, shared_px: float = 0.0) -> tuple[Matrix, list[PackedKeypoints]]:
    """Poses along a line, and 300 key points in each; `shared_px`: an error that all disparities of a point have."""
    points = bottom(rng, 300)
    names, off = descriptors(rng, 300), shared_px * rng.standard_normal(300)
    poses = np.array(
        [motion(0.06 * k, 0.02 * np.sin(k), 0.01 * k, 0.02 * np.cos(k), 0.01 * k, 0.03 * k) for k in range(count)]
    )
    frames = [seen(points, pose, names, rng, pixel=0.1, sigma=0.1) for pose in poses]
    return poses, [packed(dataclasses.replace(f, measured=f.measured + off[:, None] * [0, 0, 1]), 300) for f in frames]


def whole(keypoints: list[PackedKeypoints]) -> Observations:
    """Every point in every frame, joined as it should be."""
    same = np.stack([np.arange(300)] * 2, axis=1)
    return join_tracks(keypoints, {(k, k + 1): same for k in range(len(keypoints) - 1)})


def shaken(poses: Matrix, rng: np.random.Generator) -> Matrix:
    moved: Matrix = poses @ rigid.exp(0.003 * rng.standard_normal((len(poses), 6)))
    moved[0] = poses[0]
    return moved


def adjusted(poses: Matrix, observations: Observations) -> Adjusted:
    found = adjust(poses, np.tile(LENS, (len(poses), 1)), observations, 0.35)
    assert found is not None
    return found


def test_poses_come_back_and_as_sure_as_they_are() -> None:
    squares = []
    for seed in range(6):
        rng = np.random.default_rng(seed)
        poses, keypoints = views(rng)
        found = adjusted(shaken(poses, rng), whole(keypoints))
        missed = rigid.log(rigid.inverse(found.poses) @ poses)[1:]
        assert np.abs(missed[:, :3]).max() < 0.001
        blocks = found.covariance.reshape(8, 6, 8, 6)[range(1, 8), :, range(1, 8)]
        squares.append(np.einsum("ni,nij,nj->n", missed, np.linalg.inv(blocks), missed).mean() / 6)
        assert found.sigma_px == pytest.approx(0.1, abs=0.02)
    assert 0.1 < np.mean(squares) < 1.2


def test_errors_that_all_disparities_of_a_point_share_hardly_bend_the_way() -> None:
    """As the matcher's are: a relation of two frames takes them for the bottom's shape."""
    rng = np.random.default_rng(3)
    poses, keypoints = views(rng, shared_px=0.3)
    found = adjusted(shaken(poses, rng), whole(keypoints))
    assert np.linalg.norm((found.poses - poses)[:, :3, 3], axis=1).max() < 0.002


def test_what_is_far_off_does_not_pull() -> None:
    rng = np.random.default_rng(4)
    poses, keypoints = views(rng)
    observations = whole(keypoints)
    clean = adjusted(poses, observations)
    wrong = rng.uniform(size=len(observations.frame)) < 0.1
    measured = observations.measured + wrong[:, None] * np.array([2.0, 1.0, 3.0])
    found = adjusted(poses, dataclasses.replace(observations, measured=measured))
    assert np.linalg.norm((found.poses - clean.poses)[:, :3, 3], axis=1).max() < 0.0005


def test_moving_the_world_moves_the_result_and_nothing_else() -> None:
    rng = np.random.default_rng(5)
    poses, keypoints = views(rng)
    world = motion(3.0, -2.0, 1.0, 0.3, -0.6, 1.0)
    plain, moved = adjusted(poses, whole(keypoints)), adjusted(world @ poses, whole(keypoints))
    assert moved.poses == pytest.approx(world @ plain.poses, abs=1e-6)
    assert moved.covariance == pytest.approx(plain.covariance, rel=1e-3, abs=1e-12)


def test_nothing_in_common_is_no_adjustment() -> None:
    poses, keypoints = views(np.random.default_rng(6), count=3)
    nothing = join_tracks(keypoints, {})
    assert len(nothing.frame) == 0
    assert adjust(poses, np.tile(LENS, (3, 1)), nothing, 0.35) is None


def test_matches_are_sought_where_they_are_expected_and_nowhere_else() -> None:
    rng = np.random.default_rng(7)
    points, names = bottom(rng, 300), descriptors(rng, 300)
    first, second = motion(0, 0, 0, 0, 0, 0), motion(0.1, 0, 0, 0, 0, 0)
    a, b = (packed(seen(points, pose, names, rng, pixel=0.1), 300) for pose in (first, second))
    there = rigid.inverse(second)
    expected = projected(points @ there[:3, :3].T + there[:3, 3], GEOMETRY, RigError())[:, :2]
    pairs = guided_matches(a, b, expected)
    assert len(pairs) == 300
    assert (pairs[:, 0] == pairs[:, 1]).all()
    assert len(guided_matches(a, b, expected + 200.0)) == 0


def test_a_track_that_a_frame_shows_twice_leaves_it_out() -> None:
    _, keypoints = views(np.random.default_rng(8), count=3)
    matches = {(0, 1): np.array([[5, 5], [6, 6]]), (1, 2): np.array([[5, 5], [6, 6]]), (0, 2): np.array([[9, 5]])}
    found = join_tracks(keypoints, matches)
    assert np.diff(found.starts).tolist() == [2, 3]
    assert found.frame.tolist() == [1, 2, 0, 1, 2]
    assert found.measured[0] == pytest.approx(keypoints[1].measured[5])


def test_partners_see_the_same_place_and_believed_relations_lead_there() -> None:
    places = np.column_stack(
        [np.r_[np.arange(20), np.arange(20)[::-1]] * 0.1, np.repeat([0.0, 0.05], 20), np.zeros(40)]
    )
    first, second = np.arange(39), np.arange(1, 40)
    along = partners(places, np.full(40, 0.25), first, second)
    assert (along[:, 1] - along[:, 0]).max() <= 3, "the way back is near, but nothing says that it is"
    closed = partners(places, np.full(40, 0.25), np.r_[first, 10], np.r_[second, 29])
    assert [9, 30] in closed.tolist()
    assert [2, 37] not in closed.tolist()
    assert (np.linalg.norm(places[closed[:, 0]] - places[closed[:, 1]], axis=1) < 0.25).all()


def test_every_frame_is_in_one_group_and_groups_stay_small() -> None:
    rng = np.random.default_rng(9)
    places = np.column_stack([rng.uniform(0, 30, 1000), rng.uniform(0, 10, 1000), np.zeros(1000)])
    pairs = np.stack([np.arange(999), np.arange(1, 1000)], axis=1)
    found = groups(places, pairs)
    assert np.array_equal(np.sort(np.concatenate([own for own, _ in found])), np.arange(1000))
    for own, around in found:
        assert len(own) <= 80
        assert len(around) <= 160
        assert np.isin(own, around).all()
        assert (np.diff(around) > 0).all()
