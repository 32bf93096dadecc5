"""Lenses, mounting, rectification: against OpenCV and against the definition."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.simulate.rig import (
    Rig,
    distort,
    make_rig,
    pinhole_directions,
    pixel_directions,
    pose_at,
    project,
    rotation_about,
    undistort,
)
from uw_recon_ros.types import CameraModel, Matrix

PARAMS = [
    SimulateParams(axis=axis, misalignment_deg=angle, seed=seed, distortion=distortion)
    for axis, angle, seed, distortion in (
        ("horizontal", 0.7, 1, 0.12), ("horizontal", 3.0, 2, 0.3), ("vertical", 0.7, 3, 0.12), ("vertical", 0.0, 4, 0.0)
    )
]  # fmt: skip


def points_before(count: int = 200) -> Matrix:
    rng = np.random.default_rng(5)
    return rng.uniform([-0.6, -0.5, 0.9], [0.6, 0.5, 4.0], (count, 3))


def rectified_pixels(points: Matrix, camera: CameraModel) -> Matrix:
    """Raw pixels of points in the camera's frame, undistorted and rectified as CameraInfo says."""
    u, v = project(points, camera)
    moved = np.stack([(u - camera.k[0, 2]) / camera.k[0, 0], (v - camera.k[1, 2]) / camera.k[1, 1]], axis=1)
    ideal = undistort(moved, camera.d)
    turned = np.column_stack([ideal, np.ones(len(ideal))]) @ camera.r.T @ camera.p[:, :3].T
    return turned[:, :2] / turned[:, 2:]


def in_right(points: Matrix, rig: Rig) -> Matrix:
    return (points - rig.right_center) @ rig.right_from_left.T


def test_distortion_is_opencvs() -> None:
    rig = make_rig(PARAMS[1])
    points = points_before()
    for camera in (rig.calibration.left, rig.calibration.right):
        expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.k, camera.d)
        assert np.stack(project(points, camera), axis=1) == pytest.approx(expected[:, 0], abs=1e-9)
        ideal = points[:, :2] / points[:, 2:]
        assert undistort(distort(ideal, camera.d), camera.d) == pytest.approx(ideal, abs=1e-11)


def test_directions_project_back_onto_their_pixels() -> None:
    camera = make_rig(SimulateParams(width=64, height=48)).calibration.right
    u, v = project(3.7 * pixel_directions(camera), camera)
    assert u == pytest.approx(np.tile(np.arange(64.0), (48, 1)), abs=1e-8)
    assert v == pytest.approx(np.tile(np.arange(48.0)[:, None], (1, 64)), abs=1e-8)
    straight = pinhole_directions(camera.k, 64, 48)
    assert np.linalg.norm(straight, axis=-1) == pytest.approx(1.0)
    assert (straight / straight[..., 2:])[10, 20, 0] == pytest.approx((20 - camera.k[0, 2]) / camera.k[0, 0])


@pytest.mark.parametrize("params", PARAMS, ids=lambda p: f"{p.axis}-{p.misalignment_deg}")
def test_rectified_rows_agree_and_disparity_is_f_b_over_z(params: SimulateParams) -> None:
    rig = make_rig(params)
    points = points_before()
    left = rectified_pixels(points, rig.calibration.left)
    right = rectified_pixels(in_right(points, rig), rig.calibration.right)
    across, along = (1, 0) if params.axis == "horizontal" else (0, 1)
    assert left[:, across] == pytest.approx(right[:, across], abs=1e-7)
    depth = (points @ rig.calibration.left.r.T)[:, 2]
    assert rig.geometry.baseline_m == pytest.approx(np.linalg.norm(rig.right_center))
    expected = rig.geometry.focal_px * rig.geometry.baseline_m / depth
    assert left[:, along] - right[:, along] == pytest.approx(expected, abs=1e-7)
    assert rig.geometry.depth_from_disparity((left - right)[:, along]) == pytest.approx(depth, rel=1e-4)


@pytest.mark.parametrize("params", PARAMS, ids=lambda p: f"{p.axis}-{p.misalignment_deg}")
def test_projection_matrices_are_rectified_pinholes(params: SimulateParams) -> None:
    rig = make_rig(params)
    left, right = rig.calibration.left, rig.calibration.right
    assert np.array_equal(left.p[:, :3], right.p[:, :3])
    assert not left.p[:, 3].any()
    baseline = -right.p[:, 3] / right.p[0, 0]
    assert baseline[0 if params.axis == "horizontal" else 1] == pytest.approx(np.linalg.norm(rig.right_center))
    assert np.linalg.norm(rig.right_center) == pytest.approx(
        params.baseline_m, rel=0.03 * params.misalignment_deg + 1e-9
    )
    assert baseline[1 if params.axis == "horizontal" else 0] == 0
    assert rig.geometry.intrinsics_left == pytest.approx(left.p[:, :3])
    for camera in (left, right):
        assert camera.r @ camera.r.T == pytest.approx(np.eye(3), abs=1e-12)
        assert np.linalg.det(camera.r) == pytest.approx(1.0)
        turn_deg = np.degrees(np.arccos((np.trace(camera.r) - 1) / 2))
        assert turn_deg < 2.5 * params.misalignment_deg + 2.0


def test_straight_cameras_need_no_rectification() -> None:
    rig = make_rig(PARAMS[3])
    assert rig.calibration.left.r == pytest.approx(np.eye(3), abs=1e-12)
    assert rig.right_center == pytest.approx([0.0, 0.12, 0.0])


def test_rotation_is_rodrigues() -> None:
    for vector in np.random.default_rng(1).uniform(-2, 2, (10, 3)):
        assert rotation_about(vector) == pytest.approx(cv2.Rodrigues(vector)[0], abs=1e-12)
    assert np.array_equal(rotation_about(np.zeros(3)), np.eye(3))


def test_the_rig_looks_down_at_the_scene_and_moves_sideways() -> None:
    params = SimulateParams(frames=5, rate_hz=1.0, speed_m_s=0.1)
    poses = [pose_at(params, t) for t in range(5)]
    for pose in poses:
        assert pose.rotation @ pose.rotation.T == pytest.approx(np.eye(3), abs=1e-12)
        assert pose.rotation[2, 2] == pytest.approx(-np.sin(np.radians(42)), abs=0.05)
        assert pose.rotation[2, 1] < -0.6, "the image's bottom is down"
    assert [p.position[0] for p in poses] == pytest.approx([-0.2, -0.1, 0.0, 0.1, 0.2], abs=1e-9)
    still = SimulateParams(speed_m_s=0.0)
    assert np.array_equal(pose_at(still, 0.0).rotation, pose_at(still, 2.0).rotation)


def test_tolerances_follow_from_the_seed() -> None:
    a, b, other = (make_rig(SimulateParams(seed=seed)) for seed in (7, 7, 8))
    assert np.array_equal(a.calibration.right.k, b.calibration.right.k)
    assert not np.array_equal(a.calibration.right.k, other.calibration.right.k)
    assert not np.array_equal(a.calibration.left.k, a.calibration.right.k)


def test_the_dive_hands_out_the_rigs_geometry() -> None:
    dive = Dive(SimulateParams(width=32, height=24))
    assert np.array(dive.geometry.rect_from_raw_left) == pytest.approx(dive.calibration.left.r)
