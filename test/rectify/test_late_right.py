"""Pairs whose right image came late, on a plane whose truth is known: motion, rows and disparities."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.videos import texture

from uw_recon_ros import rigid
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.late_right import Moments, RigMotion, find_motion, of_one_moment, turned_back
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import CameraModel, DisparityMap, Matrix, StereoCalibration

W, H, F, B, DEPTH = 320, 240, 300.0, 0.12, 1.3
K = np.array([[F, 0, W / 2], [0, F, H / 2], [0, 0, 1.0]])
TWIST = np.array([0.15, -0.1, 0.12, 0.06, -0.08, 0.1])  # m/s, rad/s
LAG = 0.04


def rig() -> Rectification:
    turn = cv2.Rodrigues(np.array([0.0, 0.0, 0.01]))[0]  # a right camera that was mounted a little askew
    left = CameraModel(width=W, height=H, k=K, d=np.zeros(5), r=np.eye(3), p=np.hstack([K, np.zeros((3, 1))]))
    right = CameraModel(width=W, height=H, k=K, d=np.zeros(5), r=turn, p=np.hstack([K, [[-F * B], [0], [0]]]))
    return rectification_from_calibration(StereoCalibration(left, right), RectifyParams())


def seen(points: Matrix, pose: Matrix) -> Matrix:
    """Pixels (N, 2) of points in a camera at `pose`."""
    there = (points - pose[:3, 3]) @ pose[:3, :3]
    return np.asarray((there / there[:, 2:]) @ K.T)[:, :2]


def scene(found: Rectification, relief: float = 0.0) -> tuple[Matrix, TiePoints]:
    """Points in the left rectified view, on a grid of its pixels, and their raw pixels with the right image late."""
    u, v = (a.ravel().astype(np.float64) for a in np.meshgrid(np.arange(60, W - 20, 12), np.arange(20, H - 20, 12)))
    depth = DEPTH * (1 + relief * np.sin(u / 30))
    k = found.geometry.intrinsics_left
    points = np.column_stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(u)]) * depth[:, None]
    rig_pose = rigid.exp(TWIST * LAG)
    base = np.eye(4)
    base[0, 3], base[:3, :3] = B, found.right.r
    return points, TiePoints(seen(points, np.eye(4)), seen(points, rig_pose @ base), W, H)


def test_the_motion_is_found_from_the_frames_around() -> None:
    found, ground = rig(), texture(3, (H, W), 2.0)[..., 0]
    images = []
    for seconds in (-0.1, 0.1):  # the plane, seen by the left camera before and after
        pose = rigid.exp(TWIST * seconds)
        there = np.linalg.inv(pose)
        moved = K @ (there[:3, :3] + np.outer(there[:3, 3], [0, 0, 1 / DEPTH])) @ np.linalg.inv(K)
        images.append((seconds, np.asarray(cv2.warpPerspective(ground, moved, (W, H)), np.uint8)))
    _, points = scene(found)
    motion = find_motion(Moments(LAG, ground, images), points, found)
    assert motion is not None
    assert motion.twist[:3] == pytest.approx(TWIST[:3], abs=0.02)
    assert motion.twist[3:] == pytest.approx(TWIST[3:], abs=0.02)


def test_nothing_around_tells_no_motion() -> None:
    found = rig()
    assert find_motion(Moments(LAG, texture(3, (H, W))[..., 0]), scene(found)[1], found) is None


def mended(found: Rectification, relief: float, known: bool = True) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Depths that are true, those from the late pair, row errors, and the sigma of the disparities."""
    points, ties = scene(found, relief)
    motion = RigMotion(TWIST, np.eye(6) * 1e-6, 100)
    moved, late = turned_back(found, motion, LAG, ties) if known else (found, None)
    left, right = moved.rectified(ties)
    disparity = np.full((H, W), np.nan, np.float32)
    at = tuple(left.round().astype(int).T[::-1])
    disparity[at] = (left - right)[:, 0]
    status = np.where(np.isfinite(disparity), 0, 1).astype(np.uint8)
    sigma = np.where(np.isfinite(disparity), 0.1, np.nan).astype(np.float32)
    result = of_one_moment(DisparityMap(disparity, sigma, status, 0, 64, moved.geometry), late, LAG)
    return (
        points[:, 2],
        moved.geometry.depth_from_disparity(result.disparity)[at],
        (left - right)[:, 1],
        result.sigma[at],
    )


@pytest.mark.parametrize("relief", [0.0, 0.2])
def test_a_late_pair_gives_the_depths_of_one_moment(relief: float) -> None:
    true, depth, rows, _ = mended(rig(), relief)
    assert depth == pytest.approx(true, rel=2e-3)
    assert np.abs(rows).max() < 0.1 + 1.2 * relief
    unmended = mended(rig(), relief, known=False)
    assert np.abs(unmended[1] / true - 1).max() > 0.02
    assert np.abs(unmended[2]).max() > 0.5


def test_what_cannot_be_mended_is_less_sure() -> None:
    assert mended(rig(), 0.0, known=False)[3].min() > 0.15
    assert mended(rig(), 0.0)[3].max() < 0.11
