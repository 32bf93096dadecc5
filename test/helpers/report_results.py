"""One small reconstructed pair, made up: what the page's functions are given."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.types import (
    DepthMap,
    DisparityMap,
    EnhancedPair,
    RectificationQuality,
    RectifiedPair,
    Status,
    StereoGeometry,
    StereoPair,
    Surface,
)

HEIGHT, WIDTH = 48, 64


def geometry(metric: bool = True, axis: str = "horizontal") -> StereoGeometry:
    return StereoGeometry(60.0, 32.0, 32.0, 24.0, baseline_m=0.1 if metric else None, axis=axis)  # type: ignore[arg-type]


def picture(seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)


def disparity_map(metric: bool = True) -> DisparityMap:
    disparity = np.tile(np.linspace(3, 6, WIDTH, dtype=np.float32), (HEIGHT, 1))
    status = np.zeros((HEIGHT, WIDTH), np.uint8)
    for rows, reason in ((slice(0, 4), Status.OCCLUDED), (slice(4, 10), Status.OUTSIDE)):
        disparity[rows], status[rows] = np.nan, reason
    sigma = np.where(np.isfinite(disparity), np.float32(0.2), np.float32(np.nan))
    return DisparityMap(disparity, sigma, status, 0, 16, geometry(metric), "kz2", -1234.0)


def depth_map(metric: bool = True) -> DepthMap:
    source = disparity_map(metric)
    depth = source.geometry.depth_from_disparity(source.disparity)
    return DepthMap(depth, source.geometry.depth_sigma(depth, source.sigma), source.status, source.geometry)


def surface(metric: bool = True, side: int = 9) -> Surface:
    v, u = np.mgrid[:side, :side] / (side - 1)
    vertices = np.stack([u - 0.5, v - 0.5, 2 + 0.3 * np.sin(4 * u)], axis=-1).reshape(-1, 3).astype(np.float32)
    index = np.arange(side * side).reshape(side, side)
    a, b, c, d = index[:-1, :-1].ravel(), index[:-1, 1:].ravel(), index[1:, :-1].ravel(), index[1:, 1:].ravel()
    faces = np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, d], 1)]).astype(np.int32)
    normals = np.tile(np.float32([0, 0, -1]), (side * side, 1))
    uv = np.stack([u.ravel(), 1 - v.ravel()], axis=1).astype(np.float32)
    colors = np.full((side * side, 3), 90, np.uint8)
    return Surface(vertices, faces, normals, uv, colors, picture(3), metric)


def pair_results(metric: bool = True, axis: str = "horizontal"):
    """The arguments of ``write_pair_page`` after the path, up to the surface."""
    left, right = picture(1), picture(2)
    flat = Finding(Code.RECTIFY_FLAT_SCENE, "a flat scene <b>does</b> not fix F")
    quality = RectificationQuality("quasi-euclidean", 0.21, 0.8, 321, (flat,))
    return (
        StereoPair(left[..., 0], right[..., 0]),
        EnhancedPair(left, right, left[..., 0], right[..., 0]),
        RectifiedPair(left, right, left[..., 0], right[..., 0], geometry(metric, axis), quality),
        disparity_map(metric),
        depth_map(metric),
        surface(metric),
    )
