"""Errors of trajectories against numbers that can be said beforehand."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros import rigid
from uw_recon_ros.errors import TrajectoryError
from uw_recon_ros.evaluate_trajectory import trajectory_errors
from uw_recon_ros.trajectory import Trajectory, trajectory_of

STAMPS = np.arange(101) * 10**8


def straight(scale: float = 1.0) -> Trajectory:
    poses = np.tile(np.eye(4), (101, 1, 1))
    poses[:, 0, 3] = scale * 0.1 * np.arange(101)
    poses[:, 1, 3] = scale * 0.5 * np.sin(0.1 * np.arange(101))
    return trajectory_of(STAMPS, poses)


def test_a_scale_error_is_drift_of_its_size() -> None:
    errors = trajectory_errors(straight(1.02), straight())
    part = errors.segments[0]
    assert part.scale == pytest.approx(1.02)
    for length in ("1 m", "4 m"):
        assert part.drift_percent[length] == pytest.approx(2.0, rel=0.05)
    assert np.isnan(part.drift_percent["16 m"])


def test_another_world_is_no_error() -> None:
    truth = straight()
    world = rigid.exp(np.array([4.0, 1.0, -2.0, 0.4, 1.0, -0.3]))
    moved = trajectory_of(STAMPS, world @ truth.poses)
    part = trajectory_errors(moved, truth).segments[0]
    assert part.ate_m < 1e-12
    assert part.drift_percent["1 m"] < 1e-9


def test_segments_are_judged_apart_and_stamps_decide() -> None:
    truth = straight()
    poses = truth.poses.copy()
    poses[50:, 2, 3] += 7.0
    apart = Trajectory(
        STAMPS, poses, truth.covariances, truth.status, (np.arange(101) >= 50).astype(np.int64), np.zeros(3)
    )
    errors = trajectory_errors(apart, truth)
    assert [s.frames for s in errors.segments] == [50, 51]
    assert max(s.ate_m for s in errors.segments) < 1e-9
    whole = trajectory_errors(trajectory_of(STAMPS, poses), truth)
    assert whole.segments[0].ate_m > 1.0
    assert trajectory_errors(apart.picked(np.arange(40)), truth).missing == 61
    with pytest.raises(TrajectoryError, match="clock"):
        trajectory_errors(trajectory_of(STAMPS + 5 * 10**7, poses), truth)
