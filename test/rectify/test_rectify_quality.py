import numpy as np
import pytest
from rig_scenes import make_rig, scatter, tie_points, tie_points_of

from uw_recon_ros.rectify import RectifyParams
from uw_recon_ros.rectify.quality import flatness_warnings, homography_distortion, homography_share
from uw_recon_ros.rectify.rectification import row_statistics


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
    assert "flat scene" in warning[0]
    assert f"of {len(flat)} tie points (limit 90%)" in warning[0]
    assert flatness_warnings(deep, RectifyParams()) == ()


def test_row_statistics_count_lost_points_as_infinite():
    errors = np.array([-1.0, 2.0, 0.5, np.nan])
    median, p95 = row_statistics(errors)
    assert median == 2.0
    assert p95 == np.inf
    assert np.isnan(row_statistics(np.zeros(0))).all()


def test_share_of_few_points_is_one():
    assert homography_share(tie_points(make_rig(), 3), 1.0) == 1.0
