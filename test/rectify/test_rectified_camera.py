"""Views against the projection written out in `rig_scenes`, and against OpenCV."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers.rig_scenes import Camera, distort, intrinsics
from scipy.spatial.transform import Rotation

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, distorted, undistorted

CAMERAS = [
    ("plumb_bob", [0.0] * 5),
    ("plumb_bob", [-0.28, 0.11, 0.001, -0.002, -0.02]),
    ("rational_polynomial", [0.5, -0.3, 0.001, -0.0005, 0.02, 0.8, -0.2, 0.01]),
    ("equidistant", [0.05, -0.01, 0.004, -0.001]),
]
K = intrinsics(640, 480, 500.0) + np.array([[0, 0, 7.0], [0, 11.0, -4.0], [0, 0, 0]])
R = Rotation.from_euler("xyz", [3, -5, 2], degrees=True).as_matrix()
K_NEW = np.array([[480.0, 0, 300.0], [0, 480, 250], [0, 0, 1]])


def view_of(model, d):
    return RectifiedCamera(K, R, K_NEW, np.array(d), model)


def grid(width=640, height=480, step=40):
    v, u = np.mgrid[0:height:step, 0:width:step].astype(float)
    return np.column_stack([u.ravel(), v.ravel()])


@pytest.mark.parametrize(("model", "d"), CAMERAS)
def test_rectified_pixels_are_those_of_the_rotated_pinhole(model, d):
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.6, 0.6, (200, 2)), np.ones(200)]) * rng.uniform(0.5, 4, (200, 1))
    raw = Camera(K, np.eye(3), np.zeros(3), np.array(d), model).project(points)
    pinhole = points @ R.T @ K_NEW.T
    np.testing.assert_allclose(view_of(model, d).rectified(raw), pinhole[:, :2] / pinhole[:, 2:], atol=1e-7)


@pytest.mark.parametrize(("model", "d"), CAMERAS)
def test_raw_and_rectified_are_inverse(model, d):
    view = view_of(model, d)
    np.testing.assert_allclose(view.rectified(view.raw(grid())), grid(), atol=1e-6)


@pytest.mark.parametrize(("model", "d"), CAMERAS)
def test_maps_are_opencvs(model, d):
    make = cv2.fisheye.initUndistortRectifyMap if model == "equidistant" else cv2.initUndistortRectifyMap
    u, v = make(K, np.array(d)[:, None], R, K_NEW, (640, 480), cv2.CV_32FC1)
    ours = view_of(model, d).raw_grid(640, 480)
    np.testing.assert_allclose(ours[..., 0], u, atol=2e-3)
    np.testing.assert_allclose(ours[..., 1], v, atol=2e-3)
    np.testing.assert_allclose(ours[::40, ::40].reshape(-1, 2), view_of(model, d).raw(grid()), atol=1e-9)


@pytest.mark.parametrize(("model", "d"), CAMERAS)
def test_distortion_is_the_model_written_out(model, d):
    rays = grid() @ np.diag([1 / 500, 1 / 500]) - [0.64, 0.48]
    x, y = distort(rays[:, 0], rays[:, 1], np.array(d), model)
    expected = np.column_stack([x, y]) * np.diag(K)[:2] + K[:2, 2]
    np.testing.assert_allclose(distorted(view_of(model, d), rays), expected, atol=1e-9)


def test_what_no_ray_reaches_is_nan():
    """Strong barrel distortion turns back: pixels beyond the fold have no ray."""
    view = view_of("plumb_bob", [-0.5, 0, 0, 0, 0])
    assert np.isnan(undistorted(view, np.array([[20_000.0, 240.0]]))).all()


def test_behind_the_camera_is_nan():
    back = RectifiedCamera(K, Rotation.from_euler("y", 120, degrees=True).as_matrix(), K_NEW)
    assert np.isnan(back.rectified(np.array([[320.0, 240.0]]))).all()


def test_moved_views_move_pixels():
    view = view_of(*CAMERAS[1])
    np.testing.assert_allclose(view.moved(10, 20).rectified(grid()), view.rectified(grid()) - [10, 20], atol=1e-9)


def test_exchanging_rows_and_columns():
    view = RectifiedCamera(K, R, K_NEW)
    np.testing.assert_allclose(view.transposed().rectified(grid()[:, ::-1]), view.rectified(grid())[:, ::-1], atol=1e-9)
    bent = replace(view, d=np.array([-0.2, 0.03, 0, 0, 0]))
    np.testing.assert_allclose(bent.transposed().rectified(grid()[:, ::-1]), bent.rectified(grid())[:, ::-1], atol=1e-6)
    with pytest.raises(ValueError, match="radial distortion"):
        replace(view, d=np.array([-0.2, 0.03, 0.01, 0, 0])).transposed()


def test_identity():
    assert RectifiedCamera(K, np.eye(3), K).identity
    assert not RectifiedCamera(K, R, K).identity
    assert not RectifiedCamera(K, np.eye(3), K, np.array([0.1, 0, 0, 0])).identity
