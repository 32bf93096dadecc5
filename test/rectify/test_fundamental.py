import numpy as np
import pytest
from helpers.rig_scenes import make_rig, tie_points

from uw_recon_ros.rectify.fundamental import epipole_inside, epipoles, fit_fundamental, robust_inliers
from uw_recon_ros.rectify.sampson import sampson_distance


def true_fundamental(rig):
    r, t = rig.right.rotation, rig.right.translation
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    matrix = np.linalg.inv(rig.right.k).T @ cross @ r @ np.linalg.inv(rig.left.k)
    return matrix / np.linalg.norm(matrix)


def test_truth_is_found_without_noise():
    rig = make_rig(angles_deg=(2.0, -3.0, 1.0), center=(0.2, 0.02, 0.03))
    points = tie_points(rig, noise=0.0)
    found, truth = fit_fundamental(points.left, points.right), true_fundamental(rig)
    assert min(np.abs(found - truth).max(), np.abs(found + truth).max()) < 1e-6


def test_rank_two_and_close_under_noise():
    rig = make_rig(angles_deg=(2.0, -3.0, 1.0))
    points, clean = tie_points(rig, noise=0.4), tie_points(rig, noise=0.0, seed=9)
    found = fit_fundamental(points.left, points.right)
    assert np.linalg.svd(found)[1][2] < 1e-12
    assert np.sqrt(np.mean(sampson_distance(found, clean.left, clean.right) ** 2)) < 0.2


def test_epipoles_are_the_images_of_the_other_camera():
    rig = make_rig(angles_deg=(1.0, 2.0, 3.0), center=(0.1, 0.02, 0.2))
    left, right = epipoles(true_fundamental(rig))
    seen_left = rig.left.k @ -(rig.right.rotation.T @ rig.right.translation)
    seen_right = rig.right.k @ rig.right.translation
    np.testing.assert_allclose(left[:2] / left[2], seen_left[:2] / seen_left[2], rtol=1e-6)
    np.testing.assert_allclose(right[:2] / right[2], seen_right[:2] / seen_right[2], rtol=1e-6)


@pytest.mark.parametrize(
    ("epipole", "inside"),
    [((320, 240, 1), True), ((-320, -240, -1), True), ((1, 0, 0), False), ((700, 240, 1), False), ((0, 0, 0), False)],
)
def test_epipole_inside(epipole, inside):
    assert epipole_inside(np.array(epipole, float), 640, 480) is inside


def test_outliers_are_left_out():
    rig = make_rig(angles_deg=(1.0, -1.0, 2.0))
    points = tie_points(rig, 300, noise=0.3)
    rng = np.random.default_rng(1)
    wrong = rng.uniform(0, (640, 480), (150, 2)), rng.uniform(0, (640, 480), (150, 2))
    left, right = np.vstack([points.left, wrong[0]]), np.vstack([points.right, wrong[1]])
    inside = robust_inliers(left, right, 1.0, seed=0)
    truth = np.abs(sampson_distance(true_fundamental(rig), left, right)) < 1.0
    assert (inside[: len(points)]).mean() > 0.97
    assert inside[len(points) :].mean() < truth[len(points) :].mean() + 0.03


@pytest.mark.parametrize("seed", [0, 1, 12345])
def test_seeded_and_deterministic(seed):
    points = tie_points(make_rig(), 100, noise=2.0)
    first, second = (robust_inliers(points.left, points.right, 1.0, seed) for _ in range(2))
    assert (first == second).all()


def test_too_few_matches_give_nothing():
    assert not robust_inliers(np.zeros((7, 2)), np.zeros((7, 2)), 1.0, 0).any()
    with pytest.raises(ValueError, match="at least 8"):
        fit_fundamental(np.zeros((7, 2)), np.zeros((7, 2)))
