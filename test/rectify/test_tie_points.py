"""Tie points on images cast ray by ray, where the true epipolar geometry is known."""

import numpy as np
import pytest
from helpers.rig_scenes import enhanced, make_rig, render

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.rectify import RectifyParams, TiePoints, find_tie_points
from uw_recon_ros.rectify.features import mutual_matches, spread
from uw_recon_ros.rectify.sampson import sampson_distance
from uw_recon_ros.rectify.tie_points import gathered, thinned, to_full_size
from uw_recon_ros.types import StereoPair
from uw_recon_ros.unseen_pixels import with_margin

RIG = make_rig(angles_deg=(1.0, -1.5, 2.0))
PARAMS = RectifyParams()


@pytest.fixture(scope="module")
def images():
    return render(RIG)


@pytest.fixture(scope="module")
def found(images):
    return find_tie_points(enhanced(*images), PARAMS)


def distances(points, rig=RIG):
    t = rig.right.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    matrix = np.linalg.inv(rig.right.k).T @ cross @ rig.right.rotation @ np.linalg.inv(rig.left.k)
    return sampson_distance(matrix, points.left, points.right)


def test_many_sub_pixel_and_without_outliers(found):
    assert len(found) > 500
    assert np.median(np.abs(distances(found))) < 0.1
    assert np.abs(distances(found)).max() < 2
    assert np.abs(np.mean(distances(found))) < 0.03


def test_spread_over_the_image(found):
    cells = {tuple(cell) for cell in (found.left // [80, 80]).astype(int)}
    assert len(cells) > 0.8 * 8 * 6 - 6  # but for a strip on the left that the right camera does not see


def test_deterministic(images, found):
    again = find_tie_points(enhanced(*images), PARAMS)
    np.testing.assert_array_equal(again.left, found.left)
    np.testing.assert_array_equal(again.right, found.right)


def test_larger_images_are_reduced_and_pixels_stay_those_of_the_full_image(images):
    reduced = find_tie_points(enhanced(*images), PARAMS, longest_side=320)
    assert (reduced.width, reduced.height) == (640, 480)
    assert reduced.left.max() > 500
    assert np.median(np.abs(distances(reduced))) < 0.4
    assert np.abs(np.mean(distances(reduced))) < 0.1


def test_a_pixel_of_the_reduced_image_is_the_middle_of_those_it_replaced():
    half, full = np.zeros((240, 320, 3), np.uint8), np.zeros((480, 640, 3), np.uint8)
    pixels = to_full_size(np.array([[0.0, 0.0], [319.0, 239.0]]), half, full)
    np.testing.assert_allclose(pixels, [[0.5, 0.5], [638.5, 478.5]])


def test_images_without_texture_are_refused_with_the_counts():
    gray = np.full((480, 640, 3), 128, np.uint8)
    with pytest.raises(
        EstimationError, match=r"at least 25 features a camera, got 0 left and 0 right: .*too little texture"
    ):
        find_tie_points(enhanced(gray, gray), PARAMS)


def test_the_same_image_twice_has_tie_points(images):
    points = find_tie_points(enhanced(images[0], images[0]), PARAMS)
    np.testing.assert_allclose(points.left, points.right)


@pytest.mark.parametrize("shape", [(1, 1, 3), (8, 8, 3), (3, 200, 3)])
def test_tiny_images_are_refused(shape):
    image = np.random.default_rng(0).integers(0, 256, shape, dtype=np.uint8)
    with pytest.raises(EstimationError, match="tie points: expected at least"):
        find_tie_points(enhanced(image, image), PARAMS)


def test_different_scenes_are_refused_with_the_counts(images):
    other = np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)
    with pytest.raises(EstimationError, match=r"got \d+ of \d+ matches \(\d+ features left, \d+ right\)"):
        find_tie_points(enhanced(images[0], other), PARAMS)


def test_mutual_matches_want_both_sides_and_a_clear_first():
    basis = np.eye(4, dtype=np.float32)
    twins = np.stack([basis[0], basis[0] + 0.01 * basis[3], basis[1]])
    between = np.stack([basis[0] + 0.005 * basis[3], basis[1], basis[2]])
    twins, between = (rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in (twins, between))
    left, right = mutual_matches(between, twins, 0.8)
    assert list(zip(left.tolist(), right.tolist(), strict=True)) == [(1, 2)]
    both = np.stack([basis[1], basis[1] * 0.9 + basis[2] * 0.1])
    left, right = mutual_matches(both, np.stack([basis[1], basis[3]]), 0.8)
    assert list(zip(left.tolist(), right.tolist(), strict=True)) == [(0, 0)]
    assert mutual_matches(basis[:1], basis, 0.8)[0].size == 0


def test_mutual_matches_do_not_depend_on_the_chunks():
    rng = np.random.default_rng(0)
    left = rng.normal(size=(700, 16)).astype(np.float32)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    order = rng.permutation(700)
    index_left, index_right = mutual_matches(left, left[order], 0.8)
    assert len(index_left) == 700
    np.testing.assert_array_equal(order[index_right], index_left)


def test_spread_takes_the_best_of_every_part():
    rng = np.random.default_rng(0)
    crowded = rng.uniform((0, 0), (80, 60), (500, 2))
    sparse = rng.uniform((0, 0), (640, 480), (100, 2))
    points, priority = np.vstack([crowded, sparse]), np.concatenate([np.ones(500), np.zeros(100)])
    chosen = spread(points, priority, 120, 640, 480)
    assert len(chosen) == 120
    assert (chosen >= 500).sum() > 90
    best = spread(points, rng.permutation(600).astype(float), 1, 640, 480)
    assert len(best) == 1


def test_thinned_and_gathered(found):
    few = thinned(found, 100, seed=0)
    assert len(few) == 100
    assert thinned(few, 100, seed=0) is few
    both = gathered([few, found])
    assert len(both) == 100 + len(found)
    with pytest.raises(ValueError, match="one image size"):
        gathered([found, TiePoints(found.left, found.right, 10, 10)])


def test_shapes_are_checked():
    with pytest.raises(ValueError, match="expected shapes"):
        TiePoints(np.zeros((3, 2)), np.zeros((4, 2)), 640, 480)
    with pytest.raises(ValueError, match="width, height"):
        TiePoints(np.zeros((3, 2)), np.zeros((3, 2)), 0, 480)


def bordered(images, width=16):
    frame = np.ones(images[0].shape[:2], bool)
    frame[width:-width, width:-width] = False
    return frame, tuple(np.where(frame[..., None], np.uint8(0), image) for image in images)


def test_a_black_border_costs_no_more_than_what_it_hides(images, found):
    """Nor do the features of its edges, which both images have at the same place, tie anything."""
    frame, black = bordered(images)
    within = find_tie_points(Preprocess()(StereoPair(*black)), PARAMS)
    good = find_tie_points(Preprocess()(StereoPair(*images)), PARAMS)
    inside = (~frame[tuple(np.round(good.left).astype(int).T[::-1])]).sum()
    assert len(within) > 0.85 * inside
    hidden = with_margin(frame)
    for points in (within.left, within.right):
        assert not hidden[tuple(np.round(points).astype(int).T[::-1])].any()
    assert np.median(np.abs(distances(within))) < 1.2 * np.median(np.abs(distances(good))) + 0.01
