"""Real underwater pairs: an uncalibrated one whose rows differ by 33 to 43 px, and one that came rectified."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.rig_scenes import enhanced

from uw_recon_ros.files.images import read_image
from uw_recon_ros.rectify import Rectify, RectifyParams, RigTracker, TiePoints, estimate_rectification, find_tie_points
from uw_recon_ros.rectify.quality import homography_distortion

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "underwater"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason=f"no real pairs at {DATA}")
PARAMS = RectifyParams()


def load(name, quarter_turns=0):
    """Contrast stretched tile by tile, turned."""
    images = []
    for path in sorted((DATA / name).iterdir()):
        lab = cv2.cvtColor(read_image(path), cv2.COLOR_RGB2LAB)
        lab[..., 0] = cv2.createCLAHE(3.0, (8, 8)).apply(lab[..., 0])
        images.append(np.rot90(cv2.cvtColor(lab, cv2.COLOR_LAB2RGB), quarter_turns))
    return enhanced(*images)


@pytest.fixture(scope="module")
def canyon():
    pair = load("flsea_canyon")
    return pair, find_tie_points(pair, PARAMS)


def test_canyon_rows_agree_on_held_out_matches(canyon):
    found = estimate_rectification(canyon[1], PARAMS)
    assert found.quality.method == "quasi-euclidean"
    assert found.quality.row_error_median_px < 0.6
    assert found.quality.row_error_p95_px < 1.5
    assert found.quality.inliers > 180
    assert found.quality.warnings == ()
    for view in (found.left, found.right):
        shape = homography_distortion(view.homography, 1280, 720)
        assert abs(shape.aspect - 1) < 0.03
        assert abs(shape.angle_deg - 90) < 1.4
    assert found.width * found.height > 0.85 * 1280 * 720
    assert not found.geometry.metric
    assert 800 < found.geometry.focal_px < 1800


def test_canyon_without_prior(canyon):
    """The bare method: from zero, unless its first step is held back, it leaves for focal lengths without return."""
    found = estimate_rectification(canyon[1], RectifyParams(rig_prior_weight=0.0))
    assert found.quality.row_error_median_px < 0.6
    assert 800 < found.geometry.focal_px < 1800


def test_canyon_rows_agree_on_matches_of_another_search(canyon):
    """Tie points found at half the size, with another seed: neither in the fit nor through its filter."""
    found = estimate_rectification(canyon[1], PARAMS)
    other = find_tie_points(canyon[0], RectifyParams(rectify_seed=5), longest_side=640)
    raw_rows = other.left[:, 1] - other.right[:, 1]
    assert np.median(raw_rows) > 33
    assert np.median(np.abs(found.row_errors(other))) < 0.8


def test_canyon_features_of_the_rectified_images_share_rows(canyon):
    out = Rectify(PARAMS)(canyon[0], estimate_rectification(canyon[1], PARAMS))
    found = find_tie_points(enhanced(out.left, out.right), PARAMS)
    assert np.median(np.abs(found.left[:, 1] - found.right[:, 1])) < 0.6


@pytest.mark.parametrize(("quarter_turns", "sign"), [(1, -1), (3, 1)])
def test_turned_canyon_gives_the_same_pictures(canyon, quarter_turns, sign):
    """The same tie points, turned: the rectified images are the level ones, turned."""
    pair, points = canyon
    width, height = points.width, points.height

    def turn(p):
        u, v = p[:, 0], p[:, 1]
        return np.column_stack([v, width - 1 - u] if quarter_turns == 1 else [height - 1 - v, u])

    turned_points = TiePoints(turn(points.left), turn(points.right), height, width)
    level, turned = estimate_rectification(points, PARAMS), estimate_rectification(turned_points, PARAMS)
    assert (turned.geometry.axis, turned.geometry.baseline_sign) == ("vertical", sign)
    assert turned.quality.row_error_median_px == pytest.approx(level.quality.row_error_median_px, abs=1e-3)
    out_level = Rectify(PARAMS)(pair, level)
    out_turned = Rectify(PARAMS)(load("flsea_canyon", quarter_turns), turned)
    back = np.rot90(out_turned.left, -quarter_turns)
    u, v = turned.geometry.cy, turned.geometry.cx_left  # the crop may differ by a pixel: align the principal points
    centre = np.array([back.shape[1] - 1 - v, u] if quarter_turns == 1 else [v, back.shape[0] - 1 - u])
    shift = centre - [level.geometry.cx_left, level.geometry.cy]
    np.testing.assert_allclose(shift, np.rint(shift), atol=0.01)
    assert np.abs(shift).max() < 3
    moved = np.roll(back, -np.rint(shift[::-1]).astype(int), axis=(0, 1))
    difference = np.abs(moved.astype(int) - out_level.left)[5:-5, 5:-5]
    assert difference.mean() < 0.6


@pytest.mark.parametrize(("quarter_turns", "sign"), [(1, -1), (3, 1)])
def test_turned_canyon_searched_anew(quarter_turns, sign):
    """Features found in the turned images: the same geometry within its uncertainty."""
    found = RigTracker(PARAMS).update(load("flsea_canyon", quarter_turns))
    assert (found.geometry.axis, found.geometry.baseline_sign) == ("vertical", sign)
    assert found.quality.row_error_median_px < 0.6
    assert found.height > found.width


@pytest.mark.parametrize(
    ("quarter_turns", "axis", "sign"), [(0, "horizontal", 1), (1, "vertical", -1), (3, "vertical", 1)]
)
def test_diver_came_rectified(quarter_turns, axis, sign):
    pair = load("caddy_diver", quarter_turns)
    found = RigTracker(PARAMS).update(pair)
    assert found.quality.method == "given"
    assert (found.geometry.axis, found.geometry.baseline_sign) == (axis, sign)
    assert found.quality.row_error_median_px < 0.6
    parallax = sign * found.parallax(find_tie_points(pair, PARAMS))
    assert np.quantile(parallax, 0.02) > 20
    assert np.quantile(parallax, 0.98) < 95


def test_diver_can_be_rectified_all_the_same():
    found = RigTracker(RectifyParams(given_limit_px=0.0)).update(load("caddy_diver"))
    assert found.quality.method == "quasi-euclidean"
    assert found.quality.row_error_median_px < 0.6
    assert found.width * found.height > 0.95 * 640 * 480
