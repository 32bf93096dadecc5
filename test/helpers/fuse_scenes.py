"""Views of a sphere and of a plane whose depth is known exactly."""

from __future__ import annotations

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.fuse.blocks import View, touched_blocks
from uw_recon_ros.fuse.extract import FusedMesh
from uw_recon_ros.fuse.tiles import Fusion, fuse
from uw_recon_ros.types import Matrix

WIDTH, HEIGHT, FOCAL = 160, 120, 140.0
CENTRE = np.array([(WIDTH - 1) / 2, (HEIGHT - 1) / 2])
HOW = Fusion(0.01, 0.04, 0.02, tile_m=100.0)


def rays(pose: Matrix) -> Matrix:
    v, u = np.mgrid[:HEIGHT, :WIDTH]
    local = np.stack([(u - CENTRE[0]) / FOCAL, (v - CENTRE[1]) / FOCAL, np.ones((HEIGHT, WIDTH))], axis=-1)
    return local @ pose[:3, :3].T


def view_of(depth: Matrix, pose: Matrix, sigma: float = 0.002, gray: int = 128) -> View:
    color = np.full((HEIGHT, WIDTH, 3), gray, np.uint8)
    sigmas = np.full((HEIGHT, WIDTH), sigma, np.float32)
    return View(depth.astype(np.float32), sigmas, color, pose, np.array([FOCAL, FOCAL, *CENTRE]))


def sphere_view(pose: Matrix, radius: float, middle: Matrix | None = None) -> View:
    along, start = rays(pose), pose[:3, 3] - (np.zeros(3) if middle is None else middle)
    a, b, c = (along**2).sum(axis=-1), along @ start, start @ start - radius**2
    square = b * b - a * c
    depth = np.where(square > 0, (-b - np.sqrt(np.maximum(square, 0))) / a, np.nan)
    return view_of(depth, pose)


def plane_view(pose: Matrix, height: float = 0.0, **more: float) -> View:
    """Of the plane z = `height`."""
    return view_of((height - pose[2, 3]) / rays(pose)[..., 2], pose, **more)  # type: ignore[arg-type]


def looking_in(radius: float, turn: Matrix | None = None) -> list[View]:
    """A sphere from six sides; `turn` (4, 4) moves all of it."""
    moved = np.eye(4) if turn is None else turn
    views = []
    for axis in ([0, 0, 0], [0, np.pi / 2, 0], [0, np.pi - 1e-6, 0], [0, -np.pi / 2, 0], [np.pi / 2, 0, 0],
                 [-np.pi / 2, 0, 0]):  # fmt: skip
        pose = rigid.exp(np.r_[0.0, 0.0, 0.0, axis])
        pose[:3, 3] = -pose[:3, 2]
        views.append(sphere_view(moved @ pose, radius, moved[:3, 3]))
    return views


def looking_down(x: float, y: float = 0.0, z: float = 1.0, tilt: float = 0.0) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3] = np.diag([1.0, -1.0, -1.0])
    pose = pose @ rigid.exp(np.array([0.0, 0.0, 0.0, tilt, 0.0, 0.0]))
    pose[:3, 3] = x, y, z
    return pose


def fused(views: list[View], how: Fusion = HOW) -> FusedMesh:
    touched = [touched_blocks(view, how.voxel_m, how.truncation_m, how.max_sigma_m) for view in views]
    mesh = fuse(lambda k: views[k], touched, how)
    assert mesh is not None
    return mesh
