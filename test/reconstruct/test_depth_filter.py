"""The filter takes noise, not edges; speckles go; nothing is invented."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.reconstruct.depth_filter import ROUNDING_SIGMA, remove_speckles, smooth_disparity
from uw_recon_ros.reconstruct.planes import fit_planes, flat_planes
from uw_recon_ros.reconstruct.speckles import find_speckles

SHAPE = 96, 128


def grid():
    return np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float32)


def smooth(disparity, sigma=0.25, levels=5, sigmas=4.685):
    return smooth_disparity(disparity, np.full(disparity.shape, sigma, np.float32), levels=levels, sigmas=sigmas)


def noisy(truth, sigma, seed=0):
    return (truth + np.random.default_rng(seed).normal(0, sigma, truth.shape)).astype(np.float32)


def test_noise_on_a_slanted_plane_falls_to_a_fifth():
    v, u = grid()
    truth = 20 + 0.1 * u - 0.05 * v
    error = smooth(noisy(truth, 0.25)) - truth
    assert error.std() < 0.25 / 5
    assert abs(error.mean()) < 0.01


def test_rounding_to_whole_pixels_is_undone_on_a_slant():
    v, u = grid()
    truth = 20 + 0.13 * u + 0.09 * v
    error = smooth(np.round(truth), sigma=ROUNDING_SIGMA) - truth
    assert error.std() < 0.06


@pytest.mark.parametrize("height", [2.0, 3.0, 10.0])
def test_a_step_stays_where_it_is(height):
    _, u = grid()
    right = u >= 64
    truth = 10 + 0.05 * u + height * right
    error = np.abs(smooth(noisy(truth, 0.2), sigma=0.2) - truth)
    assert error.max() < height / 2
    assert error[:, 60:68].mean() < 0.1  # a linear blur of the same strength leaves over height / 4


@settings(max_examples=15)
@given(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-50, 50))
def test_planes_are_left_as_they_are(slope_u, slope_v, base):
    v, u = grid()
    truth = (base + slope_u * u + slope_v * v).astype(np.float32)
    np.testing.assert_allclose(smooth(truth), truth, atol=0.02)


def test_valid_pixels_stay_valid_and_invalid_ones_invalid():
    _, u = grid()
    truth = noisy(15 + 0.05 * u, 0.3)
    truth[np.random.default_rng(3).random(SHAPE) < 0.4] = np.nan
    truth[20:40, 20:60] = np.nan
    assert np.array_equal(np.isfinite(smooth(truth)), np.isfinite(truth))


def test_a_pixel_never_leaves_the_range_of_its_surroundings_by_more_than_the_noise():
    truth = noisy(np.full(SHAPE, 15.0), 0.3)
    out = smooth(truth)
    assert truth.min() <= out.min() <= out.max() <= truth.max()


def test_missing_sigma_counts_as_rounding():
    _, u = grid()
    rounded = np.round(20 + 0.13 * u).astype(np.float32)
    for missing in (np.nan, 0.0, -1.0):
        assert np.array_equal(smooth(rounded, missing), smooth(rounded, ROUNDING_SIGMA))


def test_no_levels_no_change():
    truth = noisy(np.full(SHAPE, 15.0), 0.3)
    assert np.array_equal(smooth(truth, levels=0), truth)


def test_same_input_same_bits():
    truth = noisy(np.full(SHAPE, 15.0), 0.3)
    assert smooth(truth).tobytes() == smooth(truth).tobytes()


def test_fit_equals_weighted_least_squares_written_out():
    rng = np.random.default_rng(5)
    disparity = rng.normal(10, 0.5, (5, 5)).astype(np.float32)
    disparity[1, 3] = np.nan
    step, band = 2, 1.5
    planes = fit_planes(flat_planes(disparity), np.full((5, 5), band, np.float32), step)
    rows, right, weights = [], [], []
    for j in (-1, 0, 1):
        for i in (-1, 0, 1):
            residual = disparity[2 + j * step, 2 + i * step] - disparity[2, 2]
            binomial = (2 - abs(i)) * (2 - abs(j)) / 4
            weight = 0.0 if np.isnan(residual) else binomial * max(0.0, 1 - (residual / band) ** 2) ** 2
            rows.append([1, i * step, j * step])
            right.append(np.nan_to_num(residual))
            weights.append(weight)
    A, w = np.array(rows, float), np.array(weights)
    ridge = np.diag([0.0, 0.01 * step**2, 0.01 * step**2])
    centre, slope_u, slope_v = np.linalg.solve(A.T @ (w[:, None] * A) + ridge, A.T @ (w * right))
    assert planes.value[2, 2] == pytest.approx(disparity[2, 2] + centre, abs=1e-4)
    assert planes.slope_u[2, 2] == pytest.approx(slope_u, abs=1e-4)
    assert planes.slope_v[2, 2] == pytest.approx(slope_v, abs=1e-4)
    assert planes.support[2, 2] == pytest.approx(w.sum(), rel=1e-4)


@settings(max_examples=20)
@given(st.integers(0, 1000), st.integers(0, 30), st.sampled_from([0.5, 1.0, 2.5]))
def test_speckles_agree_with_a_graph_search(seed, area, jump):
    rng = np.random.default_rng(seed)
    disparity = rng.integers(0, 6, (14, 17)).astype(np.float32)
    disparity[rng.random(disparity.shape) < 0.2] = np.nan
    index = np.arange(disparity.size).reshape(disparity.shape)
    pairs = [
        (index[:, :-1], index[:, 1:], np.abs(np.diff(disparity, axis=1)) <= jump),
        (index[:-1], index[1:], np.abs(np.diff(disparity, axis=0)) <= jump),
    ]
    a = np.concatenate([p[ok] for p, _, ok in pairs])
    b = np.concatenate([q[ok] for _, q, ok in pairs])
    graph = coo_array((np.ones(len(a)), (a, b)), shape=(disparity.size, disparity.size))
    piece = connected_components(graph, directed=False)[1]
    small = (np.bincount(piece)[piece] < area).reshape(disparity.shape) & np.isfinite(disparity)
    assert np.array_equal(find_speckles(disparity, jump, area), small)


def test_removed_speckles_are_nan_and_reported():
    disparity = np.full((20, 20), 5.0, np.float32)
    disparity[4:6, 4:6] = 9.0
    kept, removed = remove_speckles(disparity, max_jump_px=1.0, min_area_px=5)
    assert removed.sum() == 4
    assert removed[4:6, 4:6].all()
    assert np.array_equal(np.isnan(kept), removed)


def test_mistakes_are_named():
    image = np.ones((4, 4), np.float32)
    with pytest.raises(ValueError, match=r"expected one \(H, W\) shape, got \(4, 4\) and \(4, 5\)"):
        smooth_disparity(image, np.ones((4, 5), np.float32), levels=1, sigmas=1.0)
    with pytest.raises(ValueError, match=r"got -1 and 1\.0"):
        smooth_disparity(image, image, levels=-1, sigmas=1.0)
