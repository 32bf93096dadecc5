import re

import numpy as np
import pytest
from helpers.rig_scenes import intrinsics, make_rig, scatter, tie_points, tie_points_of
from scipy.spatial.transform import Rotation

from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, TiePoints
from uw_recon_ros.rectify.quality import (
    flatness_warnings,
    forward_motion,
    homography_distortion,
    homography_share,
    refusals,
    row_limit_px,
)
from uw_recon_ros.rectify.rectification import row_statistics
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera


def test_a_similarity_does_not_distort():
    angle = np.radians(20)
    c, s = 0.7 * np.cos(angle), 0.7 * np.sin(angle)
    found = homography_distortion(np.array([[c, -s, 10], [s, c, -5], [0, 0, 1]]), 640, 480)
    assert found.aspect == pytest.approx(1)
    assert found.diagonals == pytest.approx(1)
    assert found.angle_deg == pytest.approx(90)


def test_stretch_and_shear_are_measured():
    stretched = homography_distortion(np.diag([1.3, 1.0, 1.0]), 640, 480)
    assert stretched.aspect == pytest.approx(1.3)
    sheared = homography_distortion(np.array([[1, 0.5, 0], [0, 1, 0], [0, 0, 1.0]]), 640, 480)
    assert sheared.angle_deg == pytest.approx(np.degrees(np.arctan2(1, 0.5)))
    assert abs(sheared.diagonals - 1) > 0.2


def test_an_image_torn_apart_is_nan():
    torn = homography_distortion(np.array([[1, 0, 0], [0, 1, 0], [-1 / 300, 0, 1.0]]), 640, 480)
    assert np.isnan(torn.aspect)


def test_flat_scenes_are_told_from_deep_ones():
    rig = make_rig(angles_deg=(1.0, -1.0, 1.0))
    flat, deep = (tie_points_of(rig, scatter(rig, 300, near, far), 0.3) for near, far in ((1.5, 1.501), (1.0, 3.0)))
    assert homography_share(flat, 2.0) > 0.98
    assert homography_share(deep, 2.0) < 0.5
    warning = flatness_warnings(flat, RectifyParams())
    assert len(warning) == 1
    assert "flat scene" in warning[0].text
    assert f"of {len(flat)} tie points (limit 90%)" in warning[0].text
    assert flatness_warnings(deep, RectifyParams()) == ()


STRAIGHT = RectifiedCamera(intrinsics(640, 480, 620.0), np.eye(3), intrinsics(640, 480, 620.0))


def test_rows_are_held_against_the_size_of_the_image_and_the_noise():
    points = tie_points(make_rig())
    assert refusals((STRAIGHT, STRAIGHT), points, (0.1, 1.9), RectifyParams()) == []
    (reason,) = refusals((STRAIGHT, STRAIGHT), points, (0.9, 2.1), RectifyParams())
    assert reason.code == Code.RECTIFY_ROWS_DISAGREE
    assert f"up to 2.00 px, got 2.10 px (median 0.90 px, {len(points)} tie points)" in reason.text
    assert refusals((STRAIGHT, STRAIGHT), points, (0.9, 2.1), RectifyParams(), noise_px=0.6) == []
    large = TiePoints(4 * points.left, 4 * points.right, 2560, 1920)
    assert row_limit_px(RectifyParams(), large, np.nan) == pytest.approx(8.0)
    assert row_limit_px(RectifyParams(), points, 50.0) == pytest.approx(4.0)  # such noise excuses nothing


def test_forward_motion_is_named_where_every_part_of_the_tie_points_says_so():
    ahead = tie_points(make_rig(center=(0.01, 0.005, 0.4), angles_deg=(0.5, 0.3, 0.2)), 500, noise=0.2)
    (reason,) = forward_motion(ahead)
    assert reason.code == Code.RECTIFY_FORWARD_MOTION
    assert re.search(r"the epipole lies in the \w+ image, at \(\d+, \d+\) of 640x480 px", reason.text)
    assert forward_motion(tie_points(make_rig(), 500)) == []


@pytest.mark.parametrize("seed", range(6))
def test_noise_and_flat_scenes_are_not_called_forward_motion(seed):
    """One fit may put the epipole anywhere; a rig side by side is not accused for it."""
    rig = make_rig(angles_deg=(1.0, -1.0, 1.0))
    assert forward_motion(tie_points_of(rig, scatter(rig, 120, 1.5, 1.55, seed), 1.5, seed)) == []


@pytest.mark.parametrize(("roll_deg", "refused"), [(55, False), (-55, False), (65, True), (-80, True), (90, True)])
def test_a_view_turned_by_more_than_60_degrees_is_refused(roll_deg, refused):
    k = intrinsics(640, 480, 620.0)
    turned = RectifiedCamera(k, Rotation.from_euler("z", roll_deg, degrees=True).as_matrix(), k)
    points = tie_points(make_rig())
    views = turned, RectifiedCamera(k, np.eye(3), k)
    reasons = refusals(views, points, (0.1, 0.3), RectifyParams())
    assert any(f"left image would be turned by {roll_deg} deg" in reason.text for reason in reasons) is refused


def test_row_statistics_count_lost_points_as_infinite():
    errors = np.array([-1.0, 2.0, 0.5, np.nan])
    median, p95 = row_statistics(errors)
    assert median == 2.0
    assert p95 == np.inf
    assert np.isnan(row_statistics(np.zeros(0))).all()


def test_share_of_few_points_is_one():
    assert homography_share(tie_points(make_rig(), 3), 1.0) == 1.0
