"""A live model of made-up bottoms: its surface is known, and so is the error of the odometry it is made along."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from helpers.bottom_frames import GEOMETRY, METRE_PX, SECOND, bottom, pose_at, tiled_bottom, view

from uw_recon_ros import rigid
from uw_recon_ros.fuse.frame import posed_frame
from uw_recon_ros.live.model import LiveModel
from uw_recon_ros.live.params import LiveModelParams
from uw_recon_ros.track.keypoints import RigError, constants
from uw_recon_ros.types import Matrix

PICTURE = bottom()
STEP = np.diag([0.01**2] * 3 + [0.01**2] * 3)  # covariance of a step of the odometry


def there_and_back(count: int) -> list[Matrix]:
    """Out along x and back over the same ground."""
    x = np.r_[np.arange(count), np.arange(count)[::-1]] * 0.105 - 1.0
    return [pose_at(float(p), 0.02 * k / count) for k, p in enumerate(x)]


def drifting(poses: list[Matrix], drift: float) -> list[Matrix]:
    """An odometry that turns a little with every step."""
    wrong, out = rigid.exp(np.array([0, 0, 0, 0, 0, drift])), [poses[0]]
    for a, b in pairwise(poses):
        out.append(out[-1] @ rigid.inverse(a) @ b @ wrong)
    return out


def modelled(
    poses: list[Matrix], told: list[Matrix] | None = None, picture: np.ndarray = PICTURE, **chosen: float
) -> LiveModel:
    model = LiveModel(LiveModelParams.from_mapping({"model_submap_frames": 8, **chosen}))
    covariance = np.zeros((6, 6))
    for k, (pose, odometry) in enumerate(zip(poses, told or poses, strict=True)):
        frame = view(picture, pose, k * SECOND)
        fx, fy, cx, cy, fb, offset = constants(GEOMETRY, RigError())
        if k:
            back = rigid.adjoint(rigid.inverse(rigid.inverse(told[k - 1]) @ odometry)) if told else np.eye(6)
            covariance = back @ covariance @ back.T + STEP
        if model.wants(odometry):
            model.add(frame, posed_frame(frame, odometry, np.array([fx, fy, cx, cy]), fb, offset), covariance)
    return model


def test_submaps_are_the_bottom_in_its_colours() -> None:
    model = modelled([pose_at(0.105 * k - 0.8, 0.0) for k in range(16)], model_loop_m=0.0)
    assert len(model.submaps) == 2
    cloud = model.cloud(7, "map")
    assert (cloud.stamp_ns, cloud.frame_id, cloud.metric) == (7, "map", True)
    assert len(cloud.points) > 2000
    assert np.abs(cloud.points[:, 2]).max() < 0.01  # half a voxel
    assert np.ptp(cloud.points[:, 0]) == pytest.approx(1.575 - 0.21 + 320 / 250 * 1.2, abs=0.1)  # twice seen
    u, v = cloud.points[:, 0] * METRE_PX + 800, 800 - cloud.points[:, 1] * METRE_PX
    true = PICTURE[np.rint(v).astype(int), np.rint(u).astype(int)].astype(float)
    assert np.corrcoef(true, cloud.colors[:, 0].astype(float))[0, 1] > 0.8
    assert len(model.cloud(7, "map", last=True).points) < len(cloud.points)


def test_a_loop_brings_a_drifting_odometry_back() -> None:
    poses = there_and_back(20)
    told = drifting(poses, 0.004)
    model = modelled(poses, told)
    assert model.loops
    before = np.linalg.norm((told[-1] - poses[-1])[:3, 3])
    after = np.linalg.norm((model.correction @ told[-1] - poses[-1])[:3, 3])
    assert before > 0.1
    assert after < 0.3 * before
    for loop in model.loops:  # which submaps are moved by
        first, second = (poses[model.frames[k].stamp_ns // SECOND] for k in (loop.first, loop.second))
        true = rigid.inverse(first) @ second
        assert np.linalg.norm((loop.motion - true)[:3, 3]) < 0.02


def test_without_loops_the_map_is_the_odometry() -> None:
    told = drifting(there_and_back(10), 0.004)
    model = modelled(there_and_back(10), told, model_loop_m=0.0)
    assert not model.loops
    assert model.correction == pytest.approx(np.eye(4))


def test_a_tiled_floor_closes_no_wrong_loop() -> None:
    poses = there_and_back(14)
    model = modelled(poses, picture=tiled_bottom())
    for loop in model.loops:
        first, second = (poses[model.frames[k].stamp_ns // SECOND] for k in (loop.first, loop.second))
        true = rigid.inverse(first) @ second
        assert np.linalg.norm((loop.motion - true)[:3, 3]) < 0.03


def test_who_stands_still_is_fused_once() -> None:
    model = modelled([pose_at(0.001 * k, 0.0) for k in range(12)])
    assert (len(model.frames), model.submaps) == (1, [])
    turning = modelled([pose_at(0.0, 0.0, yaw=0.1 * k) for k in range(5)])
    assert len(turning.frames) == 5


def test_what_is_shown_stays_small() -> None:
    model = modelled(
        [pose_at(0.105 * k - 0.8, 0.0) for k in range(16)], model_most_points=1000, model_most_triangles=500,
        model_loop_m=0.0,
    )  # fmt: skip
    assert 500 < len(model.cloud(0, "map").points) <= 1000
    surface = model.surface(0, "map")
    assert 100 < len(surface.faces) <= 500
    assert surface.faces.max() < len(surface.vertices) == len(surface.colors)
    assert np.abs(surface.vertices[:, 2]).max() < 0.01


def test_before_the_first_submap_there_is_nothing_to_show() -> None:
    model = modelled([pose_at(0.0, 0.0)])
    assert model.cloud(0, "map").points.shape == (0, 3)
    assert model.surface(0, "map").faces.shape == (0, 3)
