"""Rows of a calibrated rig: right rigs pass at any noise, turned ones are marked, then lose their metres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, make_rig, scatter

from uw_recon_ros.findings import Code, Severity
from uw_recon_ros.pipeline import Pipeline, PipelineParams
from uw_recon_ros.rectify import RectifyParams, TiePoints
from uw_recon_ros.rectify.calibrated import rectification_from_calibration, unjudged
from uw_recon_ros.rectify.row_error import RowAgreement
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import StereoPair

RIG = make_rig()
PARAMS = RectifyParams()
CALIBRATED = rectification_from_calibration(calibration_of(RIG), PARAMS)


@pytest.mark.parametrize("noise", [0.0, 0.05, 0.2, 0.5, 1.0])
def test_a_right_rig_is_not_accused_by_noisy_tie_points(noise):
    left, right, _ = RIG.see(scatter(RIG, 600, 1.0, 3.0), noise)
    rows = RowAgreement.measured(CALIBRATED, TiePoints(left, right, RIG.width, RIG.height))
    assert rows.findings(PARAMS) == ()
    assert rows.noise_px == pytest.approx(0.674 * np.sqrt(2) * noise, rel=0.15, abs=0.01)  # median of |left - right|


@pytest.mark.parametrize(("errors_px", "marked", "withheld"), [(0.2, False, False), (0.46, True, False),
                                                               (0.81, True, False), (11.0, True, True),
                                                               (23.0, True, True)])  # fmt: skip
def test_shifted_rows_are_marked_and_then_lose_their_metres(errors_px, marked, withheld):
    left, right, _ = RIG.see(scatter(RIG, 600, 1.0, 3.0), 0.08)
    shifted = TiePoints(left, right + np.array([0.0, errors_px]), RIG.width, RIG.height)
    found = rectification_from_calibration(calibration_of(RIG), PARAMS, shifted)
    said = {w.code for w in found.quality.warnings if w.severity == Severity.UNRELIABLE}
    assert bool(said) == marked
    assert (Code.RECTIFY_SCALE_WITHHELD in said) == withheld == (not found.geometry.metric)


@pytest.mark.parametrize("count", [80, 600])
def test_one_cameras_lost_distortion_is_no_noise_of_tie_points(count):
    """A lens bends rows as no plane does, but smoothly."""
    rig = make_rig(angles_deg=(1.0, -2.0, 1.5), d=np.array([-0.25, 0.08, 0.0, 0.0, 0.0]))
    left, right, _ = rig.see(scatter(rig, count, 1.0, 3.0), 0.3)
    whole, points = calibration_of(rig), TiePoints(left, right, rig.width, rig.height)
    lost = replace(whole, right=replace(whole.right, d=np.zeros(5)))
    for calibration, metric in ((whole, True), (lost, False)):
        assert rectification_from_calibration(calibration, PARAMS, points).geometry.metric == metric


def test_the_limit_grows_with_the_image():
    rows = RowAgreement(0.5, 1.0, 0.05, 500, 800.0)
    assert rows.unreliable(PARAMS)
    assert not replace(rows, diagonal_px=1600.0).unreliable(PARAMS)


def test_what_could_not_be_checked_is_said():
    found = unjudged(CALIBRATED, "too little texture: 3 features")
    (finding,) = found.quality.warnings
    assert (finding.code, finding.severity) == (Code.RECTIFY_NOT_CHECKED, Severity.WARN)
    assert "3 features" in finding.text
    assert found.geometry.metric


def test_a_tiny_image_is_not_held_to_what_tie_points_cannot_measure() -> None:
    """0.1 px in 96x72 px is over a permille of the diagonal, and within what features are placed to."""
    small = RowAgreement(median_px=0.1, p95_px=0.3, noise_px=0.0, points=25, diagonal_px=120.0)
    assert not small.unreliable(RectifyParams())
    assert replace(small, median_px=0.3).unreliable(RectifyParams())


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_images_that_share_nothing_give_no_metres(seed: int) -> None:
    """Two images of independent noise under a calibration that is fine: whatever is matched there is chance."""
    random = np.random.default_rng(seed)
    left, right = (random.integers(0, 256, (360, 480, 3), np.uint8) for _ in range(2))
    calibration = Dive(SimulateParams(width=480, height=360)).calibration
    rectified = Pipeline(PipelineParams())(StereoPair(left, right, calibration=calibration)).rectified
    assert not rectified.geometry.metric
    codes = {finding.code for finding in rectified.quality.warnings}
    assert {Code.RECTIFY_NOT_CHECKED, Code.RECTIFY_SCALE_WITHHELD} <= codes


def test_a_scene_without_texture_keeps_its_metres_unchecked() -> None:
    """Few features are no proof of two scenes."""
    smooth = np.tile(np.linspace(80, 120, 480).astype(np.uint8)[None, :, None], (360, 1, 3))
    calibration = Dive(SimulateParams(width=480, height=360)).calibration
    noisy = np.clip(smooth + np.random.default_rng(0).normal(0, 0.5, smooth.shape), 0, 255).astype(np.uint8)
    rectified = Pipeline(PipelineParams())(StereoPair(smooth, noisy, calibration=calibration)).rectified
    assert rectified.geometry.metric
    assert {finding.code for finding in rectified.quality.warnings} == {Code.RECTIFY_NOT_CHECKED}
