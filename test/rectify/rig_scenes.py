"""Stereo rigs of known truth: cameras, points in front of them, and what they see of those points."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Array = NDArray[np.float64]
NO_DISTORTION = np.zeros(5)


@dataclass(frozen=True, eq=False)
class Camera:
    """``x_camera = rotation @ x_world + translation``, then `k`, with the distortion written out by hand here."""

    k: Array
    rotation: Array
    translation: Array
    d: Array = field(default_factory=NO_DISTORTION.copy)
    model: str = "plumb_bob"

    def project(self, points: Array) -> Array:
        x, y, z = (points @ self.rotation.T + self.translation).T
        x, y = distort(x / z, y / z, self.d, self.model)
        return np.column_stack([self.k[0, 0] * x + self.k[0, 2], self.k[1, 1] * y + self.k[1, 2]])


def distort(x: Array, y: Array, d: Array, model: str) -> tuple[Array, Array]:
    r2 = x * x + y * y
    if model == "equidistant":
        r = np.maximum(np.sqrt(r2), 1e-12)
        theta = np.arctan(r)
        scale = theta * (1 + d[0] * theta**2 + d[1] * theta**4 + d[2] * theta**6 + d[3] * theta**8) / r
        return x * scale, y * scale
    k1, k2, p1, p2, k3, k4, k5, k6 = [*d, *np.zeros(8 - len(d))]
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


@dataclass(frozen=True, eq=False)
class Rig:
    """A pair of cameras; the world is the left optical frame."""

    left: Camera
    right: Camera
    width: int
    height: int

    def see(self, points: Array, noise: float = 0.0, seed: int = 0) -> tuple[Array, Array, Array]:
        """Pixels in both images and the points, of those points that both images show."""
        left, right = self.left.project(points), self.right.project(points)
        rng = np.random.default_rng(seed)
        left, right = left + rng.normal(0, noise, left.shape), right + rng.normal(0, noise, right.shape)
        size = np.array([self.width - 1, self.height - 1])
        inside = ((left >= 0) & (left <= size) & (right >= 0) & (right <= size)).all(axis=1)
        return left[inside], right[inside], points[inside]


def intrinsics(width: int, height: int, focal: float) -> Array:
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


def make_rig(
    *,
    width: int = 640,
    height: int = 480,
    focal: float = 620.0,
    angles_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    center: tuple[float, float, float] = (0.15, 0.0, 0.0),
    d: Array = NO_DISTORTION,
    model: str = "plumb_bob",
) -> Rig:
    """The right camera stands at `center`, m, in the left optical frame, turned by `angles_deg` about x, y, z."""
    k = intrinsics(width, height, focal)
    rotation = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    right = Camera(k, rotation, -rotation @ np.array(center), d, model)
    return Rig(Camera(k, np.eye(3), np.zeros(3), d, model), right, width, height)


def random_rig(seed: int, *, angle_deg: float = 2.0, vertical: bool = False) -> Rig:
    """A rig as divers build them: cameras nearly side by side (or one above the other), nearly parallel."""
    rng = np.random.default_rng(seed)
    width, height = (640, 480) if rng.random() < 0.5 else (1280, 720)
    along, small = rng.uniform(0.08, 0.25), rng.normal(0, 0.03, 2)
    center = along * (np.array([small[0], 1, small[1]]) if vertical else np.array([1, small[0], small[1]]))
    angles = tuple(rng.normal(0, angle_deg, 3))
    return make_rig(
        width=width, height=height, focal=width * rng.uniform(0.7, 1.3), angles_deg=angles, center=tuple(center)
    )


def scatter(rig: Rig, count: int, near: float, far: float, seed: int = 0) -> Array:
    """`count` points spread over the left image, inverse depth uniform between `near` and `far`, m."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((0, 0), (rig.width - 1, rig.height - 1), (count, 2))
    depth = 1 / rng.uniform(1 / far, 1 / near, count)
    rays = np.column_stack([pixels, np.ones(count)]) @ np.linalg.inv(rig.left.k).T
    return rays * depth[:, None]
