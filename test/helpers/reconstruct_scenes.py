"""Scenes of known truth, by ray casting in the left rectified view: planes, spheres, steps."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.types import DepthMap, DisparityMap, StereoGeometry

HEIGHT, WIDTH = 120, 160
HORIZONTAL = StereoGeometry(150.0, 81.0, 84.5, 58.0, baseline_m=0.1, focal_across_px=152.0)
VERTICAL = StereoGeometry(150.0, 58.0, 55.0, 81.0, baseline_m=0.1, axis="vertical", focal_across_px=148.0)
ABOVE = StereoGeometry(150.0, 58.0, 61.0, 81.0, baseline_m=-0.1, axis="vertical")
GEOMETRIES = {"horizontal": HORIZONTAL, "vertical": VERTICAL, "above": ABOVE}


def rays(geometry: StereoGeometry, height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """(H, W, 3) with z = 1."""
    v, u = np.mgrid[:height, :width].astype(np.float64)
    k = geometry.intrinsics_left
    return np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones_like(u)], axis=-1)


def plane_depth(geometry: StereoGeometry, normal: tuple[float, float, float], distance: float) -> np.ndarray:
    """Depth of the plane normal . X = distance (normal away from the camera)."""
    unit = np.array(normal) / np.linalg.norm(normal)
    return distance / (rays(geometry) @ unit)


def sphere_depth(geometry: StereoGeometry, centre: tuple[float, float, float], radius: float) -> np.ndarray:
    """Depth of a sphere's near side; inf beside it."""
    ray, c = rays(geometry), np.array(centre)
    a, b = (ray * ray).sum(-1), ray @ c
    discriminant = b * b - a * (c @ c - radius * radius)
    with np.errstate(invalid="ignore"):
        return np.where(discriminant > 0, (b - np.sqrt(discriminant)) / a, np.inf)


def disparity_map(
    depth: np.ndarray, geometry: StereoGeometry, noise_px: float = 0.0, sigma_px: float = 0.1, seed: int = 0
) -> DisparityMap:
    """What a matcher would have found, with noise."""
    fb = geometry.focal_px * (geometry.baseline_sign if geometry.baseline_m is None else geometry.baseline_m)
    disparity = fb / depth - (geometry.cx_right - geometry.cx_left)
    disparity = (disparity + np.random.default_rng(seed).normal(0, 1, depth.shape) * noise_px).astype(np.float32)
    valid = np.isfinite(disparity)
    status = np.where(valid, 0, 1).astype(np.uint8)
    sigma = np.where(valid, np.float32(sigma_px), np.float32(np.nan))
    return DisparityMap(disparity, sigma, status, 0, 64, geometry, stamp_ns=123, frame_id="left_optical_frame")


def depth_map(depth: np.ndarray, geometry: StereoGeometry, sigma_px: float = 0.1) -> DepthMap:
    """The truth as a depth map."""
    depth = np.where(np.isfinite(depth), depth, np.nan).astype(np.float32)
    sigma = geometry.depth_sigma(depth, np.full(depth.shape, sigma_px, np.float32))
    status = np.where(np.isfinite(depth), 0, 1).astype(np.uint8)
    return DepthMap(depth, sigma, status, geometry, stamp_ns=123, frame_id="left_optical_frame")


def picture(height: int = HEIGHT, width: int = WIDTH) -> np.ndarray:
    """(H, W, 3) uint8 with a different colour at every pixel."""
    v, u = np.mgrid[:height, :width]
    return np.stack([u % 256, v % 256, (u + 3 * v) % 256], axis=-1).astype(np.uint8)
