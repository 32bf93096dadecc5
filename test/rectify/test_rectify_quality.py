import numpy as np
import pytest
from helpers.rig_scenes import intrinsics, make_rig, scatter, tie_points, tie_points_of
from scipy.spatial.transform import Rotation

from uw_recon_ros.rectify import RectifyParams
from uw_recon_ros.rectify.quality import flatness_warnings, homography_distortion, homography_share, refusals
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


def test_an_epipole_in_the_image_is_refused_however_well_the_rows_agree():
    points = tie_points(make_rig())
    k = intrinsics(640, 480, 620.0)
    views = (RectifiedCamera(k, np.eye(3), k), RectifiedCamera(k, np.eye(3), k))
    towards = np.array([[0, -1.0, 240.0], [1.0, 0, -300.0], [-240.0, 300.0, 0]])  # both epipoles at (300, 240)
    (reason,) = refusals(views, towards, points, (0.1, 0.3), RectifyParams())
    assert "forward motion: the epipole lies in the left image, at (300, 240) of 640x480 px" in reason
    sideways = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    assert refusals(views, sideways, points, (0.1, 0.3), RectifyParams()) == []
    (reason,) = refusals(views, sideways, points, (0.9, 2.1), RectifyParams())
    assert f"up to 2 px, got 2.10 px (median 0.90 px, {len(points)} tie points)" in reason


@pytest.mark.parametrize(("roll_deg", "refused"), [(55, False), (-55, False), (65, True), (-80, True), (90, True)])
def test_a_view_turned_by_more_than_60_degrees_is_refused(roll_deg, refused):
    k = intrinsics(640, 480, 620.0)
    turned = RectifiedCamera(k, Rotation.from_euler("z", roll_deg, degrees=True).as_matrix(), k)
    sideways = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    points = tie_points(make_rig())
    views = turned, RectifiedCamera(k, np.eye(3), k)
    reasons = refusals(views, sideways, points, (0.1, 0.3), RectifyParams())
    assert any(f"left image would be turned by {roll_deg} deg" in reason for reason in reasons) is refused


def test_row_statistics_count_lost_points_as_infinite():
    errors = np.array([-1.0, 2.0, 0.5, np.nan])
    median, p95 = row_statistics(errors)
    assert median == 2.0
    assert p95 == np.inf
    assert np.isnan(row_statistics(np.zeros(0))).all()


def test_share_of_few_points_is_one():
    assert homography_share(tie_points(make_rig(), 3), 1.0) == 1.0
