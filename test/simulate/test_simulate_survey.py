"""Dives along a track: is the way what it is called, does the bag hold what was asked for, is the truth true?"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from uw_recon_ros.bags import open_bag
from uw_recon_ros.bags.messages import stamp_ns
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.cli import main
from uw_recon_ros.files.trajectories import read_tum
from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive, simulate_survey
from uw_recon_ros.simulate.bottom import RIPPLE_M
from uw_recon_ros.simulate.material import TILE_M
from uw_recon_ros.simulate.navigation_sensors import GRAVITY, LATITUDE, LONGITUDE, SURFACE_PA, WATER_KG_M3
from uw_recon_ros.simulate.params import TRACKS, defaults_on
from uw_recon_ros.simulate.tracks import Course

TINY = SimulateParams.from_mapping(defaults_on("line") | {"width": 80, "height": 60, "frames": 8})


def course_of(track: str, **choice: Any) -> Course:
    frames = choice.pop("frames", 60)
    return Course(
        SimulateParams.from_mapping(defaults_on(track) | {"frames": frames}), CourseParams(track=track, **choice)
    )


def way(course: Course) -> np.ndarray[Any, Any]:
    """Waypoints every cm of 30 m: x, y, direction."""
    return np.array([dataclasses.astuple(course.waypoint(s)) for s in np.arange(0.0, 30.0, 0.01)])


@pytest.mark.parametrize("track", TRACKS)
def test_tracks_are_walked_at_their_length_without_a_jump_and_ahead(track: str) -> None:
    x, y, direction = way(course_of(track)).T
    steps = np.hypot(np.diff(x), np.diff(y))
    assert steps == pytest.approx(0.01, rel=1e-3, abs=1e-4)
    if track != "orbit":
        ahead = np.diff(x) * np.cos(direction[:-1]) + np.diff(y) * np.sin(direction[:-1])
        assert (ahead > 0.0098).all()
    turned = np.abs(np.angle(np.exp(1j * np.diff(direction))))
    assert turned.max() < 0.05


def test_lawnmower_covers_return_closes_orbit_looks_at_its_middle() -> None:
    x = way(course_of("lawnmower"))[:, 0]
    assert x[-1] > 4.0
    assert {0.0, 0.6, 1.2} <= set(np.round(x, 6))
    course = course_of("return")
    lap = 2 * (3.0 + math.pi * 0.3)
    assert dataclasses.astuple(course.waypoint(lap))[:2] == pytest.approx((0.0, 0.0), abs=1e-9)
    orbit = course_of("orbit")
    for seconds in (0.0, 3.0, 11.0):
        pose = orbit.pose(seconds)
        hit = pose.position - pose.position[2] / pose.rotation[2, 2] * pose.rotation[:, 2]
        assert np.hypot(*hit[:2]) < 0.12
    with pytest.raises(ValueError, match="pitch_deg"):
        Course(SimulateParams(pitch_deg=90.0), CourseParams(track="orbit"))


def test_heading_and_altitude_change_where_asked() -> None:
    plain, swinging = course_of("line"), course_of("line", heading_swing_deg=40.0, altitude_swing_m=0.3)
    heights = [[c.pose(t).position[2] for t in np.arange(0, 25, 0.2)] for c in (plain, swinging)]
    assert np.ptp(heights[0]) < 0.05
    assert np.ptp(heights[1]) == pytest.approx(0.6, abs=0.06)
    assert np.abs([swinging.pose(t).rotation[0, 0] for t in np.arange(0, 25, 0.2)]).min() < math.cos(math.radians(37))


def test_dropped_frames_and_a_blackout() -> None:
    course = course_of("line", dropped_share=0.2, frames=400)
    assert 0.7 < len(course.taken()) / 400 < 0.9
    assert course.taken()[0] == 0
    assert course.taken()[-1] == 399
    gaps = np.diff(course_of("line", blackout_m=3.0).taken())
    assert sorted(gaps)[-2:] == [1, 21]


def test_blur_smears_and_the_exposure_steps() -> None:
    params = dataclasses.replace(TINY, noise=0.0, snow_per_m3=0.0, frames=12)
    sharp = SurveyDive(params, CourseParams(track="line", bottom="flat"))
    other = SurveyDive(params, CourseParams(track="line", bottom="flat", blurred_share=1.0, exposure_step=0.5))
    contrast = [cv2.Laplacian(d.frame(2).left[..., 1], cv2.CV_64F).std() for d in (sharp, other)]
    assert contrast[1] < 0.5 * contrast[0]
    plain, bright = sharp.frame(11).left[20:40, 20:60], other.frame(11).left[20:40, 20:60]
    assert ((bright.mean() / plain.mean()) ** 2.2) == pytest.approx(1.5, rel=0.1)


def test_movers_move_and_the_rest_does_not() -> None:
    dive = SurveyDive(TINY, CourseParams(track="line", movers=3))
    apart = dive.scene_at(0).objects - dive.scene_at(6).objects
    assert (np.linalg.norm(apart[-3:, 1:4], axis=1) > 0.1).all()
    assert not apart[:-3].any()


@pytest.mark.parametrize(("bottom", "period"), [("tiles", TILE_M), ("ripples", RIPPLE_M)])
def test_floors_repeat_themselves(bottom: str, period: float) -> None:
    """A picture taken a period further along shows tiles that nobody can tell apart; depth alone for ripples."""
    params = dataclasses.replace(TINY, noise=0.0, snow_per_m3=0.0, frames=8)
    dive = SurveyDive(params, CourseParams(track="line", bottom=bottom))
    kept = dive.pose(0)
    places = [kept.position + np.array([0.0, k * period, 0.0]) for k in (0, 1)]
    dive.pose_after = lambda seconds: dataclasses.replace(  # type: ignore[method-assign]
        kept, position=places[round(seconds * params.rate_hz)]
    )
    first, second = dive.frame(0), dive.frame(1)
    assert np.abs(first.depth - second.depth).max() < 1e-3
    if bottom == "tiles":
        assert np.abs(first.left.astype(float) - second.left).mean() < 1.0


def test_a_rig_that_is_told_wrongly_has_that_disparity_offset() -> None:
    """Rectified by what is told, the disparity of a flat floor is off by what was asked for."""
    params = dataclasses.replace(TINY, width=240, height=180, noise=0.0, snow_per_m3=0.0, water="clear")
    dive = SurveyDive(params, CourseParams(track="line", bottom="flat", told_disparity_offset_px=1.5))
    frame = dive.frame(0)
    shown = {}
    for name, calibration in (("true", dive.calibration), ("told", dive.told_calibration)):
        camera = calibration.right
        maps = cv2.initUndistortRectifyMap(camera.k, camera.d, camera.r, camera.p[:, :3], (240, 180), cv2.CV_32FC1)
        shown[name] = cv2.remap(frame.right, *maps, cv2.INTER_CUBIC)[40:-40, 40:-40, 1].astype(np.float32)
    shift, _ = cv2.phaseCorrelate(shown["true"], shown["told"])
    assert shift == pytest.approx((-1.5, 0.0), abs=0.1), "the right image moves left, so u_left - u_right grows"
    focal = SurveyDive(TINY, CourseParams(track="line", told_focal_percent=0.5)).told_calibration
    assert focal.left.p[0, 0] / dive.calibration.left.p[0, 0] == pytest.approx(1.005 * 80 / 240, rel=1e-3)
    assert -focal.right.p[0, 3] / focal.right.p[0, 0] == pytest.approx(
        -dive.calibration.right.p[0, 3] / dive.calibration.right.p[0, 0]
    )


def written(folder: Path, *more: str) -> dict[str, list[Any]]:
    options = ["--track", "line", "--width", "80", "--height", "60", "--frames", "8", *more]
    assert main(["simulate", "-o", str(folder / "dive"), *options, "--truth", str(folder / "truth")]) == 0
    found: dict[str, list[Any]] = {}
    with open_bag(folder / "dive") as bag:
        for raw, message in bag.messages():
            found.setdefault(raw.topic, []).append(message)
    return found


def test_the_command_leaves_bag_trajectory_and_surface(tmp_path: Path) -> None:
    found = written(tmp_path, "--dropped-share", "0.3", "--told-disparity-offset-px", "0.4", "--movers", "1")
    truth = read_tum(tmp_path / "truth" / "trajectory.txt")
    stamps = [stamp_ns(message) for message in found["/left/image_raw"]]
    assert truth.stamps_ns.tolist() == stamps
    assert len(stamps) < 8
    place = found["/truth/pose"][-1].pose.position
    assert truth.positions[-1] == pytest.approx((place.x, place.y, place.z), abs=1e-8)
    told, true = (camera_from_info(found[f"{p}/right/camera_info"][0]) for p in ("", "/truth"))
    assert told.k[0, 2] - true.k[0, 2] == pytest.approx(0.4)

    mesh = trimesh.load(tmp_path / "truth" / "surface.ply")
    dive = SurveyDive(
        dataclasses.replace(TINY), CourseParams(track="line", dropped_share=0.3, told_disparity_offset_px=0.4, movers=1)
    )
    frame = dive.frame(0)
    points = dive._cameras[0].directions / dive._cameras[0].directions[..., 2:] * frame.depth[..., None]
    world = points[20:40, 20:60].reshape(-1, 3) @ frame.pose.rotation.T + frame.pose.position
    apart = cKDTree(mesh.vertices).query(world)[0]
    assert np.median(apart) < 0.008


def test_sensors_measure_the_way(tmp_path: Path) -> None:
    found = written(tmp_path)
    course = Course(TINY, CourseParams(track="line"))
    start = stamp_ns(found["/left/image_raw"][0])

    def seconds(message: Any) -> float:
        return (stamp_ns(message) - start) / 1e9

    depths = [(m.fluid_pressure - SURFACE_PA) / (WATER_KG_M3 * GRAVITY) for m in found["/pressure"]]
    true = [TINY.water_depth_m - course.pose(seconds(m)).position[2] for m in found["/pressure"]]
    assert np.std(np.array(depths) - true) == pytest.approx(0.01, rel=0.5)
    speeds = np.array([[m.twist.twist.linear.x, m.twist.twist.linear.y] for m in found["/dvl/twist"]])
    assert np.hypot(*speeds.T).mean() == pytest.approx(TINY.speed_m_s, rel=0.1)
    north = [math.radians(m.latitude - LATITUDE) * 6_378_137.0 for m in found["/gnss/fix"]]
    assert np.abs(np.array(north) - [course.pose(seconds(m)).position[1] for m in found["/gnss/fix"]]).max() < 2.0
    assert found["/gnss/fix"][0].longitude == pytest.approx(LONGITUDE, abs=1e-4)
    felt = np.array([[getattr(m.linear_acceleration, a) for a in "xyz"] for m in found["/imu/data"]])
    assert felt[:, 2].mean() == pytest.approx(-GRAVITY, abs=0.05), "a camera that looks down feels a push towards -z"
    rates = np.array([m.angular_velocity.z for m in found["/imu/data"]])
    assert rates.std() > 0.003


def test_options_of_a_track_need_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["simulate", "-o", str(tmp_path / "d"), "--movers", "2"]) == 2
    assert "--movers: expected --track" in capsys.readouterr().err
    assert main(["simulate", "-o", str(tmp_path / "d"), "--truth", str(tmp_path / "t")]) == 2
    assert main(["simulate", "-o", str(tmp_path / "d"), "--track", "orbit", "--pitch-deg", "90", "--frames", "2"]) == 2


def test_same_parameters_same_bag(tmp_path: Path) -> None:
    for name in "ab":
        path = tmp_path / name / "dive.mcap"
        simulate_survey(path, dataclasses.replace(TINY, frames=2), CourseParams(movers=1))
    assert (tmp_path / "a" / "dive.mcap").read_bytes() == (tmp_path / "b" / "dive.mcap").read_bytes()
