"""What is stated of an uncalibrated shape covers what is wrong with it."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import make_rig, scatter, tie_points_of

from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, estimate_rectification
from uw_recon_ros.rectify.quasi_euclidean import fit_quasi_euclidean
from uw_recon_ros.rectify.shape import projective, shape_sigma

RIG = make_rig(angles_deg=(1.0, -2.0, 1.0))


def bent(rig, found):
    """How far the scale of the farthest and of the nearest points differ, percent."""
    points = scatter(rig, 400, 1.0, 3.0, seed=7)
    depth = (rig.see(points, 0.0, 7)[2] @ rig.left.rotation.T + rig.left.translation)[:, 2]
    ratio = np.log(1 / np.maximum(found.parallax(tie_points_of(rig, points)), 1e-3) / depth)
    order = np.argsort(depth)
    return 100 * abs(np.median(ratio[order[-20:]]) - np.median(ratio[order[:20]]))


@pytest.mark.parametrize("k1", [0.0, -0.05, -0.25, 0.6])
def test_the_error_of_a_shape_lies_within_twice_what_is_stated(k1):
    lens = np.array([k1, 0, 0, 0, 0.0])
    rig = replace(RIG, left=replace(RIG.left, d=lens), right=replace(RIG.right, d=lens))
    points = tie_points_of(rig, scatter(rig, 300, 1.0, 3.0), 0.3)
    found = estimate_rectification(points, RectifyParams(rig_axis="horizontal"))
    assert bent(rig, found) < 2 * found.quality.shape_sigma_percent


def test_only_an_unknown_focal_length_is_uncertain():
    points = tie_points_of(RIG, scatter(RIG, 300, 1.0, 3.0), 0.3)
    free, known = (
        fit_quasi_euclidean(points.left, points.right, 640, 480, focal_px=focal).focal_sigma
        for focal in (None, float(RIG.left.k[0, 0]))
    )
    assert known == 0
    assert 0 < free < 0.35


def test_a_shift_of_infinity_bends_by_its_share_of_the_disparities():
    parallax = np.array([20.0] * 50 + [40.0] * 50)
    assert shape_sigma(parallax, 2.0, 0.0) == pytest.approx(5.0)
    assert shape_sigma(parallax, 2.0, 0.12) == pytest.approx(13.0)
    assert shape_sigma(np.full(50, 30.0), 2.0, 0.0) == pytest.approx(0.0)


def test_over_the_limit_it_is_called_projective_with_advice():
    assert projective(39.0, RectifyParams()) == ()
    (finding,) = projective(64.0, RectifyParams())
    assert finding.code == Code.RECTIFY_PROJECTIVE
    assert "64 %" in str(finding)
    assert "focal_px" in finding.advice
