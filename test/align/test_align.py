"""Graph, loops, self-calibration: against closed forms, the noise that was put in, and changes that must not matter."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.track_scenes import GEOMETRY, bottom, descriptors, motion, seen

from uw_recon_ros import rigid
from uw_recon_ros.align.loops import candidates, loop_chi2, passes_chi2_gate, summed_covariances
from uw_recon_ros.align.pose_graph import Anchors, Edges, residuals, solve_graph
from uw_recon_ros.align.self_calibration import calibrate, corrected
from uw_recon_ros.track.keypoints import RigError
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import RelativePose, relate
from uw_recon_ros.types import Matrix

SIGMA = np.diag([0.001**2] * 3 + [0.001**2] * 3)
FIRST = np.array([0])


def circle(count: int = 60) -> Matrix:
    angles = 2 * np.pi * np.arange(count) / count
    poses = rigid.exp(np.column_stack([np.zeros((count, 5)), angles]))
    poses[:, :3, 3] = np.column_stack([np.cos(angles), np.sin(angles), 0.1 * np.sin(3 * angles)])
    return poses


def edges_of(poses: Matrix, rng: np.random.Generator, loops: int = 40) -> Edges:
    n = len(poses)
    a, b = np.arange(n - 1), np.arange(1, n)
    i = rng.integers(0, n // 2, loops)
    j = i + rng.integers(5, n // 2, loops)
    first, second = np.r_[a, i], np.r_[b, j]
    noise = rigid.exp(rng.multivariate_normal(np.zeros(6), SIGMA, len(first)))
    motions = rigid.inverse(poses[first]) @ poses[second] @ noise
    return Edges(first, second, motions, np.tile(SIGMA, (len(first), 1, 1)), np.arange(len(first)) >= n - 1)


def chained(edges: Edges, count: int, start: Matrix) -> Matrix:
    poses = [start]
    for k in range(count - 1):
        poses.append(poses[-1] @ edges.motions[k])
    return np.array(poses)


def test_graph_halves_the_error_and_its_covariance_is_honest() -> None:
    true, before, after, squares, chi2 = circle(), [], [], [], []
    for seed in range(12):
        edges = edges_of(true, np.random.default_rng(seed))
        start = chained(edges, 60, true[0])
        solved = solve_graph(start, edges, FIRST)
        before.append(np.linalg.norm(start[:, :3, 3] - true[:, :3, 3], axis=1).mean())
        after.append(np.linalg.norm(solved.poses[:, :3, 3] - true[:, :3, 3], axis=1).mean())
        missed = rigid.log(rigid.inverse(solved.poses) @ true)[1:]
        squares.append(np.einsum("ni,nij,nj->n", missed, np.linalg.inv(solved.covariances[1:]), missed).mean() / 6)
        chi2.append(solved.squares.sum() / (6 * 40))
    assert np.mean(after) < 0.5 * np.mean(before)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.4)
    assert np.mean(chi2) == pytest.approx(1.0, abs=0.1)


def test_moving_the_world_moves_the_result_and_nothing_else() -> None:
    true = circle()
    edges = edges_of(true, np.random.default_rng(1))
    world = motion(3.0, -2.0, 1.0, 0.3, -0.6, 1.0)
    start = chained(edges, 60, true[0])
    plain, moved = solve_graph(start, edges, FIRST), solve_graph(world @ start, edges, FIRST)
    assert moved.poses == pytest.approx(world @ plain.poses, abs=1e-6)
    assert moved.covariances == pytest.approx(plain.covariances, rel=1e-2, abs=1e-10)


def test_a_wrong_loop_is_thrown_off() -> None:
    true = circle()
    edges = edges_of(true, np.random.default_rng(2))
    edges.motions[-1] = edges.motions[-1] @ motion(0.25, 0, 0, 0, 0, 0)
    solved = solve_graph(chained(edges, 60, true[0]), edges, FIRST)
    without = solve_graph(chained(edges, 60, true[0]), edges.picked(np.arange(len(edges.first)) < 98), FIRST)
    assert np.linalg.norm(solved.poses[:, :3, 3] - without.poses[:, :3, 3], axis=1).max() < 0.002
    assert solved.squares[-1] > 1000


def test_anchors_pull_where_they_know_something() -> None:
    """Heights alone: the graph turns and lifts, and does not move along."""
    true = circle()
    edges = edges_of(true, np.random.default_rng(3), loops=0)
    start = chained(edges, 60, true[0])
    information = np.zeros((60, 6, 6))
    information[:, 2, 2] = 1e8
    solved = solve_graph(start, edges, FIRST, Anchors(np.arange(60), true, information), robust_scale=1e9)
    assert np.abs(solved.poses[:, 2, 3] - true[:, 2, 3]).max() < 0.2 * np.abs(start[:, 2, 3] - true[:, 2, 3]).max()
    whole = np.tile(np.diag([1e8] * 3 + [1e2] * 3), (60, 1, 1))
    shifted = true.copy()
    shifted[:, 0, 3] += 5.0
    free = solve_graph(start, edges, np.zeros(0, np.int64), Anchors(np.arange(60), shifted, whole), robust_scale=1e12)
    assert free.poses[:, 0, 3] == pytest.approx(shifted[:, 0, 3], abs=2e-3)


def test_at_the_true_poses_nothing_is_missed() -> None:
    true = circle()
    edges = edges_of(true, np.random.default_rng(0))
    exact = Edges(
        edges.first,
        edges.second,
        rigid.inverse(true[edges.first]) @ true[edges.second],
        edges.covariances,
        edges.robust,
    )
    assert np.abs(residuals(true, exact)).max() < 1e-12


def test_candidates_are_near_apart_in_time_and_few() -> None:
    seen_at = np.column_stack([np.r_[np.arange(30), np.arange(30)[::-1]] * 0.15, np.zeros((60, 2))])
    pairs = candidates(seen_at, np.full(60, 0.5), np.zeros(60, np.int64), 2, {(29, 37)})
    assert all(k - i >= 8 for i, k in pairs)
    assert max(np.bincount([k for _, k in pairs])) <= 2
    assert all(abs(seen_at[i, 0] - seen_at[k, 0]) < 0.5 for i, k in pairs)
    assert (29, 37) not in pairs
    assert not candidates(seen_at, np.full(60, 0.5), np.arange(60), 2, set())


def test_a_loop_that_the_track_cannot_have_made_is_not_believed() -> None:
    poses = circle()
    steps = np.tile(SIGMA, (60, 1, 1))
    sums = summed_covariances(poses, steps)
    true = rigid.inverse(poses[10]) @ poses[40]
    assert passes_chi2_gate(loop_chi2(poses, sums, 10, 40, true, SIGMA))
    assert not passes_chi2_gate(loop_chi2(poses, sums, 10, 40, true @ motion(0.25, 0, 0, 0, 0, 0), SIGMA))
    # the sum over the stretch is that of carrying every step on its own
    by_hand = np.zeros((6, 6))
    for k in range(11, 41):
        carry = rigid.adjoint(rigid.inverse(poses[40]) @ poses[k])
        by_hand += carry @ steps[k] @ carry.T
    back = rigid.adjoint(rigid.inverse(poses[40]))
    assert back @ (sums[40] - sums[10]) @ back.T == pytest.approx(by_hand, rel=1e-6, abs=1e-15)


def relations(truth: RigError, count: int = 40) -> list[RelativePose]:
    rng, found = np.random.default_rng(11), []
    for _ in range(count):
        points, names = bottom(rng, 400), descriptors(rng, 400)
        step = motion(*(rng.normal(size=3) * 0.12), *(rng.normal(size=3) * 0.06))
        first = seen(points, np.eye(4), names, rng, truth=truth)
        relation = relate(first, seen(points, step, names, rng, truth=truth), GEOMETRY, TrackParams())
        assert relation is not None
        found.append(relation)
    return found


@pytest.mark.parametrize("truth", [RigError(), RigError(-0.3, 0.0), RigError(-0.3, -0.005)])
def test_the_rig_is_found_within_its_sigma(truth: RigError) -> None:
    finding = calibrate(relations(truth), GEOMETRY, 0.35)
    assert finding is not None
    assert abs(finding.error.offset_px - truth.offset_px) < 3.5 * finding.offset_sigma_px
    assert abs(finding.error.focal - truth.focal) < 3.5 * finding.focal_sigma
    assert finding.offset_sigma_px < 0.1
    if truth.offset_px == 0:
        assert finding.applied == RigError()
    assert calibrate(relations(truth, 3), GEOMETRY, 0.35) is None


def test_noise_over_a_flat_bottom_is_not_taken_for_an_offset() -> None:
    rng, found = np.random.default_rng(4), []
    for _ in range(120):
        points, names = bottom(rng, 400, relief_m=0.01), descriptors(rng, 400)
        step = motion(0.1 + 0.05 * rng.uniform(), *(rng.normal(size=5) * 0.01))
        first, second = (seen(points, pose, names, rng, sigma=0.25) for pose in (np.eye(4), step))
        relation = relate(first, second, GEOMETRY, TrackParams())
        assert relation is not None
        found.append(relation)
    finding = calibrate(found, GEOMETRY, 0.35)
    assert finding is not None
    assert abs(finding.error.offset_px) < 3 * finding.offset_sigma_px
    assert finding.applied == RigError()


def test_a_corrected_relation_has_the_true_scale() -> None:
    truth = RigError(-1.0, 0.0)
    told = relations(truth, 1)[0]
    mended = corrected(told, GEOMETRY, 0.35, truth)
    assert mended.chi2 <= told.chi2 + 0.02
    ratio = np.linalg.norm(mended.motion[:3, 3]) / np.linalg.norm(told.motion[:3, 3])
    assert ratio == pytest.approx(1.0 + 1.0 / (500 * 0.12 / 1.25), abs=0.01)
