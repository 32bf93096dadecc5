"""The way while the dive goes on: on made-up bottoms whose every view is known."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from helpers.bottom_frames import GEOMETRY, SECOND, bottom, pose_at, tiled_bottom, view
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros import rigid
from uw_recon_ros.track.odometry import Odometer, Step, vehicle_state
from uw_recon_ros.track.params import OdometryParams
from uw_recon_ros.track.repetition import period_px
from uw_recon_ros.trajectory import DisparityFrame, PoseStatus
from uw_recon_ros.types import Matrix

PICTURE = bottom()
STEP_S = 0.2


def frames(poses: list[Matrix], picture: np.ndarray = PICTURE, first: int = 0) -> list[DisparityFrame]:
    """Five a second."""
    return [view(picture, pose, round((first + k) * STEP_S * SECOND)) for k, pose in enumerate(poses)]


def dark(frame: DisparityFrame) -> DisparityFrame:
    return replace(frame, left=np.zeros_like(frame.left))


def bent(count: int) -> list[Matrix]:
    """A way that turns, rises and sinks."""
    return [pose_at(0.05 * k, 0.2 * np.sin(0.2 * k), 1.2 + 0.05 * np.sin(0.3 * k), 0.03 * k) for k in range(count)]


def relative(poses: list[Matrix]) -> Matrix:
    return np.array([rigid.inverse(poses[0]) @ pose for pose in poses])


def walk(seen: list[DisparityFrame], **chosen: float) -> list[Step]:
    odometer = Odometer(OdometryParams.from_mapping(chosen))
    return [odometer.add(frame) for frame in seen]


def test_a_way_with_turns_is_followed_and_its_covariance_holds() -> None:
    poses = bent(25)
    steps = walk(frames(poses))
    assert all(step.status is PoseStatus.TRACKED for step in steps)
    path = float(sum(np.linalg.norm((b - a)[:3, 3]) for a, b in pairwise(poses)))
    for step, true in zip(steps[1:], relative(poses)[1:], strict=True):
        missed = rigid.log(rigid.inverse(step.pose) @ true)
        assert np.linalg.norm(missed[:3]) < 0.01 * path
        assert missed @ np.linalg.solve(step.covariance, missed) < 40  # chi2 of 6 is below 23 in 999 of 1000
    assert np.trace(steps[-1].covariance) > np.trace(steps[5].covariance) > 0


def test_velocity_is_motion_over_time() -> None:
    poses = [pose_at(0.04 * k, 0.0) for k in range(4)]
    velocity = walk(frames(poses))[-1].velocity
    assert velocity is not None
    assert velocity == pytest.approx([0.2, 0, 0, 0, 0, 0], abs=0.01)


def test_a_short_loss_is_made_up_for_exactly() -> None:
    """Three black pictures: nothing is told, and then the true place is."""
    poses = bent(12)
    seen = frames(poses)
    for k in (5, 6, 7):
        seen[k] = dark(seen[k])
    steps = walk(seen)
    assert [k for k, step in enumerate(steps) if step.lost] == [5, 6, 7]
    assert all(np.isnan(steps[k].pose).all() for k in (5, 6, 7))
    assert np.linalg.norm((steps[-1].pose - relative(poses)[-1])[:3, 3]) < 0.02
    assert not any(step.resumed_after_s for step in steps)


def test_after_a_long_loss_the_way_goes_on_where_it_was_and_knows_that_it_may_be_elsewhere() -> None:
    before, after = [pose_at(-2.0 + 0.05 * k, 0) for k in range(6)], [pose_at(1.0 + 0.05 * k, 0.5) for k in range(6)]
    seen = frames(before) + [dark(f) for f in frames([before[-1]] * 20, first=6)] + frames(after, first=26)
    steps = walk(seen)
    resumed = next(k for k, step in enumerate(steps) if step.resumed_after_s)
    assert all(step.lost for step in steps[6:resumed])
    assert not any(step.lost for step in steps[resumed:])
    jump = np.linalg.norm((steps[resumed].pose - steps[5].pose)[:3, 3])
    assert jump < 0.1  # of one step
    true = rigid.inverse(before[0]) @ after[-1]
    missed = rigid.log(rigid.inverse(steps[-1].pose) @ true)
    assert np.linalg.norm(missed[:3]) > 1.0
    assert missed @ np.linalg.solve(steps[-1].covariance, missed) < 23


def test_no_view_in_common_is_no_motion() -> None:
    steps = walk(frames([pose_at(-2, 0), pose_at(2, 0), pose_at(0, 2)]))
    assert [step.lost for step in steps] == [False, True, True]


def test_a_black_start_waits_for_the_first_picture() -> None:
    seen = frames(bent(4))
    steps = walk([dark(seen[0]), *seen[1:]])
    assert [step.lost for step in steps] == [True, False, False, False]


def test_another_rig_begins_where_the_one_before_ended() -> None:
    poses = [pose_at(0.05 * k, 0) for k in range(6)]
    wide = replace(GEOMETRY, baseline_m=0.2)
    seen = frames(poses)
    seen[3:] = [view(PICTURE, pose, frame.stamp_ns, wide) for pose, frame in zip(poses[3:], seen[3:], strict=True)]
    steps = walk(seen)
    assert steps[3].resumed_after_s == pytest.approx(STEP_S)
    assert steps[3].pose == pytest.approx(steps[2].pose)
    assert not any(step.lost for step in steps)


@pytest.mark.parametrize("step_m", [0.03, 0.1, 0.2])
def test_a_tiled_floor_gives_no_wrong_motion(step_m: float) -> None:
    """Tiles of 24 cm: a motion is told where it is the only one the vehicle can have made, else none is."""
    poses = [pose_at(-1.5 + step_m * k, 0.0) for k in range(8)]
    steps = walk(frames(poses, tiled_bottom()))
    true = relative(poses)
    told = [k for k, step in enumerate(steps) if not step.lost]
    assert all(np.linalg.norm((steps[k].pose - true[k])[:3, 3]) < 0.03 for k in told)
    assert (len(told) == len(steps)) == (step_m == 0.03)  # the next that fits, 21 cm in 0.2 s, is too fast


def test_a_picture_that_repeats_itself_is_known() -> None:
    tiled = view(tiled_bottom(), pose_at(0, 0), 0).left[..., 0]
    assert period_px(tiled) == pytest.approx(60 / 250 / 1.2 * 250, rel=0.1)
    assert period_px(view(PICTURE, pose_at(0, 0), 0).left[..., 0]) is None
    assert period_px(np.full((240, 320), 7, np.uint8)) is None


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_a_state_says_in_ros_axes_what_the_step_says_in_the_views(seed: int) -> None:
    """Covariances against many poses drawn from the step's."""
    random = np.random.default_rng(seed)
    spread = 1e-3 * random.normal(size=(6, 6))
    covariance = spread @ spread.T
    pose, world, view_from_child = (rigid.exp(random.normal(size=6)) for _ in range(3))
    velocity = random.normal(size=6)
    state = vehicle_state(
        Step(1, pose, covariance, PoseStatus.TRACKED, velocity, covariance), "odom", "base", world, view_from_child
    )
    assert state.pose == pytest.approx(world @ pose @ view_from_child)
    drawn = pose @ rigid.exp((spread @ random.normal(size=(6, 4000))).T)
    bases = world @ drawn @ view_from_child
    moved = bases[:, :3, 3] - state.pose[:3, 3]
    turned = rigid.log(bases @ rigid.inverse(state.pose))[:, 3:]  # about the world's axes
    measured = np.cov(np.concatenate([moved, turned], axis=1).T)
    assert measured == pytest.approx(state.covariance, abs=0.15 * np.abs(state.covariance).max())
    later = world @ pose @ rigid.exp(1e-5 * velocity) @ view_from_child
    assert rigid.log(rigid.inverse(state.pose) @ later) / 1e-5 == pytest.approx(state.velocity, abs=1e-3)
