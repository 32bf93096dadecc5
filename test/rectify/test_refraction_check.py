"""A rig calibrated in air looks through flat ports into water: told from its rows, by exact refraction."""

import re

import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, make_rig, scatter, tie_points

from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, TiePoints, rectification_from_calibration

WATER = 1.333
RIG = make_rig(angles_deg=(3.0, -4.0, 2.0), center=(0.15, 0.005, 0.0))


def through_flat_ports(rig, points, noise=0.2):
    """Snell's law at a thin port in front of each pinhole: ``sin(air) = 1.333 sin(water)``."""
    pixels = []
    rng = np.random.default_rng(0)
    for camera in (rig.left, rig.right):
        x, y, z = (points @ camera.rotation.T + camera.translation).T
        radius = np.hypot(x, y)
        air = np.arcsin(WATER * np.sin(np.arctan2(radius, z)))
        scale = np.tan(air) / radius
        pixels.append(np.column_stack([x * scale, y * scale]) * rig.left.k[0, 0] + camera.k[:2, 2])
        pixels[-1] += rng.normal(0, noise, pixels[-1].shape)
    inside = np.all([(p >= 0).all(axis=1) & (p <= [rig.width, rig.height]).all(axis=1) for p in pixels], axis=0)
    return TiePoints(pixels[0][inside], pixels[1][inside], rig.width, rig.height)


@pytest.fixture(scope="module")
def in_water():
    return through_flat_ports(RIG, scatter(RIG, 600, 1.0, 3.0) * [0.7, 0.7, 1.0])


def told(found):
    """Findings; that the rig of these tests has no distortion is told as well, and not meant here."""
    return [w for w in found.quality.warnings if w.code != Code.CALIBRATION_DISTORTION_LOST]


def test_it_is_recognised_with_its_numbers(in_water):
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(), in_water)
    assert found.quality.row_error_median_px > 1.5
    warning = told(found)[0]
    assert warning.code == Code.RECTIFY_CALIBRATED_IN_AIR
    assert warning.text.startswith("calibrated in air, used in water?")
    assert float(re.search(r"focal length (\d\.\d+) times", warning.text)[1]) == pytest.approx(WATER, abs=0.02)
    assert "about 25% short" in warning.text


def test_the_same_rig_in_air_is_not():
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(), tie_points(RIG, 600))
    assert told(found) == []


@pytest.mark.parametrize("angles", [(3.6, -4.0, 2.0), (3.0, -4.0, 3.0), (2.5, -4.0, 2.0)])
def test_a_rig_that_moved_is_not_taken_for_it(angles):
    moved = make_rig(angles_deg=angles, center=(0.15, 0.005, 0.0))
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(), tie_points(moved, 600))
    assert [w.code for w in told(found)] == [Code.RECTIFY_ROWS_DISAGREE, Code.RECTIFY_SCALE_WITHHELD]


def test_few_tie_points_accuse_nobody(in_water):
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(), in_water.take(np.arange(20)))
    assert not any("water" in w.text for w in found.quality.warnings)
