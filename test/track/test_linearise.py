"""The equations of a motion from matches: whitening against noise."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros import rigid
from uw_recon_ros.track.keypoints import RigError, points_of
from uw_recon_ros.track.relate import KeyPointMatches, linearise, projected
from uw_recon_ros.types import Matrix, StereoGeometry

GEOMETRY = StereoGeometry(500.0, 320.0, 318.0, 240.0, 0.12, focal_across_px=510.0)
MOTION = rigid.exp(np.array([0.1, 0.02, 0.03, 0.05, -0.04, 0.1]))
RIG = RigError(0.2, 0.01)
SIGMA_PX = 0.3


def predicted(first: Matrix, motion: Matrix) -> Matrix:
    """u, v, disparity in the second frame."""
    points = points_of(first, GEOMETRY, RIG)
    return projected(points @ motion[:3, :3].T + motion[:3, 3], GEOMETRY, RIG)


def drawn(count: int, noise: float = 0.0) -> KeyPointMatches:
    """Matches that fit `MOTION`, with noise of the sizes that they state."""
    rng = np.random.default_rng(3)
    true = np.column_stack([rng.uniform(0, 640, count), rng.uniform(0, 480, count), rng.uniform(20, 60, count)])
    sigmas = rng.uniform(0.06, 0.4, (2, count))
    ends = []
    for end, sigma in zip((true, predicted(true, MOTION)), sigmas, strict=True):
        scale = np.column_stack([np.full(count, SIGMA_PX), np.full(count, SIGMA_PX), sigma])
        ends.append(end + noise * scale * rng.standard_normal((count, 3)))
    return KeyPointMatches(*ends, *sigmas)


def test_noise_of_the_stated_size_becomes_white() -> None:
    residuals = linearise(MOTION, drawn(20_000, noise=1.0), GEOMETRY, RIG, SIGMA_PX).residuals
    assert residuals.T @ residuals / len(residuals) == pytest.approx(np.eye(3), abs=0.05)


def test_a_point_behind_the_camera_fits_nothing() -> None:
    away = rigid.exp(np.array([0.0, 0.0, -50.0, 0.0, 0.0, 0.0]))
    assert np.isinf(linearise(away, drawn(5), GEOMETRY, RIG, SIGMA_PX).squares).all()
