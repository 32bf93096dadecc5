"""Dives that go wrong in ways of their own, over made-up bottoms whose every view is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.bottom_frames import SECOND, bottom, pose_at, view

from uw_recon_ros import rigid
from uw_recon_ros.findings import Code
from uw_recon_ros.locate.estimate import Located, estimate_trajectory
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix

PICTURE = bottom()


def frames(poses: list[Matrix]) -> list[DisparityFrame]:
    return [view(PICTURE, pose, k * SECOND) for k, pose in enumerate(poses)]


def missed_m(located: Located, poses: list[Matrix]) -> np.ndarray:
    """How far each position is from the truth, the first frame laid onto it."""
    found = rigid.inverse(located.trajectory.poses[0]) @ located.trajectory.poses
    true = rigid.inverse(poses[0]) @ np.array(poses)
    return np.linalg.norm((found - true)[:, :3, 3], axis=1)


def test_a_camera_that_stands_still_stays_where_it_is() -> None:
    """No motion is no relation of its own, no drift and no reason to doubt the rig."""
    poses = [pose_at(0.0, 0.0)] * 10
    located = estimate_trajectory(frames(poses))
    assert set(located.trajectory.segment) == {0}
    assert missed_m(located, poses).max() < 0.002
    assert located.applied.offset_px == located.applied.focal == 0
    assert Code.TRACK_STILL in {finding.code for finding in located.findings}


def in_other_light(frame: DisparityFrame) -> DisparityFrame:
    """Half as bright, from the other side, and of another colour."""
    width = frame.left.shape[1]
    lamp = np.linspace(0.25, 0.8, width)[None, :, None] * np.array([0.6, 1.0, 0.8])
    return replace(frame, left=np.clip(frame.left * lamp, 1, 255).astype(np.uint8))


def test_a_dive_that_crosses_itself_in_other_light_closes_the_loop() -> None:
    way = [pose_at(-0.8 + 0.12 * k, 0.0) for k in range(12)]
    back = [pose_at(-0.8 + 0.12 * k, 0.15) for k in range(12)][::-1]
    seen = frames(way) + [
        in_other_light(view(PICTURE, pose, (k + len(way)) * SECOND)) for k, pose in enumerate(back)
    ]  # fmt: skip
    located = estimate_trajectory(seen)
    assert located.statistics["loops"] >= 3
    for link in located.links:
        true = rigid.inverse((way + back)[link.first]) @ (way + back)[link.second]
        assert np.linalg.norm((link.relation.motion - true)[:3, 3]) < 0.02
    assert missed_m(located, way + back).max() < 0.02


@pytest.mark.parametrize("seed", [0, 1])
def test_a_fifth_of_the_frames_lost_makes_no_wrong_step(seed: int) -> None:
    poses = [pose_at(-1.2 + 0.12 * k, 0.1 * np.sin(0.5 * k), yaw=0.05 * k) for k in range(20)]
    kept = np.random.default_rng(seed).uniform(size=len(poses)) >= 0.2
    left = [pose for pose, keep in zip(poses, kept, strict=True) if keep]
    located = estimate_trajectory([f for f, keep in zip(frames(poses), kept, strict=True) if keep])
    assert len(left) < len(poses)
    assert set(located.trajectory.segment) == {0}
    assert missed_m(located, left).max() < 0.02
