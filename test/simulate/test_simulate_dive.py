"""A whole dive: is what the cameras see what the truth says?"""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from uw_recon_ros.simulate import Dive, SimulatedFrame, SimulateParams
from uw_recon_ros.simulate.rig import project
from uw_recon_ros.simulate.snow import Snow
from uw_recon_ros.simulate.truth import rectify_depth
from uw_recon_ros.types import Matrix, Status

SMALL = SimulateParams(width=200, height=150, frames=3)
CLEAR = dataclasses.replace(SMALL, water="clear", snow_per_m3=0.0, noise=0.0, daylight=1.0)


def left_points(dive: Dive, frame: SimulatedFrame) -> Matrix:
    """The scene's points in the left optical frame, one a pixel."""
    rays = dive._cameras[0].directions
    return rays / rays[..., 2:] * frame.depth[..., None]


def in_right(dive: Dive, points: Matrix) -> Matrix:
    return (points - dive.rig.right_center) @ dive.rig.right_from_left.T


def best_shift(before: float, here: float, after: float) -> float:
    """Where the parabola through three equally spaced errors, at -0.5, 0 and 0.5 px, has its minimum."""
    assert here < min(before, after) / 1.5
    return 0.25 * (before - after) / (before - 2 * here + after)


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_what_both_cameras_see_looks_the_same(axis: str) -> None:
    dive = Dive(dataclasses.replace(CLEAR, axis=axis))
    frame = dive.frame(0)
    points = in_right(dive, left_points(dive, frame))
    u, v = project(points, dive.calibration.right)

    def difference(shift_px: float) -> Matrix:
        moved = (u + shift_px * (axis == "horizontal"), v + shift_px * (axis == "vertical"))
        warped = cv2.remap(frame.right, *(m.astype(np.float32) for m in moved), cv2.INTER_CUBIC)
        return np.abs(warped.astype(float) - frame.left).mean(axis=-1)

    seen = frame.status == 0
    assert seen.mean() > 0.85
    assert np.median(difference(0.0)[seen]) < 3.0
    assert np.median(difference(0.0)[frame.status == Status.OCCLUDED]) > 10.0
    around = np.ones((7, 7))
    inner = seen & (u > 2) & (u < 197) & (v > 2) & (v < 147)
    inner &= cv2.dilate(frame.depth, around) < 1.06 * cv2.erode(frame.depth, around)  # no mixed pixels
    before, here, after = ((difference(shift)[inner] ** 2).mean() for shift in (-0.5, 0.0, 0.5))
    assert best_shift(before, here, after) == pytest.approx(0.0, abs=0.03)


def test_status_is_what_the_right_camera_cannot_see() -> None:
    """Against a depth test in the right camera's own picture."""
    dive = Dive(CLEAR)
    frame = dive.frame(0)
    points = in_right(dive, left_points(dive, frame))
    u, v = project(points, dive.calibration.right)
    outside = (u < -0.5) | (u > 199.5) | (v < -0.5) | (v > 149.5)
    assert np.array_equal(outside, frame.status == Status.OUTSIDE)
    right_ranges = dive._see(dive._cameras[1], 0)[0]
    inner = ~outside & (u > 1) & (u < 198) & (v > 1) & (v < 148)
    around = cv2.erode(right_ranges, np.ones((3, 3)))[np.rint(v[inner]).astype(int), np.rint(u[inner]).astype(int)]
    beyond = cv2.dilate(right_ranges, np.ones((3, 3)))[np.rint(v[inner]).astype(int), np.rint(u[inner]).astype(int)]
    ours = np.linalg.norm(points[inner], axis=1)
    hidden = frame.status[inner] == Status.OCCLUDED
    assert hidden.sum() > 50
    assert (around[hidden] < ours[hidden]).all(), "something nearer is in the way"
    assert (ours[~hidden] < beyond[~hidden] * 1.01).all(), "nothing is seen through a surface"


def test_plane_depth_is_the_closed_form() -> None:
    dive = Dive(SimulateParams(scene="plane", width=64, height=48, frames=2))
    for index in (0, 1):
        pose = dive.pose(index)
        down = dive._cameras[0].directions @ pose.rotation[2]  # world z of each ray
        expected = -pose.position[2] / down * dive._cameras[0].directions[..., 2]
        assert dive.frame(index).depth == pytest.approx(expected, rel=1e-6)


def test_straight_down_on_a_plane_disparity_is_constant() -> None:
    params = SimulateParams(
        scene="plane", pitch_deg=90.0, speed_m_s=0.0, misalignment_deg=0.0, distortion=0.0, width=64, height=48
    )
    dive = Dive(params)
    disparity = dive.true_disparity(0, dive.geometry, 64, 48)
    assert disparity == pytest.approx(dive.geometry.focal_px * 0.12 / 1.3, rel=1e-6)


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_true_disparity_matches_the_rectified_views(axis: str) -> None:
    dive = Dive(dataclasses.replace(CLEAR, axis=axis))
    frame = dive.frame(1)
    views = []
    for image, camera in ((frame.left, dive.calibration.left), (frame.right, dive.calibration.right)):
        maps = cv2.initUndistortRectifyMap(camera.k, camera.d, camera.r, camera.p[:, :3], (200, 150), cv2.CV_32FC1)
        views.append(cv2.remap(image, *maps, cv2.INTER_CUBIC).astype(float))
    disparity = dive.true_disparity(1, dive.geometry, 200, 150)
    u, v = np.meshgrid(np.arange(200, dtype=np.float32), np.arange(150, dtype=np.float32))
    inner = (slice(40, -40), slice(60, -40))
    squares = []
    for shift in (-0.5, 0.0, 0.5):
        moved = (u - disparity + shift, v) if axis == "horizontal" else (u, v - disparity + shift)
        warped = cv2.remap(views[1], *(m.astype(np.float32) for m in moved), cv2.INTER_CUBIC)
        squares.append(((warped - views[0])[inner] ** 2).mean())
    assert best_shift(*squares) == pytest.approx(0.0, abs=0.03)


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_recorded_truth_turned_into_the_rectified_view(axis: str) -> None:
    dive = Dive(dataclasses.replace(SMALL, axis=axis))
    frame = dive.frame(0)
    turned = rectify_depth(frame.depth, dive.calibration.left, dive.geometry, 200, 150)
    exact = dive.true_depth(0, dive.geometry, 200, 150)
    known = np.isfinite(turned)
    assert known.mean() > 0.9
    relative = np.abs(turned / exact - 1)[known]
    assert np.median(relative) < 1e-4, "a tenth of a pixel's step in depth"
    assert np.percentile(relative, 95) < 1e-3


def test_rectify_depth_refuses_what_does_not_fit() -> None:
    dive = Dive(SimulateParams(width=32, height=24))
    with pytest.raises(ValueError, match=r"depth: expected \(24, 32\) as the camera has, got \(3, 4\)"):
        rectify_depth(np.ones((3, 4), np.float32), dive.calibration.left, dive.geometry, 32, 24)
    wide = dataclasses.replace(dive.calibration.left, distortion_model="equidistant")
    with pytest.raises(ValueError, match="expected plumb_bob distortion, got equidistant"):
        rectify_depth(np.ones((24, 32), np.float32), wide, dive.geometry, 32, 24)


def test_rectify_depth_keeps_holes_holes() -> None:
    dive = Dive(SimulateParams(width=64, height=48, distortion=0.0, misalignment_deg=0.0))
    depth = np.full((48, 64), 2.0, np.float32)
    depth[20:30, 20:30] = np.nan
    turned = rectify_depth(depth, dive.calibration.left, dive.geometry, 64, 48)
    assert np.isnan(turned).any()
    assert np.nanmax(np.abs(turned - 2.0)) < 1e-5


def test_frames_tell_one_world() -> None:
    """Points of one frame, carried by the poses, lie on the surface the next frame sees."""
    dive = Dive(CLEAR)
    a, b = dive.frame(0), dive.frame(2)
    world = left_points(dive, a) @ a.pose.rotation.T + a.pose.position
    there = (world - b.pose.position) @ b.pose.rotation
    u, v = project(there, dive.calibration.left)
    inside = (u > 1) & (u < 198) & (v > 1) & (v < 148)
    assert inside.mean() > 0.7
    rows, columns = np.rint(v[inside]).astype(int), np.rint(u[inside]).astype(int)
    relative = b.depth[rows, columns] / there[inside][:, 2] - 1
    assert np.median(np.abs(relative)) < 0.004
    assert (np.abs(relative) < 0.03).mean() > 0.93
    assert np.linalg.norm(a.pose.position - b.pose.position) > 0.05


def test_a_particle_has_its_own_parallax() -> None:
    dive = Dive(SMALL)
    pose = dive.pose(0)
    place = np.array([0.06, 0.02, 0.45])  # left optical frame, well before the scene
    dive._snow = Snow((pose.rotation @ place + pose.position)[None], np.array([0.002]))
    for view, camera in zip(dive._cameras, (dive.calibration.left, dive.calibration.right), strict=True):
        light = np.zeros((150, 200, 3), np.float32)
        dive._snow_into(light, view, np.full((150, 200), 5.0), 0)
        weight = light[..., 0].astype(np.float64)
        v, u = np.mgrid[:150, :200]
        centre = (weight * u).sum() / weight.sum(), (weight * v).sum() / weight.sum()
        seen = (place - view.origin) @ view.rotation
        assert centre == pytest.approx(tuple(float(x) for x in project(seen, camera)), abs=0.05)
        hidden = np.zeros((150, 200, 3), np.float32)
        dive._snow_into(hidden, view, np.full((150, 200), 0.3), 0)
        assert not hidden.any()


def test_snow_drifts_and_shows() -> None:
    quiet = dataclasses.replace(SMALL, width=120, height=90, noise=0.0, speed_m_s=0.0)
    with_snow, without = Dive(quiet), Dive(dataclasses.replace(quiet, snow_per_m3=0.0))
    first = with_snow.frame(0).left.astype(int) - without.frame(0).left
    second = with_snow.frame(1).left.astype(int) - without.frame(1).left
    assert 0.001 < (np.abs(first).max(axis=-1) > 8).mean() < 0.2
    assert (np.abs(first - second).max(axis=-1) > 8).mean() > 0.001
    assert np.array_equal(without.frame(0).left, without.frame(1).left)


def test_the_same_seed_gives_the_same_bytes() -> None:
    tiny = dataclasses.replace(SMALL, width=80, height=60)
    a, b = Dive(tiny), Dive(tiny)
    late = b.frame(2)
    for index in (0, 2):
        x, y = a.frame(index), late if index == 2 else b.frame(index)
        assert np.array_equal(x.left, y.left)
        assert np.array_equal(x.right, y.right)
        assert np.array_equal(x.depth, y.depth)
        assert np.array_equal(x.status, y.status)
    other = Dive(dataclasses.replace(tiny, seed=2)).frame(0)
    assert (other.left != a.frame(0).left).mean() > 0.5
    assert not np.array_equal(other.depth, a.frame(0).depth)


def test_right_camera_gain() -> None:
    base = dataclasses.replace(CLEAR, bits=16, lamp=0.3)
    plain, bright = Dive(base).frame(0), Dive(dataclasses.replace(base, gain_difference=0.2)).frame(0)
    assert np.array_equal(plain.left, bright.left)
    dark = (plain.right > 2000) & (plain.right < 40000)
    ratio = (bright.right[dark] / plain.right[dark]) ** 2.2
    assert ratio == pytest.approx(1.2, rel=5e-3)


def test_mono_sixteen_bit_and_weak_texture() -> None:
    mono = Dive(dataclasses.replace(SMALL, width=40, height=30, mono=True, bits=16)).frame(0)
    assert (mono.left.shape, mono.left.dtype) == ((30, 40), np.uint16)
    rich, weak = (
        Dive(dataclasses.replace(CLEAR, texture=texture)).frame(0).left[..., 1].astype(float)
        for texture in ("rich", "weak")
    )
    contrast = [np.abs(np.diff(image, axis=1)).mean() for image in (rich, weak)]
    assert contrast[1] < 0.25 * contrast[0]


def test_water_takes_contrast_with_distance() -> None:
    def contrast(water: str) -> Matrix:
        image = Dive(dataclasses.replace(CLEAR, water=water)).frame(0).left[..., 1].astype(float)
        return np.array([np.abs(np.diff(image[rows], axis=1)).mean() for rows in (slice(20), slice(-40, None))])

    ocean, harbour = contrast("I"), contrast("7C")
    assert harbour[0] < 0.5 * ocean[0]
    assert harbour[0] / ocean[0] < 0.8 * harbour[1] / ocean[1], "the far rows suffer more"


def test_every_pixel_is_shaded_by_directions_of_unit_length() -> None:
    dive = Dive(SMALL)
    for view in dive._cameras:
        assert np.linalg.norm(view.directions, axis=-1) == pytest.approx(1.0)


def test_parameters_are_checked() -> None:
    with pytest.raises(ValueError, match="bits: expected 8 or 16, got 12"):
        SimulateParams(bits=12)
    with pytest.raises(ValueError, match=r"distance_m: expected at least twice baseline_m = 0\.5 m, got 0\.6"):
        SimulateParams(baseline_m=0.5, distance_m=0.6)
    with pytest.raises(ValueError, match="scene: expected one of amphora, pipe, reef, plane, wreck, got 'castle'"):
        SimulateParams(scene="castle")
