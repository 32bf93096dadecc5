"""The fit on rigs of known truth."""

import numpy as np
import pytest
from helpers.rig_scenes import intrinsics, make_rig, random_rig, scatter, tie_points, tie_points_of
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.rectify.parametrization import fundamental_and_jacobian
from uw_recon_ros.rectify.quasi_euclidean import fit_quasi_euclidean
from uw_recon_ros.rectify.sampson import homogeneous, sampson_distance


def fit(points, **options):
    return fit_quasi_euclidean(points.left, points.right, points.width, points.height, **options)


def rows_after(found, points):
    k = intrinsics(points.width, points.height, found.focal_px)
    left, right = (
        homogeneous(p) @ (k @ rotation @ np.linalg.inv(k)).T
        for p, rotation in ((points.left, found.rotation_left), (points.right, found.rotation_right))
    )
    return left[:, 1] / left[:, 2] - right[:, 1] / right[:, 2]


def test_jacobian_equals_central_differences():
    unknowns = np.array([0.1, -0.2, 0.15, -0.05, 0.3, -0.4])
    _, jacobian = fundamental_and_jacobian(unknowns)
    for i in range(6):
        nudge = 1e-6 * np.eye(6)[i]
        ahead, behind = (fundamental_and_jacobian(unknowns + s * nudge)[0].ravel() for s in (1, -1))
        np.testing.assert_allclose(jacobian[:, i], (ahead - behind) / 2e-6, atol=1e-8)


def test_without_noise_and_prior_the_truth_is_found():
    rig = make_rig(angles_deg=(1.5, -2.0, 1.0), center=(0.15, 0.01, -0.01), focal=700.0)
    points = tie_points(rig, noise=0.0)
    found = fit(points, prior_weight=0.0)
    assert found.focal_px == pytest.approx(700.0, rel=1e-4)
    assert np.abs(rows_after(found, points)).max() < 1e-4
    relative = found.rotation_right.T @ found.rotation_left  # R_r R = R_l
    np.testing.assert_allclose(relative, rig.right.rotation, atol=1e-5)


def test_rotations_are_rotations_and_fundamental_is_theirs():
    points = tie_points(random_rig(3))
    found = fit(points)
    for rotation in (found.rotation_left, found.rotation_right):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
    k = np.linalg.inv(intrinsics(points.width, points.height, found.focal_px))
    cross = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    eq_15 = k.T @ found.rotation_right.T @ cross @ found.rotation_left @ k
    eq_15 /= np.linalg.norm(eq_15)
    assert min(np.abs(found.fundamental - eq_15).max(), np.abs(found.fundamental + eq_15).max()) < 1e-12


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), angle=st.sampled_from([1.0, 4.0, 8.0]))
def test_random_rigs_get_rows_near_the_noise(seed, angle):
    rig = random_rig(seed, angle_deg=angle)
    points = tie_points(rig, 400, noise=0.3, seed=seed)
    truth = tie_points_of(rig, scatter(rig, 300, 1.0, 3.0, seed + 1))
    if min(len(points), len(truth)) < 40:
        return  # the cameras hardly look at the same place
    rows = rows_after(fit(points), truth)
    assert np.sqrt(np.mean(rows**2)) < 0.3


def test_strong_turns_are_found_from_zero():
    rig = make_rig(angles_deg=(5.0, -12.0, 15.0), center=(0.2, 0.03, 0.02))
    points = tie_points(rig, 600, noise=0.0)
    assert len(points) > 100
    assert np.abs(rows_after(fit(points, prior_weight=0.0), points)).max() < 1e-3


def test_given_focal_length_is_kept():
    points = tie_points(make_rig(angles_deg=(1.0, 2.0, -1.0), focal=640.0))
    found = fit(points, focal_px=640.0)
    assert found.focal_fixed
    assert found.focal_px == pytest.approx(640.0, rel=1e-12)
    assert np.sqrt(np.mean(rows_after(found, points) ** 2)) < 0.6


def test_prior_decides_only_what_the_matches_leave_open():
    """On a nearly flat scene the focal length is open: with the prior it stays ordinary; rows are as good."""
    rig = make_rig(angles_deg=(1.0, -1.0, 0.5), focal=620.0)
    flat = scatter(rig, 120, 1.49, 1.51, seed=5)
    points = tie_points_of(rig, flat, noise=0.5, seed=5)
    errors = {}
    for weight in (0.0, 1.0):
        found = fit(points, prior_weight=weight)
        errors[weight] = np.abs(np.log(found.focal_px / 620.0))
        assert np.sqrt(np.mean(sampson_distance(found.fundamental, points.left, points.right) ** 2)) < 0.6
    assert errors[1.0] < 0.35
    assert errors[1.0] < errors[0.0]


def test_focal_lengths_out_of_range_are_fixed_at_w_plus_h():
    """A telephoto rig (30 times the image) without prior: no start ends inside, alpha' = 0 is fixed (paper 2.2)."""
    rig = make_rig(focal=20_000.0, angles_deg=(0.05, 0.02, 1.0), center=(2.0, 0.2, 0.1))
    points = tie_points(rig, 400, 80.0, 200.0, noise=0.0)
    assert len(points) > 50
    found = fit(points, prior_weight=0.0)
    assert found.focal_fixed
    assert found.focal_px == pytest.approx(640 + 480)
    assert np.median(np.abs(rows_after(found, points))) < 0.5


def test_infinity_sigma_covers_the_error():
    inside = 0
    for seed in range(12):
        rig = make_rig(angles_deg=(0.5, 1.0, -0.5))
        found = fit(tie_points(rig, 200, noise=0.4, seed=seed))
        vergence = np.arcsin((found.rotation_right.T @ found.rotation_left)[0, 2])
        truth = np.arcsin(rig.right.rotation[0, 2])
        inside += abs(found.focal_px * (vergence - truth)) < 3 * found.infinity_sigma_px
    assert inside >= 11


def test_same_input_same_bits():
    points = tie_points(random_rig(7))
    first, second = fit(points), fit(points)
    assert first.focal_px == second.focal_px
    assert (first.rotation_right == second.rotation_right).all()


def test_too_few_matches_are_refused():
    with pytest.raises(ValueError, match="N >= 6"):
        fit_quasi_euclidean(np.zeros((5, 2)), np.zeros((5, 2)), 640, 480)
