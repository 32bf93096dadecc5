"""Key points of a made-up bottom, seen by a made-up rig: measurements with known noise, descriptors without doubt."""

from __future__ import annotations

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.track.keypoints import Keypoints, RigError
from uw_recon_ros.track.relate import projected
from uw_recon_ros.types import Matrix, StereoGeometry

GEOMETRY = StereoGeometry(500.0, 320.0, 320.0, 240.0, 0.12)


def bottom(rng: np.random.Generator, count: int = 600, relief_m: float = 0.15) -> Matrix:
    """(N, 3) points about 1.25 m before a camera at the identity."""
    return np.column_stack([rng.uniform(-0.8, 0.8, (count, 2)), 1.25 + relief_m * rng.standard_normal(count)])


def descriptors(rng: np.random.Generator, count: int) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    found = np.abs(rng.standard_normal((count, 128)))
    return (found / np.linalg.norm(found, axis=1, keepdims=True)).astype(np.float32)


def seen(
    points: Matrix, pose: Matrix, names: np.ndarray, rng: np.random.Generator, *, pixel: float = 0.35,
    sigma: float = 0.1, truth: RigError | None = None, geometry: StereoGeometry = GEOMETRY,
) -> Keypoints:  # fmt: skip
    """What a camera at `pose` (world <- camera) measures; `truth`: what the rig is really off by."""
    there = rigid.inverse(pose)
    measured = projected(points @ there[:3, :3].T + there[:3, 3], geometry, truth or RigError())
    noise = rng.standard_normal(measured.shape) * (pixel, pixel, sigma)
    return Keypoints(measured + noise, np.full(len(points), sigma), names)


def motion(*twist: float) -> Matrix:
    return rigid.exp(np.array(twist))
