"""Calibrated rigs against exact projection and against OpenCV's rectification; every contradiction."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers.rig_scenes import Camera, Rig, calibration_of, make_rig, random_rig, scatter, tie_points
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import CalibrationError, EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, TiePoints, rectification_from_calibration
from uw_recon_ros.types import StereoCalibration

PARAMS = RectifyParams()
PLUMB_BOB = np.array([-0.25, 0.08, 0.001, -0.0008, -0.01])
RATIONAL = np.array([0.4, -0.2, 0.0006, -0.0005, 0.02, 0.7, -0.15, 0.01])
EQUIDISTANT = np.array([0.03, -0.008, 0.003, -0.001])
TURNED = {"angles_deg": (1.0, -2.0, 1.5)}
RIGS = {
    "pinhole": make_rig(**TURNED),
    "plumb_bob": make_rig(**TURNED, d=PLUMB_BOB),
    "rational_polynomial": make_rig(**TURNED, d=RATIONAL, model="rational_polynomial"),
    "equidistant": make_rig(**TURNED, d=EQUIDISTANT, model="equidistant", focal=400.0),
    "below": make_rig(**TURNED, center=(0.01, 0.15, 0.0), d=PLUMB_BOB),
    "above": make_rig(**TURNED, center=(0.01, -0.15, 0.0), d=PLUMB_BOB),
}
RIG = RIGS["plumb_bob"]


def exact_depth(rig, found, points):
    return (points @ np.array(found.geometry.rect_from_raw_left).T)[:, 2]


@pytest.mark.parametrize("name", RIGS)
def test_depth_from_disparity_and_offset_is_exact(name):
    rig = RIGS[name]
    found = rectification_from_calibration(calibration_of(rig), PARAMS)
    left, right, points = rig.see(scatter(rig, 300, 0.8, 4.0, seed=1))
    seen = TiePoints(left, right, rig.width, rig.height)
    assert len(seen) > 60
    assert np.abs(found.row_errors(seen)).max() < 1e-6
    depth = found.geometry.focal_times_baseline / found.parallax(seen)
    np.testing.assert_allclose(depth, exact_depth(rig, found, points), rtol=1e-6)


@pytest.mark.parametrize("name", RIGS)
def test_rectified_pixels_and_intrinsics_give_the_point_back(name):
    """Triangulated in the rectified frame and turned back by ``rect_from_raw_left``: the point itself."""
    rig = RIGS[name]
    found = rectification_from_calibration(calibration_of(rig), PARAMS)
    left, right, points = rig.see(scatter(rig, 50, 0.8, 4.0, seed=2))
    seen = TiePoints(left, right, rig.width, rig.height)
    depth = found.geometry.focal_times_baseline / found.parallax(seen)
    rays = np.column_stack([found.rectified(seen)[0], np.ones(len(left))])
    rectified = rays @ np.linalg.inv(found.geometry.intrinsics_left).T * depth[:, None]
    np.testing.assert_allclose(rectified @ np.array(found.geometry.rect_from_raw_left), points, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "axis", "baseline"),
    [("pinhole", "horizontal", 0.15), ("below", "vertical", 0.1503), ("above", "vertical", -0.1503)],
)
def test_axis_and_signed_baseline(name, axis, baseline):
    geometry = rectification_from_calibration(calibration_of(RIGS[name]), PARAMS).geometry
    assert geometry.axis == axis
    assert geometry.metric
    assert geometry.baseline_m == pytest.approx(baseline, abs=1e-4)


@pytest.mark.parametrize("name", ["pinhole", "plumb_bob", "rational_polynomial", "equidistant"])
def test_maps_are_opencvs(name):
    calibration = calibration_of(RIGS[name])
    found = rectification_from_calibration(calibration, replace(PARAMS, rectify_crop=False))
    for camera, raw in ((calibration.left, found.left_map), (calibration.right, found.right_map)):
        make = cv2.fisheye.initUndistortRectifyMap if name == "equidistant" else cv2.initUndistortRectifyMap
        u, v = make(camera.k, camera.d[:, None], camera.r, camera.p[:, :3], (640, 480), cv2.CV_32FC1)
        near = (raw > -50).all(axis=2) & (raw < 700).all(axis=2)
        np.testing.assert_allclose(raw[..., 0][near], u[near], atol=5e-3)
        np.testing.assert_allclose(raw[..., 1][near], v[near], atol=5e-3)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), vertical=st.booleans(), distorted=st.booleans(), alpha=st.sampled_from([0.0, 1.0]))
def test_random_rigs_are_exact(seed, vertical, distorted, alpha):
    rig = random_rig(seed, vertical=vertical)
    if distorted:
        d = PLUMB_BOB * np.random.default_rng(seed).uniform(-0.5, 1.0)
        rig = replace(rig, left=replace(rig.left, d=d), right=replace(rig.right, d=0.8 * d))
    found = rectification_from_calibration(calibration_of(rig, alpha=alpha), PARAMS)
    left, right, points = rig.see(scatter(rig, 200, 1.0, 4.0, seed))
    seen = TiePoints(left, right, rig.width, rig.height)
    np.testing.assert_allclose(
        found.geometry.focal_times_baseline / found.parallax(seen), exact_depth(rig, found, points), rtol=1e-6
    )
    for raw in (found.left_map, found.right_map):
        assert raw.min() >= -0.5
        assert (raw <= np.array([rig.width, rig.height]) - 0.5).all()


def test_crop_keeps_the_offset_and_moves_the_principal_point():
    calibration = calibration_of(RIG, alpha=1.0)
    cropped, whole = (rectification_from_calibration(calibration, RectifyParams(rectify_crop=c)) for c in (True, False))
    window = whole.valid_left
    assert whole.valid_right == window
    assert (window.width, window.height) == (cropped.width, cropped.height)
    assert cropped.geometry.cx_left == whole.geometry.cx_left - window.u
    assert cropped.geometry.cx_right == whole.geometry.cx_right - window.u
    assert cropped.geometry.cy == whole.geometry.cy - window.v
    assert cropped.geometry.offset_px == calibration.right.p[0, 2] - calibration.left.p[0, 2]
    assert whole.geometry.cx_left == calibration.left.p[0, 2]


def given_calibration():
    rig = make_rig(center=(0.15, 0, 0))
    return rig, calibration_of(rig, alpha=-1)


def test_infos_of_rectified_images_change_nothing():
    """D = 0, R = I, P = [K | ...]: what a driver that rectifies publishes."""
    rig, calibration = given_calibration()
    right = calibration.right
    p = right.k @ np.array([[1.0, 0, 0, -0.15], [0, 1, 0, 0], [0, 0, 1, 0]])
    p[2, 3] = 0
    given_infos = StereoCalibration(
        replace(calibration.left, r=np.eye(3), p=np.hstack([right.k, np.zeros((3, 1))])),
        replace(right, r=np.eye(3), p=p),
    )
    found = rectification_from_calibration(given_infos, PARAMS, tie_points(rig))
    assert found.quality.method == "given"
    assert found.left_map is None
    assert (found.width, found.height) == (640, 480)
    assert found.geometry.baseline_m == pytest.approx(0.15)
    assert found.geometry.offset_px == 0


def test_row_error_is_measured():
    found = rectification_from_calibration(calibration_of(RIG), PARAMS, tie_points(RIG, noise=0.3))
    assert 0.1 < found.quality.row_error_median_px < 0.6
    assert found.quality.method == "calibrated"
    assert found.quality.warnings == ()
    assert found.quality.inliers > 100


def test_a_rig_that_moved_is_warned_of():
    moved = make_rig(angles_deg=(0.6, -2.0, 1.5), d=PLUMB_BOB)
    found = rectification_from_calibration(calibration_of(RIG), PARAMS, tie_points(moved))
    assert found.quality.row_error_median_px > 2
    assert Code.RECTIFY_ROWS_DISAGREE in {w.code for w in found.quality.warnings}
    assert not found.geometry.metric


@pytest.mark.parametrize("name", ["plumb_bob", "below", "above"])
def test_exchanged_images_are_refused(name):
    rig = RIGS[name]
    points = tie_points(rig)
    swapped = TiePoints(points.right, points.left, points.width, points.height)
    with pytest.raises(
        EstimationError, match=r"left and right images are swapped: .*got \d+% of \d+ tie points behind the rig"
    ):
        rectification_from_calibration(calibration_of(rig), PARAMS, swapped)


def changed(side, **fields):
    calibration = calibration_of(RIG)
    return replace(calibration, **{side: replace(getattr(calibration, side), **fields)})


def p_of(side="right", **entries):
    p = getattr(calibration_of(RIG), side).p.copy()
    for place, value in entries.items():
        p[int(place[1]), int(place[2])] = value
    return p


@pytest.mark.parametrize(
    ("calibration", "message"),
    [
        (changed("right", p=p_of(p03=0.0)), "two single cameras, not a stereo rig"),
        (changed("right", p=p_of(p03=90.0)), "P.3. = -fx B < 0, got 90"),
        (changed("right", p=p_of(p13=-50.0)), "either P.3. or P.7. to be 0"),
        (changed("left", p=p_of("left", p03=-90.0)), "left P: expected P.3. = P.7. = 0, got -90.*swapped"),
        (changed("right", p=p_of(p12=100.0)), "one cy for both rectified views"),
        (changed("right", p=p_of(p00=700.0)), "one fx and fy for both rectified views"),
        (changed("right", p=p_of(p22=2.0)), r"right P: expected \[fx 0 cx Tx"),
        (changed("left", r=np.diag([1.0, 1.0, -1.0])), "left R: expected a rotation"),
        (changed("left", r=np.eye(3) * 1.1), "left R: expected a rotation"),
        (changed("left", width=1280), "both cameras of one size, got 1280x480 and 640x480"),
        (changed("right", distortion_model="fov"), "right distortion_model: expected one of plumb_bob"),
    ],
)  # fmt: skip
def test_contradictions_are_named(calibration, message):
    with pytest.raises(CalibrationError, match=message):
        rectification_from_calibration(calibration, PARAMS)


def test_views_that_share_nothing_are_refused():
    calibration = calibration_of(make_rig(angles_deg=(0.0, 0.0, 0.0)))
    away = replace(calibration.left, r=Camera(np.eye(3), np.eye(3), np.zeros(3)).rotation @ np.diag([-1.0, 1.0, -1.0]))
    with pytest.raises(CalibrationError, match="share at least 20% of the image, got 0%"):
        rectification_from_calibration(replace(calibration, left=away), PARAMS)


def test_rigs_are_rigs():
    assert all(isinstance(rig, Rig) for rig in RIGS.values())
