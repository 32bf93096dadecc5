"""A camera knocked since its calibration: told from the rows; a lens that was zoomed is not taken for it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, make_rig, tie_points
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, rectification_from_calibration
from uw_recon_ros.rectify.camera_turn import camera_turn

ANGLES = (1.0, -2.0, 1.5)
SMALL = st.floats(-0.8, 0.8)


def rigs(knock, vertical=False, **lens):
    """As it was when calibrated, and as it is now."""
    center = (0.005, 0.15, 0.0) if vertical else (0.15, 0.005, 0.0)
    was = make_rig(angles_deg=ANGLES, center=center, **lens)
    rotation = Rotation.from_rotvec(knock, degrees=True).as_matrix() @ was.right.rotation
    moved = replace(was.right, rotation=rotation, translation=-rotation @ np.array(center))
    return was, replace(was, right=moved)


@given(st.tuples(SMALL, SMALL, SMALL), st.booleans())
@settings(max_examples=25, deadline=None)
def test_pitch_and_roll_are_those_of_the_camera(knock, vertical):
    was, now = rigs(knock, vertical)
    rectification = rectification_from_calibration(calibration_of(was), RectifyParams())
    found = camera_turn(rectification, tie_points(now, 400, noise=0.1))
    of_camera = rectification.right.r @ (-np.array(knock))  # the scene turns the other way
    assert [found.pitch_deg, found.roll_deg] == pytest.approx([of_camera[int(vertical)], of_camera[2]], abs=0.04)
    assert found.after_px < 0.2


def told(calibration, points):
    found = rectification_from_calibration(calibration, RectifyParams(), points)
    return next((f for f in found.quality.warnings if f.code == Code.RECTIFY_ROWS_DISAGREE), None)


def test_a_knock_is_named_with_what_it_leaves():
    was, now = rigs((0.3, 0.0, -0.2))
    finding = told(calibration_of(was), tie_points(now, 400))
    assert "turned by 0.30 degrees about the baseline and 0." in finding.text
    assert "knocked" in finding.advice


def test_a_lens_that_was_zoomed_is_no_knock():
    was, _ = rigs((0.0, 0.0, 0.0))
    whole = calibration_of(was)
    zoomed = replace(whole, right=replace(whole.right, k=np.diag([1.1, 1.1, 1.0]) @ whole.right.k))
    assert "turned" not in told(zoomed, tie_points(was, 400)).text


def test_few_points_accuse_nobody():
    was, now = rigs((0.3, 0.0, -0.2))
    rectification = rectification_from_calibration(calibration_of(was), RectifyParams())
    assert camera_turn(rectification, tie_points(now, 400).take(np.arange(30))) is None
