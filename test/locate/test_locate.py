"""The whole way on small simulated dives: where it was, what was lost and said so, what does not join."""

from __future__ import annotations

import dataclasses
from functools import cache

import cv2
import numpy as np
import pytest

from uw_recon_ros import rigid
from uw_recon_ros.errors import EstimationError
from uw_recon_ros.evaluate_trajectory import trajectory_errors
from uw_recon_ros.findings import Code
from uw_recon_ros.locate.estimate import Located, estimate_trajectory
from uw_recon_ros.locate.priors import Priors, priors_from_trajectory
from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive
from uw_recon_ros.simulate.params import defaults_on
from uw_recon_ros.trajectory import DisparityFrame, PoseStatus, Trajectory, pose_matrix, trajectory_of

SIZE = (240, 180)


@cache
def dive(bottom: str = "objects") -> tuple[tuple[DisparityFrame, ...], Trajectory]:
    """Ten frames on a line: rectified left pictures, true disparity with noise, true poses of the rectified view."""
    params = SimulateParams.from_mapping(defaults_on("line") | {"width": SIZE[0], "height": SIZE[1], "frames": 10})
    made = SurveyDive(params, CourseParams(track="line", bottom=bottom))
    camera, frames, poses = made.calibration.left, [], []
    maps = cv2.initUndistortRectifyMap(camera.k, camera.d, camera.r, camera.p[:, :3], SIZE, cv2.CV_32FC1)
    for k in range(10):
        taken = made.frame(k)
        noise = 0.1 * np.random.default_rng(k).standard_normal(SIZE[::-1]).astype(np.float32)
        disparity = made.true_disparity(k, made.geometry, *SIZE) + noise
        left = np.asarray(cv2.remap(taken.left, *maps, cv2.INTER_CUBIC), np.uint8)
        frames.append(DisparityFrame(taken.stamp_ns, left, disparity, np.full_like(disparity, 0.1), made.geometry))
        turn = np.array(made.geometry.rect_from_raw_left).T
        poses.append(pose_matrix(taken.pose.position, taken.pose.rotation @ turn))
    return tuple(frames), trajectory_of([frame.stamp_ns for frame in frames], np.array(poses))


def blind(frame: DisparityFrame) -> DisparityFrame:
    """A frame whose picture is black; its disparity stays."""
    return dataclasses.replace(frame, left=np.zeros_like(frame.left))


def deaf(frame: DisparityFrame) -> DisparityFrame:
    """A frame of which nothing is known."""
    return dataclasses.replace(blind(frame), disparity=np.full_like(frame.disparity, np.nan))


def codes(located: Located) -> set[Code]:
    return {finding.code for finding in located.findings}


def test_a_line_is_a_line() -> None:
    frames, truth = dive()
    located = estimate_trajectory(frames)
    part = trajectory_errors(located.trajectory, truth).segments[0]
    assert Code.TRACK_STILL not in codes(located)
    assert part.frames == 10
    assert part.ate_m < 0.004
    assert part.drift_percent["1 m"] < 0.8
    assert Code.TRACK_GRAVITY_UNKNOWN in codes(located)
    assert (located.trajectory.status == PoseStatus.TRACKED).all()
    height = located.trajectory.positions[:, 2]
    assert height == pytest.approx(truth.positions[:, 2], abs=0.12), "level: z is up, zero on the bottom"


def test_the_same_frames_give_the_same_bits() -> None:
    frames, _ = dive()
    poses = [estimate_trajectory(frames[:4]).trajectory.poses for _ in range(2)]
    assert np.array_equal(*poses)


def test_a_frame_without_features_is_bridged_and_said_so() -> None:
    frames, truth = dive()
    located = estimate_trajectory([*frames[:5], blind(frames[5]), *frames[6:]])
    assert located.trajectory.status[5] in (PoseStatus.BRIDGED, PoseStatus.PREDICTED)
    assert codes(located) & {Code.TRACK_BRIDGED, Code.TRACK_PREDICTED}
    part = trajectory_errors(located.trajectory, truth).segments[0]
    assert part.frames == 10
    assert part.largest_m < 0.05


def test_a_frame_of_nothing_is_put_between_and_not_trusted() -> None:
    frames, truth = dive()
    located = estimate_trajectory([*frames[:5], deaf(frames[5]), *frames[6:]])
    assert located.trajectory.status[5] == PoseStatus.PREDICTED
    assert Code.TRACK_PREDICTED in codes(located)
    assert np.trace(located.trajectory.covariances[5]) > 100 * np.trace(located.trajectory.covariances[4])
    assert trajectory_errors(located.trajectory, truth).predicted == 1


def test_what_does_not_overlap_stays_apart_unless_poses_come_from_outside() -> None:
    frames, truth = dive()
    apart = [frames[k] for k in (0, 1, 9)]
    located = estimate_trajectory(apart)
    assert located.trajectory.segment.tolist() == [0, 0, 1]
    assert Code.TRACK_SEGMENTS in codes(located)
    given = estimate_trajectory(apart, priors_from_trajectory(truth, 0.02, 0.02))
    assert Code.TRACK_GRAVITY_UNKNOWN not in codes(given)
    assert given.trajectory.positions == pytest.approx(truth.positions[[0, 1, 9]], abs=0.06)


def test_priors_carry_the_world_and_one_that_lies_is_not_believed() -> None:
    frames, truth = dive()
    poses = truth.poses.copy()
    poses[4, 0, 3] += 3.0
    lying = Priors(truth.stamps_ns, poses, np.diag([400.0] * 3 + [2500.0] * 3), smooth=False)
    located = estimate_trajectory(frames, lying)
    assert np.abs(located.trajectory.positions - truth.positions).max() < 0.1


def partial_priors(truth: Trajectory, clock_s: float = 0.0) -> list[Priors]:
    """Attitudes whose heading is wrong, places without attitude, a depth gauge with its own zero."""
    rng, n = np.random.default_rng(5), len(truth)
    stamps = truth.stamps_ns + round(clock_s * 1e9)
    turned = truth.poses.copy()
    turned[:, :3, :3] = rigid.exp(np.array([0, 0, 0, 0, 0, 1.1]))[:3, :3] @ turned[:, :3, :3]
    turned[:, :3, 3] = 0.0
    placed, deep = np.tile(np.eye(4), (2, n, 1, 1))
    placed[:, :3, 3] = truth.positions + 0.03 * rng.standard_normal((n, 3))
    deep[:, 2, 3] = truth.positions[:, 2] + 0.005 * rng.standard_normal(n)
    return [
        Priors(stamps, turned, np.diag([0, 0, 0, 0.01**-2, 0.01**-2, 1e-6]), smooth=False, name="imu"),
        Priors(stamps, placed, np.diag([0.03**-2, 0.03**-2, 0.1**-2, 0, 0, 0]), smooth=False, name="fixes"),
        Priors(stamps, deep, np.diag([0, 0, 0.005**-2, 0, 0, 0]), smooth=False, name="pressure"),
    ]


def test_partial_knowledge_adds_up_to_a_place_in_the_world() -> None:
    frames, truth = dive()
    located = estimate_trajectory(frames, partial_priors(truth))
    assert np.abs(located.trajectory.positions - truth.positions).max() < 0.06
    turned = rigid.log(rigid.inverse(located.trajectory.poses) @ truth.poses)[:, 3:]
    assert np.linalg.norm(turned, axis=1).max() < 0.06
    assert not codes(located) & {Code.TRACK_GRAVITY_UNKNOWN, Code.TRACK_PRIORS_DISAGREE, Code.TRACK_PRIORS_LEFT_OUT}
    assert located.statistics["priors"] == {"imu": 10, "fixes": 10, "pressure": 10}


def test_places_alone_give_heading_and_the_bottom_is_level() -> None:
    frames, truth = dive()
    located = estimate_trajectory(frames, partial_priors(truth)[1:2])
    assert Code.TRACK_GRAVITY_UNKNOWN in codes(located)
    assert np.abs(located.trajectory.positions - truth.positions).max() < 0.15
    turned = rigid.log(rigid.inverse(located.trajectory.poses) @ truth.poses)[:, 3:]
    assert np.linalg.norm(turned, axis=1).max() < 0.2


def test_a_clock_of_another_day_is_noticed() -> None:
    frames, truth = dive()
    located = estimate_trajectory(frames, partial_priors(truth, clock_s=86400.0))
    assert {Code.TRACK_PRIORS_LEFT_OUT, Code.TRACK_GRAVITY_UNKNOWN} <= codes(located)
    plain = estimate_trajectory(frames)
    assert located.trajectory.positions == pytest.approx(plain.trajectory.positions, abs=0.01)


def test_poses_that_the_pictures_contradict_are_told() -> None:
    frames, truth = dive()
    backwards = Priors(truth.stamps_ns, truth.poses[::-1].copy(), np.diag([400.0] * 3 + [2500.0] * 3), smooth=False)
    assert Code.TRACK_PRIORS_DISAGREE in codes(estimate_trajectory(frames, backwards))


@pytest.mark.parametrize("factor", [9e-6, 1 / 0.3048, 1.0])
def test_positions_in_another_unit_are_told(factor: float) -> None:
    """Degrees and feet, as loosely held as files without a sigma are; metres are not told."""
    frames, truth = dive()
    poses = truth.poses.copy()
    poses[:, :3, 3] *= factor
    given = Priors(truth.stamps_ns, poses, np.diag([0.1**-2] * 3 + [2500.0] * 3), smooth=False)
    located = estimate_trajectory(frames, given)
    told = [finding for finding in located.findings if finding.advice and "degrees" in finding.advice]
    assert len(told) == (factor != 1.0)


def test_an_equal_floor_without_priors_has_no_silent_jump() -> None:
    """Either a step is right, or the frames are in different segments."""
    frames, truth = dive("tiles")
    located = estimate_trajectory(frames)
    for k in range(9):
        if located.trajectory.segment[k] != located.trajectory.segment[k + 1]:
            continue
        ours = rigid.inverse(located.trajectory.poses[k]) @ located.trajectory.poses[k + 1]
        true = rigid.inverse(truth.poses[k]) @ truth.poses[k + 1]
        assert np.linalg.norm((ours - true)[:3, 3]) < 0.05
    given = estimate_trajectory(frames, priors_from_trajectory(truth, 0.05, 0.02))
    assert np.abs(given.trajectory.positions - truth.positions).max() < 0.1


def test_no_frames_and_one_frame() -> None:
    with pytest.raises(EstimationError, match="at least one"):
        estimate_trajectory([])
    alone = estimate_trajectory(dive()[0][:1])
    assert len(alone.trajectory) == 1
