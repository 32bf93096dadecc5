"""Lenses of wide views: the equidistant model, chosen where it predicts better."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, rig_of, sightings

from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.fit import Fit, solve
from uw_recon_ros.calibrate.optics import EXTRINSIC, NAMES, PROJECTIONS, SIDES, intrinsic_matrix, names_of, shape_of
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.calibrate_files import air_rig, calibrate_seen, write_result
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.files.calibrations.write import write_calibration
from uw_recon_ros.lenses import AUTO, EQUIDISTANT, PLUMB_BOB
from uw_recon_ros.types import Matrix

SIZE = (1280, 960)


def truth() -> Matrix:
    """Of a rig that sees 150 degrees across."""
    numbers = np.zeros(len(NAMES))
    numbers[SIDES[0]] = [480, 481, 640, 478, -0.02, 0.006, 0, 0, 0]
    numbers[SIDES[1]] = [482, 481, 645, 474, -0.022, 0.007, 0, 0, 0]
    numbers[EXTRINSIC] = [0.01, -0.008, 0.004, -0.12, 0.001, -0.002]
    return numbers


def fisheye_pairs(count: int, noise_px: float = 0.3) -> list[SeenPair]:
    """Boards held up to 65 degrees off the axis, facing the cameras, tilted."""
    rng, made = np.random.default_rng(1), list[SeenPair]()
    while len(made) < count:
        aside, round_it, away = np.deg2rad(rng.uniform(0, 65)), rng.uniform(0, 2 * np.pi), rng.uniform(0.4, 1.5)
        facing = cv2.Rodrigues(aside * np.array([-np.sin(round_it), np.cos(round_it), 0.0]))[0]
        turn = facing @ cv2.Rodrigues(np.array([*(0.4 * rng.standard_normal(2)), 0.2 * rng.standard_normal()]))[0]
        move = away * facing[:, 2] - turn @ BOARD.points().mean(axis=0)
        pose = np.concatenate([cv2.Rodrigues(turn)[0].ravel(), move])
        seen = [project(truth(), pose, BOARD.points())[0] for project in PROJECTIONS[EQUIDISTANT]]
        if all((px > 4).all() and (px < np.array(SIZE) - 5).all() for px in seen):
            both = (Sighting(np.arange(54), px + noise_px * rng.standard_normal(px.shape), 1.5, 40.0) for px in seen)
            made.append(SeenPair(f"{len(made):02}", *both))
    return made


@pytest.fixture(scope="module")
def fitted() -> Fit:
    return solve(fisheye_pairs(16), BOARD, SIZE, AUTO)


def test_slopes_are_those_of_the_projection() -> None:
    pose, numbers = np.array([0.2, -0.3, 0.1, -0.4, 0.05, 0.5]), truth()
    for project in PROJECTIONS[EQUIDISTANT]:
        _, by_numbers, by_pose = project(numbers, pose, BOARD.points())
        for k, name in enumerate(names_of(EQUIDISTANT)):
            step = 1e-6 * np.eye(len(numbers))[k]
            there, back = (project(numbers + sign * step, pose, BOARD.points())[0].ravel() for sign in (1, -1))
            assert by_numbers[:, k] == pytest.approx((there - back) / 2e-6, abs=2e-3, rel=1e-4)
            assert name or not by_numbers[:, k].any()
        for k in range(6):
            step = 1e-6 * np.eye(6)[k]
            there, back = (project(numbers, pose + sign * step, BOARD.points())[0].ravel() for sign in (1, -1))
            assert by_pose[:, k] == pytest.approx((there - back) / 2e-6, abs=2e-3, rel=1e-4)


def test_a_wide_lens_is_taken_for_what_it_is(fitted: Fit) -> None:
    assert fitted.lens == EQUIDISTANT
    assert not fitted.left_out
    assert fitted.bundle.noise_px == pytest.approx(0.3, rel=0.05)
    off = (fitted.bundle.numbers - truth()) / np.sqrt(np.maximum(np.diag(fitted.bundle.covariance), 1e-30))
    assert np.abs(off[fitted.bundle.free]).max() < 5
    rig = RigNumbers(fitted.bundle.numbers, SIZE, fitted.lens)
    assert rig.baseline_m == pytest.approx(np.linalg.norm(truth()[EXTRINSIC][3:]), rel=3e-3)


def test_a_wide_view_without_a_fisheye_stays_plumb_bob() -> None:
    rig = rig_of(3, width=1280, height=960, fov_deg=95.0)
    assert solve(sightings(rig, 10, 3), BOARD, SIZE, AUTO).lens == PLUMB_BOB


def test_opencv_agrees(fitted: Fit) -> None:
    """Its own solver, from our solution, stays there."""
    k = [intrinsic_matrix(fitted.bundle.numbers[side]) for side in SIDES]
    d = [shape_of(fitted.bundle.numbers[side], EQUIDISTANT) for side in SIDES]
    objects = [BOARD.points().reshape(1, -1, 3)] * len(fitted.pairs)
    seen = [[getattr(pair, side).pixels.reshape(1, -1, 2) for pair in fitted.pairs] for side in ("left", "right")]
    of = cv2.fisheye if hasattr(cv2.fisheye, "CALIB_FIX_SKEW") else cv2  # OpenCV 5
    flags = of.CALIB_USE_INTRINSIC_GUESS | of.CALIB_FIX_SKEW | of.CALIB_FIX_K3 | of.CALIB_FIX_K4
    found = cv2.fisheye.stereoCalibrate(objects, *seen, k[0], d[0], k[1], d[1], SIZE, flags=flags)
    assert found[1][0, 0] == pytest.approx(fitted.bundle.numbers[0], rel=2e-3)
    baseline = RigNumbers(fitted.bundle.numbers, SIZE, EQUIDISTANT).baseline_m
    assert np.linalg.norm(found[6]) == pytest.approx(baseline, rel=2e-3)


def test_what_is_written_is_read_as_a_fisheye(tmp_path: Path) -> None:
    result = calibrate_seen((fisheye_pairs(8), [], SIZE), BOARD, medium="air", lens=EQUIDISTANT)
    write_result(result, tmp_path / "out")
    report = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert report["distortion_model"] == EQUIDISTANT
    assert len(report["parameters"]) == len(report["sigmas"]) == len(report["covariance"]) == 22
    assert "equidistant" in (tmp_path / "out" / "left.yaml").read_text()
    write_calibration(result.calibration, tmp_path / "camchain.yaml", form="kalibr")
    for path in (
        tmp_path / "out" / "calibration.json",
        tmp_path / "out" / "calibration.yaml",
        tmp_path / "camchain.yaml",
    ):
        found = read_calibration(path)
        assert found.left.distortion_model == EQUIDISTANT
        assert found.left.d == pytest.approx(result.calibration.left.d, abs=1e-9)
        assert found.right.p == pytest.approx(result.calibration.right.p, abs=1e-6)
    with pytest.raises(CalibrationError, match="plumb_bob"):
        air_rig(tmp_path / "out" / "calibration.json")
