"""A frame torn between two moments shows a jump of the row error; a rig out of adjustment shows none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, enhanced, make_rig, render

from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, RigTracker
from uw_recon_ros.rectify.seam import find_seam
from uw_recon_ros.rectify.tie_points import TiePoints

WIDTH, HEIGHT = 640, 480


def points(count: int = 400, seed: int = 0) -> TiePoints:
    left = np.random.default_rng(seed).uniform((0, 0), (WIDTH, HEIGHT), (count, 2))
    return TiePoints(left, left - (20, 0), WIDTH, HEIGHT)


def noise(count: int, sigma: float, seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, sigma, count)


@pytest.mark.parametrize("jump", [-6.0, 1.5, 4.0])
@pytest.mark.parametrize("row", [80, 240, 400])
def test_the_row_is_found(row: int, jump: float) -> None:
    found = points()
    errors = noise(400, 0.2) + np.where(found.left[:, 1] >= row, jump, 0.0)
    seam = find_seam(found, errors)
    assert seam is not None
    assert seam.row == pytest.approx(row, abs=15)
    assert (seam.above_px, seam.below_px) == pytest.approx((0.0, jump), abs=0.1)
    assert seam.lower
    assert seam.share == pytest.approx(1 - row / HEIGHT, abs=0.03)
    upper = find_seam(found, errors - jump)
    assert upper is not None
    assert not upper.lower
    assert upper.share == pytest.approx(row / HEIGHT, abs=0.03)


@pytest.mark.parametrize("seed", range(20))
def test_no_seam_in_what_a_rig_out_of_adjustment_shows(seed: int) -> None:
    """Noise, an offset, a roll, a scale, a wrong distortion, strays."""
    found = points(seed=seed)
    u, v = (found.left - (WIDTH / 2, HEIGHT / 2)).T / (WIDTH / 2)
    random = np.random.default_rng(seed)
    a, b, c, d = random.normal(0, 3, 4)
    errors = noise(400, 0.3, seed) + a + b * u + c * v + d * v * (u * u + v * v)
    strays = random.random(400) < 0.05
    errors[strays] += random.normal(0, 10, strays.sum())
    assert find_seam(found, errors) is None


def test_too_few_tell_nothing() -> None:
    found = points(40)
    assert find_seam(found, np.where(found.left[:, 1] > 240, 5.0, 0.0)) is None
    assert find_seam(points(400), np.full(400, np.nan)) is None


def test_a_torn_image_is_named_as_that_by_the_rigs_tracker() -> None:
    """The lower part moved by the motion between two frames."""
    rig = make_rig(angles_deg=(1.0, -1.5, 2.0))
    left, right = render(rig)
    moved = right.copy()
    moved[300:] = np.roll(right, (7, 4), (0, 1))[300:]
    pair = replace(enhanced(left, right), calibration=calibration_of(rig))
    good = RigTracker(RectifyParams()).update(pair)
    assert Code.REGION_TORN not in {f.code for f in good.quality.warnings}
    seen = RigTracker(RectifyParams()).update(replace(enhanced(left, moved), calibration=pair.calibration))
    [finding] = [f for f in seen.quality.warnings if f.code == Code.REGION_TORN]
    row = int(finding.text.split("torn at row ")[1].split(":")[0])
    assert row == pytest.approx(300, abs=30)
