"""The covariance from whole pairs: on a linear problem, whose truth is known, and on boards whose points err alike."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, LARGE, depth_misses, erring_alike, rig_of, sightings

from uw_recon_ros.calibrate.depth_error import depth_sigmas
from uw_recon_ros.calibrate.fit import solve
from uw_recon_ros.calibrate.pair_covariance import pair_covariance
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.types import Matrix

_NUMBERS, _POINTS = 8, 40


def _normalised_errors(pairs: int, alone: float, alike: float, repeats: int = 150) -> tuple[Matrix, Matrix]:
    """Errors of numbers over their stated sigma, and over the sigma that the points' noise alone tells."""
    rng, made = np.random.default_rng(1), []
    for _ in range(repeats):
        slopes = rng.standard_normal((pairs, _POINTS, _NUMBERS))
        slopes += 2 * rng.standard_normal((pairs, 1, _NUMBERS))  # points of a pair tell much the same
        misses = alone * rng.standard_normal((pairs, _POINTS)) + alike * rng.standard_normal((pairs, 1))
        flat, values = slopes.reshape(-1, _NUMBERS), misses.ravel()
        found = np.linalg.lstsq(flat, values, rcond=None)[0]
        left = misses - slopes @ found
        noise = float(np.sqrt((left**2).sum() / (left.size - _NUMBERS)))
        parts, pulls = [s.T @ s for s in slopes], [s.T @ m for s, m in zip(slopes, left, strict=True)]
        stated = pair_covariance(parts, pulls, np.zeros((_NUMBERS, _NUMBERS)), noise)
        plain = noise**2 * np.linalg.inv(np.sum(parts, axis=0))
        made.append([found / np.sqrt(np.diag(stated)), found / np.sqrt(np.diag(plain))])
    stated_errors, plain_errors = np.array(made).transpose(1, 0, 2)
    return stated_errors, plain_errors


@pytest.mark.parametrize("pairs", [8, 30])
def test_independent_points_lose_nothing(pairs: int) -> None:
    stated, plain = _normalised_errors(pairs, 1.0, 0.0)
    assert 0.6 < np.mean(np.abs(stated) <= 1) < 0.75
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(np.sqrt(np.mean(plain**2)), rel=0.1)


@pytest.mark.parametrize("pairs", [8, 30])
def test_points_that_err_alike_are_paid_for(pairs: int) -> None:
    stated, plain = _normalised_errors(pairs, 0.5, 1.0)
    assert np.mean(np.abs(plain) <= 1) < 0.4  # what it mends
    assert 0.58 < np.mean(np.abs(stated) <= 1) < 0.78


def test_what_is_known_beforehand_counts() -> None:
    """A prior that is far surer than the pairs is what comes out."""
    rng = np.random.default_rng(2)
    slopes = rng.standard_normal((6, _POINTS, _NUMBERS))
    parts = [s.T @ s for s in slopes]
    pulls = [s.T @ rng.standard_normal(_POINTS) for s in slopes]
    prior = 1e6 * np.eye(_NUMBERS)
    found = pair_covariance(parts, pulls, prior, 0.5)
    assert np.sqrt(np.diag(found)) == pytest.approx(0.5 / 1e3, rel=0.01)


def test_boards_that_err_alike_state_a_larger_error() -> None:
    """As much noise, but common to the points of a view: depth is worse, and the stated sigma knows it."""
    misses, stated = [], []
    for seed in (1, 2, 3):
        rig = rig_of(seed, **LARGE)
        pairs = erring_alike(sightings(rig, 12, seed, noise_px=0.1), 0.2, seed)
        fit = solve(pairs, BOARD, (1280, 960))
        found, sigmas = RigNumbers(fit.bundle.numbers, (1280, 960)), []
        alone = solve(sightings(rig, 12, seed, noise_px=0.224), BOARD, (1280, 960))
        for one in (fit, alone):
            sigmas.append(np.sqrt(np.mean(depth_sigmas(found, one.bundle.covariance, 2.0)[1] ** 2)))
        assert sigmas[0] > 1.5 * sigmas[1]
        misses.append(np.sqrt(np.mean(depth_misses(found, rig, 2.0) ** 2)))
        stated.append(sigmas[0])
    assert np.sqrt(np.mean((np.array(misses) / np.array(stated)) ** 2)) < 2.0
