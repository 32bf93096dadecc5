"""A rig calibrated in air looks through flat ports into water: told from its rows, by exact refraction."""

import re
from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, make_rig, scatter, through_flat_ports, tie_points, tie_points_of

from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, rectification_from_calibration

WATER = 1.333
RIG = make_rig(angles_deg=(3.0, -4.0, 2.0), center=(0.15, 0.005, 0.0))


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


def test_metres_are_withheld_until_the_medium_is_said(in_water):
    unknown, told_, air = (
        rectification_from_calibration(calibration_of(RIG), RectifyParams(medium=medium), in_water)
        for medium in ("unknown", "as_used", "air")
    )
    assert [r.geometry.metric for r in (unknown, told_, air)] == [False, True, False]
    assert {w.code for w in told(unknown)} >= {Code.RECTIFY_CALIBRATED_IN_AIR, Code.RECTIFY_SCALE_WITHHELD}
    assert Code.RECTIFY_CALIBRATED_IN_AIR in {w.code for w in told(told_)}
    assert Code.CALIBRATION_MADE_IN_AIR in {w.code for w in told(air)}


def test_air_said_withholds_metres_without_any_tie_points():
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(medium="air"))
    assert not found.geometry.metric
    assert Code.CALIBRATION_MADE_IN_AIR in {w.code for w in found.quality.warnings}


def test_a_common_shift_of_the_rows_hides_no_water(in_water):
    """Ports and mounting move all rows by some pixels: 2.8 in a real tank."""
    shifted = replace(in_water, right=in_water.right + np.array([0.0, 2.8]))
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(), shifted)
    assert found.quality.medium == "water"
    assert not found.geometry.metric


def test_the_rows_say_that_a_rig_works_as_calibrated():
    found = rectification_from_calibration(calibration_of(RIG), RectifyParams(), tie_points(RIG, 600))
    assert found.quality.medium == "as calibrated"
    assert found.geometry.metric


def test_parallel_cameras_that_look_far_cannot_tell():
    """Nothing in their rows depends on the medium: neither answer would be honest."""
    rig = make_rig(angles_deg=(0.0, 0.0, 0.0), center=(0.15, 0.0, 0.0))
    far = scatter(rig, 600, 8.0, 20.0) * [0.7, 0.7, 1.0]
    for found in (through_flat_ports(rig, far), tie_points_of(rig, far, 0.2)):
        quality = rectification_from_calibration(calibration_of(rig), RectifyParams(), found).quality
        assert quality.medium == "cannot tell"
