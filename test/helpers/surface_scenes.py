"""A plane with a ball on it, seen from anywhere: depth and colour known in closed form."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.fuse.blocks import touched_blocks
from uw_recon_ros.fuse.frame import PosedFrame, view_of
from uw_recon_ros.fuse.integrate import Volume, empty_volume
from uw_recon_ros.fuse.layout import band_of
from uw_recon_ros.fuse.marching_cubes import Patch, extract
from uw_recon_ros.types import ByteImage, FloatImage, Matrix, StereoGeometry

WIDTH, HEIGHT = 96, 72
GEOMETRY = StereoGeometry(90.0, (WIDTH - 1) / 2, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, 0.1)
RADIUS = 0.3
NOWHERE = np.array([0.0, 0.0, -50.0])


@dataclass(frozen=True, eq=False)
class Ground:
    """A plane z = 0, if there is one, and balls (centres and radii)."""

    balls: tuple[tuple[Matrix, float], ...] = ()
    plane: bool = True


def looking_down(x: float, y: float, height: float = 1.0, turn: float = 0.0) -> Matrix:
    """Pose of a camera over the plane, the top of its picture to the north (turned by `turn`, rad)."""
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = x, y, height
    return pose @ rigid.exp(np.array([0, 0, 0, 0.02, -0.03, turn]))


def looking_at_origin(direction: Matrix, distance: float = 1.0) -> Matrix:
    ahead = -direction / np.linalg.norm(direction)
    across = np.cross(ahead, [0.31, 0.52, 0.11])
    across /= np.linalg.norm(across)
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = np.stack([across, np.cross(ahead, across), ahead], axis=1), -distance * ahead
    return pose


def rays(pose: Matrix) -> Matrix:
    """(H, W, 3) in the world, of depth 1."""
    u, v = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    g = GEOMETRY
    return np.stack([(u - g.cx_left) / g.focal_px, (v - g.cy) / g.focal_px, np.ones(u.shape)], -1) @ pose[:3, :3].T


def true_depth(ground: Ground, pose: Matrix) -> FloatImage:
    ray, start = rays(pose), pose[:3, 3]
    depth = np.full(ray.shape[:2], np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        if ground.plane:
            hit = -start[2] / ray[..., 2]
            depth = np.where(hit > 0, hit, depth)
        for center, radius in ground.balls:
            b, square = ray @ (start - center), (ray**2).sum(axis=-1)
            root = np.sqrt(b * b - square * ((start - center) @ (start - center) - radius**2))
            hit = (-b - root) / square
            depth = np.where(np.isfinite(hit) & (hit > 0) & (hit < depth), hit, depth)
    return np.where(np.isfinite(depth), depth, np.nan).astype(np.float32)


def paint(points: Matrix) -> Matrix:
    """(..., 3) colour of places, 60 to 200, smooth over some centimetres."""
    x, y = points[..., 0], points[..., 1]
    waves = [np.sin(11 * x + 3 * y), np.sin(7 * y - 5 * x + 1), np.cos(9 * x + 8 * y)]
    return 130 + 60 * np.stack(waves, axis=-1)


def photo(ground: Ground, pose: Matrix, gain: Matrix | float = 1.0) -> ByteImage:
    points = pose[:3, 3] + rays(pose) * true_depth(ground, pose)[..., None]
    return np.rint(np.nan_to_num(paint(points) * gain).clip(0, 255)).astype(np.uint8)


def taken(
    ground: Ground, pose: Matrix, *, noise_m: float = 0.0, sigma_m: float = 0.003, seed: int = 0, number: int = 0,
    gain: Matrix | float = 1.0, world: Matrix | None = None,
) -> PosedFrame:  # fmt: skip
    """A frame; `world` is another world from that of the ground."""
    depth = true_depth(ground, pose)
    depth = depth + np.float32(noise_m) * np.random.default_rng([seed, number]).standard_normal(depth.shape)
    sigma = np.full(depth.shape, sigma_m, np.float32)
    told = pose if world is None else world @ pose
    g = GEOMETRY
    lens = np.array([g.focal_px, g.focal_px, g.cx_left, g.cy])
    return PosedFrame(1000 * number, photo(ground, pose, gain), depth.astype(np.float32), sigma, lens, told)


def fused(frames: Sequence[PosedFrame], voxel: float) -> tuple[Volume, Patch]:
    band = band_of(voxel, 3.0)
    views = [view_of(frame) for frame in frames]
    volume = empty_volume(np.unique(np.concatenate([touched_blocks(view, voxel, band) for view in views])), voxel)
    for view in views:
        volume.add(view, band)
    return volume, extract(volume)


def around(count: int = 40) -> list[Matrix]:
    """Poses evenly around the origin (a Fibonacci lattice)."""
    k = np.arange(count) + 0.5
    z, angle = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    flat = np.sqrt(1 - z * z)
    return [looking_at_origin(np.array(d)) for d in zip(flat * np.cos(angle), flat * np.sin(angle), z, strict=True)]
