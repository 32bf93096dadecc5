"""From tie points of known truth to a rectification, and every refusal."""

import re

import numpy as np
import pytest
from helpers.rig_scenes import make_rig, random_rig, rotated, scatter, tie_points, tie_points_of
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.rectify import RectifyParams, TiePoints, estimate_rectification
from uw_recon_ros.rectify.quality import homography_distortion

RIG = make_rig(angles_deg=(1.5, -2.0, 1.0), center=(0.15, 0.01, -0.01))
PARAMS = RectifyParams()


def rms(values):
    return float(np.sqrt(np.mean(np.square(values))))


def estimate(points, **values):
    return estimate_rectification(points, RectifyParams(**values))


def test_rows_agree_on_points_never_seen():
    found = estimate(tie_points(RIG))
    fresh = tie_points_of(RIG, scatter(RIG, 400, 1.0, 3.0, seed=99))
    assert rms(found.row_errors(fresh)) < 0.25
    assert found.quality.method == "quasi-euclidean"
    assert found.quality.row_error_median_px < 0.6
    assert found.quality.warnings == ()


def test_nearer_points_have_more_disparity_and_depth_is_right_up_to_scale():
    """With little noise the plane at infinity is found, and depth in baselines is the truth's."""
    found = estimate(tie_points(RIG, noise=0.02))
    left, right, points = RIG.see(scatter(RIG, 200, 1.0, 3.0, seed=5))
    parallax = found.parallax(TiePoints(left, right, RIG.width, RIG.height))
    rotation = np.array(found.geometry.rect_from_raw_left)
    depth = (points @ rotation.T)[:, 2]
    estimated = found.geometry.focal_times_baseline / parallax
    np.testing.assert_allclose(estimated * np.linalg.norm([0.15, 0.01, -0.01]), depth, rtol=0.03)


def test_offset_belongs_to_the_cropped_images():
    """Principal points follow the crop: parallax is the same with and without it."""
    points = tie_points(RIG)
    cropped, whole = estimate(points), estimate(points, rectify_crop=False)
    np.testing.assert_allclose(cropped.parallax(points), whole.parallax(points), atol=1e-9)
    assert (whole.width, whole.height) == (RIG.width, RIG.height)
    assert cropped.valid_left is None
    window = whole.valid_left
    assert (window.width, window.height) == (cropped.width, cropped.height)
    np.testing.assert_array_equal(whole.left_map[window.slices], cropped.left_map)
    np.testing.assert_array_equal(whole.right_map[whole.valid_right.slices], cropped.right_map)
    left, right = cropped.rectified(points)
    across = (left - right)[:, 1]
    np.testing.assert_allclose(across, cropped.row_errors(points))


def test_both_views_show_something_everywhere_and_have_one_size():
    found = estimate(tie_points(RIG))
    for raw in (found.left_map, found.right_map):
        assert raw.shape == (found.height, found.width, 2)
        assert raw.min() >= -0.5
        assert (raw <= [RIG.width - 0.5, RIG.height - 0.5]).all()
    assert found.width * found.height > 0.8 * RIG.width * RIG.height


def test_maps_are_the_views():
    found = estimate(tie_points(RIG))
    pixel = np.array([[100.0, 200.0]])
    for view, raw in ((found.left, found.left_map), (found.right, found.right_map)):
        np.testing.assert_allclose(raw[200, 100], view.raw(pixel)[0], atol=1e-3)


@settings(max_examples=8)
@given(seed=st.integers(0, 10_000), vertical=st.booleans())
def test_random_rigs(seed, vertical):
    rig = random_rig(seed, vertical=vertical)
    points = tie_points(rig, 350, noise=0.3, seed=seed)
    found = estimate(points)
    fresh = tie_points_of(rig, scatter(rig, 300, 1.0, 3.0, seed=seed + 1))
    assert rms(found.row_errors(fresh)) < 0.35
    assert found.geometry.axis == ("vertical" if vertical else "horizontal")
    assert (found.parallax(fresh) > 0).all()
    for view in (found.left, found.right):
        shape = homography_distortion(view.homography, rig.width, rig.height)
        assert abs(shape.aspect - 1) < 0.1
        assert abs(shape.angle_deg - 90) < 3


@pytest.mark.parametrize(("quarter_turns", "sign"), [(1, -1), (3, 1)])
def test_turned_by_a_quarter_it_is_a_vertical_rig(quarter_turns, sign):
    """np.rot90 once puts the right camera above the left one, three times below it; the rest is the same."""
    points = tie_points(RIG)
    level, turned = estimate(points), estimate(rotated(points, quarter_turns))
    assert turned.geometry.axis == "vertical"
    assert turned.geometry.baseline_sign == sign
    assert (turned.width, turned.height) == (level.height, level.width)
    assert turned.quality.row_error_median_px == pytest.approx(level.quality.row_error_median_px, abs=1e-6)
    assert turned.quality.row_error_p95_px == pytest.approx(level.quality.row_error_p95_px, abs=1e-6)
    np.testing.assert_allclose(
        sign * turned.parallax(rotated(points, quarter_turns)), level.parallax(points), atol=1e-4
    )


@pytest.mark.parametrize("quarter_turns", [1, 3])
def test_turned_views_warp_the_same_pixels(quarter_turns):
    points = tie_points(RIG)
    level, turned = estimate(points), estimate(rotated(points, quarter_turns))
    back = np.rot90(turned.left_map, -quarter_turns)
    u, v = back[..., 0], back[..., 1]
    raw = (RIG.width - 1 - v, u) if quarter_turns == 1 else (v, RIG.height - 1 - u)
    np.testing.assert_allclose(np.stack(raw, axis=-1), level.left_map, atol=2e-3)


def test_true_vertical_rig_below_and_above():
    for center, sign in (((0.0, 0.2, 0.0), 1), ((0.0, -0.2, 0.0), -1)):
        rig = make_rig(angles_deg=(1.0, 1.0, -2.0), center=center)
        found = estimate(tie_points(rig))
        assert (found.geometry.axis, found.geometry.baseline_sign) == ("vertical", sign)
        assert found.geometry.depth_from_disparity(np.float32(sign * 40.0)) > 0
        fresh = tie_points_of(rig, scatter(rig, 300, 1.0, 3.0, seed=3))
        assert rms(found.row_errors(fresh)) < 0.25


def test_axis_can_be_said():
    assert estimate(tie_points(RIG), rig_axis="horizontal").geometry.axis == "horizontal"
    with pytest.raises(EstimationError, match=r"turned by -?\d+ deg: is the baseline along the other axis"):
        estimate(tie_points(RIG), rig_axis="vertical")


def test_images_that_came_rectified_stay():
    points = tie_points(make_rig(center=(0.15, 0, 0)))
    found = estimate(points)
    assert found.quality.method == "given"
    assert found.left_map is None
    assert found.geometry.offset_px == 0
    np.testing.assert_allclose(found.row_errors(points), points.left[:, 1] - points.right[:, 1], atol=1e-9)
    assert estimate(points, given_limit_px=0.0).quality.method == "quasi-euclidean"


@pytest.mark.parametrize("quarter_turns", [1, 3])
def test_vertical_images_that_came_rectified_stay(quarter_turns):
    found = estimate(rotated(tie_points(make_rig(center=(0.15, 0, 0))), quarter_turns))
    assert (found.quality.method, found.geometry.axis) == ("given", "vertical")
    assert (found.width, found.height) == (480, 640)


def test_metres_need_baseline_and_focal_length():
    points = tie_points(RIG, noise=0.05)
    assert not estimate(points, baseline_m=0.15).geometry.metric
    assert not estimate(points, focal_px=620.0).geometry.metric
    found = estimate(points, baseline_m=0.1507, focal_px=620.0)
    assert found.geometry.metric
    assert found.geometry.focal_px == pytest.approx(620.0)
    left, right, truth = RIG.see(scatter(RIG, 200, 1.0, 3.0, seed=5))
    depth = found.geometry.focal_times_baseline / found.parallax(TiePoints(left, right, RIG.width, RIG.height))
    np.testing.assert_allclose(depth, (truth @ np.array(found.geometry.rect_from_raw_left).T)[:, 2], rtol=0.03)


def test_vague_metres_are_said():
    rig = make_rig(angles_deg=(1.0, -1.0, 0.5))
    points = tie_points_of(rig, scatter(rig, 60, 1.4, 1.6, seed=2), noise=0.4, seed=2)
    found = estimate(points, baseline_m=0.15, focal_px=620.0)
    assert found.infinity_sigma_px > 1
    assert any("metres are vague" in w.text for w in found.quality.warnings)


def test_infinity_is_moved_when_points_would_lie_behind():
    """A principal point off the centre looks like a turned camera: infinity lands among the points."""
    points = tie_points(RIG, 600, 1.0, 8.0, noise=0.2)
    shifted = TiePoints(points.left, points.right + np.array([40.0, 0.0]), points.width, points.height)
    found = estimate(shifted, focal_px=620.0, baseline_m=0.15)
    assert 0 < np.quantile(found.parallax(shifted), 0.03) < 10
    assert any(
        "plane at infinity was moved by" in w.text and "not to be trusted" in w.text for w in found.quality.warnings
    )


def test_flat_scene_is_warned_of():
    found = estimate(tie_points_of(RIG, scatter(RIG, 300, 1.5, 1.501), 0.3))
    assert found.flat
    assert any("flat scene" in w.text for w in found.quality.warnings)


def exchanged(points):
    return TiePoints(points.right, points.left, points.width, points.height)


@pytest.mark.parametrize("rig", [RIG, make_rig(center=(0.15, 0, 0))], ids=["turned", "rectified"])
def test_exchanged_cameras_are_refused(rig):
    with pytest.raises(
        EstimationError, match=r"left and right images are swapped: .*got 100% of \d+ tie points negative"
    ) as caught:
        estimate(exchanged(tie_points(rig)))
    assert "give the left camera's image as the left one" in str(caught.value)


def test_the_same_image_twice_is_refused():
    points = tie_points(RIG)
    same = TiePoints(points.left, points.left.copy(), points.width, points.height)
    with pytest.raises(EstimationError, match=r"no parallax: expected disparities over 0.5 px, got up to 0.00 px"):
        estimate(same)


def test_forward_motion_is_refused():
    rig = make_rig(center=(0.01, 0.005, 0.4), angles_deg=(0.5, 0.3, 0.2))
    with pytest.raises(
        EstimationError, match=r"forward motion: the epipole lies in the \w+ image, at \(\d+, \d+\) of"
    ) as caught:
        estimate(tie_points(rig, 500, noise=0.2))
    assert caught.value.code == Code.RECTIFY_FORWARD_MOTION


def test_rows_that_disagree_are_refused():
    """Tie points of no rigid rig: rows off by several px, at random."""
    points = tie_points(RIG)
    rng = np.random.default_rng(0)
    shaken = TiePoints(points.left, points.right + rng.normal(0, 6, points.right.shape), 640, 480)
    with pytest.raises(EstimationError, match=r"95th percentile up to 4.00 px, got (\d+\.\d+) px") as caught:
        estimate(shaken)
    assert float(re.search(r"got (\d+\.\d+) px", str(caught.value))[1]) > 4
    assert caught.value.code == Code.RECTIFY_ROWS_DISAGREE


def test_distorted_images_are_refused():
    with pytest.raises(EstimationError, match=r"would be distorted: .*got aspect"):
        estimate(tie_points(make_rig(angles_deg=(0.0, -25.0, 0.0), center=(0.5, 0.0, 0.1)), 800))


def test_too_little_left_is_refused():
    with pytest.raises(EstimationError, match=r"at least 100% of the image to remain, got \d+%"):
        estimate(tie_points(RIG), rectify_min_area=1.0)


def test_too_few_tie_points_are_refused():
    with pytest.raises(EstimationError, match="at least 25 tie points, got 10"):
        estimate(tie_points(RIG).take(np.arange(10)))


def test_deterministic():
    points = tie_points(RIG, 3000)
    first, second = estimate(points), estimate(points)
    assert first.geometry == second.geometry
    assert first.quality == second.quality
    np.testing.assert_array_equal(first.left_map, second.left_map)


@pytest.mark.parametrize("seed", range(4))
def test_over_a_flat_floor_no_order_is_wrongly_refused_nor_taken_in_silence(seed):
    """Cameras toed in, all at one distance: which is the left one is refused rightly, or said not to be known."""
    rig = make_rig(angles_deg=(0.0, 4.0, 0.0))
    flat = tie_points_of(rig, scatter(rig, 200, 0.6, 0.605, seed), 0.5, seed)
    found = estimate(flat)
    assert found.geometry.baseline_sign == 1
    assert said_of(exchanged(flat)) & {Code.RECTIFY_EXCHANGED, Code.RECTIFY_ORDER_UNKNOWN}


def said_of(points):
    """Codes of an estimate's warnings, or of its refusal."""
    try:
        return {warning.code for warning in estimate(points).quality.warnings}
    except EstimationError as error:
        return {error.code}
