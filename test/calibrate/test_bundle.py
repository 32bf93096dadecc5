"""Bundle adjustment on points of known truth."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, LARGE, depth_misses, rig_of, sightings, truth_of

from uw_recon_ros.calibrate.bundle import SeenPair, rms_px
from uw_recon_ros.calibrate.depth_error import depth_errors_by_range, depth_sigmas, held_out, length_errors
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.fit import ordered_alike, solve
from uw_recon_ros.calibrate.optics import SIDES, intrinsic_matrix, project_left, project_right
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code

SIZE = (1280, 960)


def test_slopes_are_those_of_the_projection() -> None:
    numbers, pose = truth_of(rig_of(3, **LARGE)), np.array([0.2, -0.3, 0.1, -0.1, 0.05, 1.1])
    for project in (project_left, project_right):
        _, by_numbers, by_pose = project(numbers, pose, BOARD.points())
        for k in range(len(numbers)):
            step = 1e-6 * np.eye(len(numbers))[k]
            there, back = (project(numbers + sign * step, pose, BOARD.points())[0].ravel() for sign in (1, -1))
            assert by_numbers[:, k] == pytest.approx((there - back) / 2e-6, abs=2e-3, rel=1e-4)
        for k in range(6):
            step = 1e-6 * np.eye(6)[k]
            there, back = (project(numbers, pose + sign * step, BOARD.points())[0].ravel() for sign in (1, -1))
            assert by_pose[:, k] == pytest.approx((there - back) / 2e-6, abs=2e-3, rel=1e-4)


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_exact_points_give_back_the_rig(axis: str) -> None:
    rig = rig_of(2, axis=axis, **LARGE)
    fit = solve(sightings(rig, 10, 2, noise_px=0.0), BOARD, SIZE)
    assert fit.bundle.rms_px < 1e-5
    assert fit.bundle.numbers == pytest.approx(truth_of(rig), abs=1e-3)
    found = RigNumbers(fit.bundle.numbers, SIZE)
    assert found.axis == axis
    assert np.abs(depth_misses(found, rig, 3.0)).max() < 1e-6
    judged = judge_calibration(found.calibration, SIZE)
    assert judged.findings == ()
    assert judged.baseline_m == pytest.approx(np.linalg.norm(rig.right_center), abs=1e-7)


def test_thirty_tilted_pairs_know_depth_to_four_permille() -> None:
    for seed in (1, 2):
        rig = rig_of(seed, **LARGE)
        fit = solve(sightings(rig, 30, seed), BOARD, SIZE)
        found = RigNumbers(fit.bundle.numbers, SIZE)
        assert fit.bundle.noise_px == pytest.approx(0.3, rel=0.05)
        assert not fit.left_out
        assert np.sqrt(np.mean(depth_misses(found, rig, 3.0) ** 2)) <= 4e-3
        told = depth_errors_by_range(found, fit.bundle.covariance)
        assert all(e.middle_percent <= e.worst_percent for e in told)
        assert told[3].mean_percent < 0.4


def test_few_flat_pairs_are_told_to_know_less() -> None:
    rig = rig_of(1, **LARGE)
    flat, tilted = (solve(sightings(rig, 8, 1, tilt_rad=tilt), BOARD, SIZE) for tilt in (0.02, 0.4))
    worst = [
        depth_errors_by_range(RigNumbers(f.bundle.numbers, SIZE), f.bundle.covariance)[3].worst_percent
        for f in (flat, tilted)
    ]
    assert flat.bundle.rms_px == pytest.approx(tilted.bundle.rms_px, rel=0.1)  # which rms does not tell
    assert worst[0] > 3 * worst[1]


def test_the_stated_sigma_is_the_spread_of_repeated_sessions() -> None:
    """The same poses under new noise: the spread of depth at 2 m is the one that a single session states."""
    rig = rig_of(4, **LARGE)
    misses, stated = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        pairs = [_noisy(pair, rng) for pair in sightings(rig, 8, 4, noise_px=0.0)]
        fit = solve(pairs, BOARD, SIZE)
        found = RigNumbers(fit.bundle.numbers, SIZE)
        misses.append(depth_misses(found, rig, 2.0).mean())
        stated.append(np.sqrt(np.mean(depth_sigmas(found, fit.bundle.covariance, 2.0)[1] ** 2)))
    normalised = np.array(misses) / np.array(stated)
    assert 0.4 < np.sqrt(np.mean(normalised**2)) < 1.6


def _moved(sighting: Sighting, noise_px: float, rng: np.random.Generator) -> Sighting:
    return replace(sighting, pixels=sighting.pixels + noise_px * rng.standard_normal(sighting.pixels.shape))


def _noisy(pair: SeenPair, rng: np.random.Generator) -> SeenPair:
    return SeenPair(pair.name, _moved(pair.left, 0.3, rng), _moved(pair.right, 0.3, rng))


def test_opencv_agrees() -> None:
    """An independent solver, from our solution as its guess, stays there."""
    rig = rig_of(5, **LARGE)
    pairs = sightings(rig, 12, 5)
    fit = solve(pairs, BOARD, SIZE)
    k = [intrinsic_matrix(fit.bundle.numbers[side]) for side in SIDES]
    d = [fit.bundle.numbers[side][4:].copy() for side in SIDES]
    objects = [BOARD.points().astype(np.float32)] * len(pairs)
    seen = [[getattr(p, s).pixels.astype(np.float32) for p in pairs] for s in ("left", "right")]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    rms, k1, *_, move, _, _ = cv2.stereoCalibrate(
        objects, *seen, k[0], d[0], k[1], d[1], SIZE, flags=flags, criteria=(3, 100, 1e-9)
    )
    assert rms == pytest.approx(fit.bundle.rms_px, rel=2e-3)
    assert k1[0, 0] == pytest.approx(fit.bundle.numbers[0], rel=3e-4)
    baseline = np.linalg.norm(move)
    assert baseline == pytest.approx(RigNumbers(fit.bundle.numbers, SIZE).baseline_m, rel=3e-4)


def test_pairs_that_do_not_belong_are_named() -> None:
    rig = rig_of(6, **LARGE)
    pairs = sightings(rig, 14, 6)
    shifted = SeenPair("late", pairs[3].left, pairs[4].right)
    rng = np.random.default_rng(1)
    bad = SeenPair("bent", *(_moved(side, 6.0, rng) for side in (pairs[5].left, pairs[5].right)))
    fit = solve([*pairs[:3], shifted, bad, *pairs[6:]], BOARD, SIZE)
    assert {out.name: out.code for out in fit.left_out} == {
        "late": Code.CALIBRATE_UNSYNCHRONISED, "bent": Code.CALIBRATE_OUTLIER,
    }  # fmt: skip
    assert fit.bundle.noise_px == pytest.approx(0.3, rel=0.1)


def test_held_out_pairs_and_lengths() -> None:
    rig = rig_of(7, **LARGE)
    fit = solve(sightings(rig, 20, 7), BOARD, SIZE)
    held = held_out(fit.bundle, fit.pairs, BOARD.points(), RigNumbers(fit.bundle.numbers, SIZE))
    assert held is not None
    assert fit.bundle.rms_px < held.rms_px < 1.2 * fit.bundle.rms_px
    assert abs(held.length_bias_percent) < 0.1
    true = RigNumbers(1.01 * truth_of(rig), SIZE)  # any rig that is wrong shows in lengths
    assert np.median(np.abs(length_errors(true, fit.pairs[0], BOARD.points()))) > 0.005


def test_a_board_counted_from_the_other_end_is_turned() -> None:
    pair = sightings(rig_of(1, **LARGE), 1, 1)[0]
    turned = SeenPair("x", pair.left, type(pair.right)(pair.right.numbers, pair.right.pixels[::-1], 1.5, 40.0))
    assert np.array_equal(ordered_alike(turned, BOARD).right.pixels, pair.right.pixels)


def test_too_few_pairs_are_refused() -> None:
    with pytest.raises(CalibrationError, match="at least 4") as caught:
        solve(sightings(rig_of(1, **LARGE), 3, 1), BOARD, SIZE)
    assert caught.value.code == Code.CALIBRATE_TOO_FEW


def test_rms_of_nothing_is_nothing() -> None:
    assert np.isnan(rms_px([(np.empty((0, 2)), np.empty((0, 2)))]))
