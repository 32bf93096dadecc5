"""Lens distortion of a rig without a calibration: found where tie points tell it, and claimed nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import make_rig, random_rig, rotated, scatter, tie_points_of

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, estimate_rectification
from uw_recon_ros.rectify.lens import Lens
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.rectify.tie_points import TiePoints


def with_lens(rig, k1):
    lens = np.array([k1, 0, 0, 0, 0.0])
    return replace(rig, left=replace(rig.left, d=lens), right=replace(rig.right, d=lens))


def off_centre(rig, share, seed):
    """The principal points by `share` of the width beside the middle, the focal lengths by half of it unequal."""
    rng = np.random.default_rng(seed)

    def moved(camera):
        k = camera.k.copy()
        k[:2, 2] += rng.normal(0, share * rig.width, 2)
        k[[0, 1], [0, 1]] *= 1 + rng.normal(0, share / 2)
        return replace(camera, k=k)

    return replace(rig, left=moved(rig.left), right=moved(rig.right))


def estimated(rig, points, *, seed=0, turns=0, axis="horizontal"):
    seen = rotated(tie_points_of(rig, points, 0.3, seed), turns)
    return estimate_rectification(seen, RectifyParams(rig_axis=axis))


@pytest.mark.parametrize("k1", [-0.3, -0.12, 0.3, 0.7])
def test_the_lens_is_found_and_the_focal_length_with_it(k1):
    rig = with_lens(make_rig(angles_deg=(1.0, -2.0, 1.0)), k1)
    found = estimated(rig, scatter(rig, 400, 1.0, 3.0))
    focal = found.geometry.focal_px
    assert focal == pytest.approx(620, rel=0.1)
    assert found.quality.lens_k1 * (620 / focal) ** 2 == pytest.approx(k1, rel=0.12, abs=0.03)
    exact = tie_points_of(rig, scatter(rig, 400, 1.0, 3.0, seed=1))
    assert np.nanmedian(np.abs(found.row_errors(exact))) < 0.2


@pytest.mark.parametrize("seed", range(4))
def test_a_lens_without_distortion_stays_one(seed):
    rig = random_rig(seed)
    assert estimated(rig, scatter(rig, 300, 1.0, 3.0, seed), seed=seed).quality.lens_k1 == 0


def test_of_a_flat_scene_nothing_is_said():
    rig = with_lens(make_rig(angles_deg=(1.0, -2.0, 1.0)), -0.03)
    points = scatter(rig, 300, 1.99, 2.0)
    assert estimated(rig, points).quality.lens_k1 == 0


def test_a_vertical_rig_has_the_same_lens():
    rig = with_lens(make_rig(angles_deg=(1.0, -2.0, 1.0)), -0.2)
    found = estimated(rig, scatter(rig, 400, 1.0, 3.0), turns=1, axis="vertical")
    assert found.geometry.axis == "vertical"
    assert found.quality.lens_k1 * (620 / found.geometry.focal_px) ** 2 == pytest.approx(-0.2, abs=0.05)


def test_straightened_points_are_those_of_a_camera_with_that_distortion():
    pixels = np.random.default_rng(0).uniform((0, 0), (639, 479), (50, 2))
    lens = Lens(-0.06, 0.0)
    straight = lens.straightened(TiePoints(pixels, pixels, 640, 480))
    k = np.array([[500.0, 0, 319.5], [0, 500, 239.5], [0, 0, 1]])
    camera = RectifiedCamera(k, np.eye(3), k, lens.distortion(500.0, 640, 480))
    np.testing.assert_allclose(camera.rectified(pixels), straight.left, atol=1e-6)


@pytest.mark.parametrize("seed", [3, 6, 11])
def test_principal_points_beside_the_middle_are_not_taken_for_a_lens(seed):
    rig = off_centre(random_rig(seed), 0.01, seed)
    found = estimated(rig, scatter(rig, 400, 1.0, 3.0, seed), seed=seed)
    assert found.quality.lens_k1 == 0


def test_a_port_in_water_is_not_mistaken_for_a_barrel():
    lens = np.array([0.71, -0.71, 0, 0, 0.0])  # a small bend the other way is a valley of the cost, too
    rig = make_rig(focal=662, angles_deg=(1.0, -2.0, 1.0))
    rig = replace(rig, left=replace(rig.left, d=lens), right=replace(rig.right, d=lens))
    assert estimated(rig, scatter(rig, 400, 1.0, 3.0)).quality.lens_k1 > 0.4


def test_exchanged_cameras_are_told_through_a_strong_lens():
    rig = with_lens(make_rig(angles_deg=(1.0, -2.0, 1.0)), 0.7)
    seen = tie_points_of(rig, scatter(rig, 400, 1.0, 3.0), 0.3)
    with pytest.raises(EstimationError) as refused:
        estimate_rectification(replace(seen, left=seen.right, right=seen.left), RectifyParams())
    assert refused.value.code == Code.RECTIFY_EXCHANGED
