"""The stage: disparity -> depth -> clouds and a textured surface (paper sections 2.3 and 3)."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal, cast

import numpy as np

from uw_recon_ros.params import Params, param
from uw_recon_ros.reconstruct.cloud import organised_cloud, thin_cloud
from uw_recon_ros.reconstruct.depth_filter import remove_speckles, sigma_after_smoothing, smooth_disparity
from uw_recon_ros.reconstruct.surface import build_surface
from uw_recon_ros.reconstruct.triangulation import triangulate
from uw_recon_ros.types import (
    ByteImage,
    DepthMap,
    DisparityMap,
    PointCloud,
    RectifiedPair,
    Status,
    StereoGeometry,
    Surface,
    named_frame,
)

TEXTURES = ("enhanced", "matching")


@dataclass(frozen=True)
class ReconstructParams(Params):
    """What the reconstruction can be told. The defaults are those of ``test/benchmark/reconstruct_defaults.py``."""

    cloud_frame: str = param(
        "optical",
        "Frame of clouds and surface: the left camera's own, or the rectified view's.",
        choices=("optical", "rectified"),
    )
    texture: str = param(
        "enhanced",
        "What colours clouds and surface: the enhanced picture, or what the matcher sees (gray, and no picture need "
        "be made).",
        choices=TEXTURES,
    )
    speckle_jump_px: float = param(
        1.0, "Neighbours whose disparities differ by more belong to different pieces.", unit="px", low=0.0, high=100.0
    )
    speckle_area_px: int = param(
        100, "Pieces of the disparity map smaller than this are removed; 0: none.", unit="px^2", low=0, high=1_000_000
    )
    depth_filter_levels: int = param(
        5, "Passes of the edge-preserving filter, each twice as wide as the last; 0: no filter.", low=0, high=8
    )
    depth_filter_sigmas: float = param(
        4.685,
        "Pixels further than this from a pixel's local plane do not influence it.",
        unit="sigma of the disparity",
        low=0.5,
        high=20.0,
    )
    max_relative_sigma: float = param(
        0.25, "A depth less certain than this share of itself counts as out of range.", low=0.001, high=1.0
    )
    cloud_min_range: float = param(
        0.1,
        "Nearest point of the filtered cloud, along the ray (unknown scale: in median depths).",
        unit="m",
        low=0.0,
        high=1000.0,
    )
    cloud_max_range: float = param(
        20.0,
        "Furthest point of the filtered cloud, along the ray (unknown scale: in median depths).",
        unit="m",
        low=0.01,
        high=1000.0,
    )
    cloud_voxel: float = param(
        0.02,
        "Edge of the voxels that hold one point each in the filtered cloud (unknown scale: in median depths).",
        unit="m",
        low=0.0001,
        high=10.0,
    )
    cloud_max_points: int = param(
        50_000, "Points in the filtered cloud at most; the voxels grow until it fits.", low=8, high=10_000_000
    )
    surface_max_vertices: int = param(20_000, "Vertices of the surface at most.", low=4, high=1_000_000)
    surface_tolerance_px: float = param(
        0.15,
        "The surface follows the depth map this closely, in disparity, as far as the vertices go.",
        unit="px",
        low=0.001,
        high=10.0,
    )
    surface_max_jump_px: float = param(
        1.0,
        "The surface breaks where the disparities of neighbouring pixels differ by more.",
        unit="px",
        low=0.01,
        high=100.0,
    )
    surface_max_gap_px: int = param(
        8,
        "Gaps up to this wide are covered where both sides lie on one surface; 0: none.",
        unit="px",
        low=0,
        high=100,
    )
    surface_max_obliqueness: float = param(
        85.0,
        "Triangles seen more obliquely than this are dropped, unless noise explains it.",
        unit="deg",
        low=1.0,
        high=90.0,
    )

    def check_together(self) -> None:
        """The range limits must leave a range."""
        if self.cloud_min_range >= self.cloud_max_range:
            raise ValueError(
                f"cloud_min_range, cloud_max_range: expected the first below the second, "
                f"got {self.cloud_min_range:g} and {self.cloud_max_range:g} m"
            )


@dataclass(frozen=True)
class Reconstruct:
    """Depth from disparity, and shapes from depth. Pure: the same input gives the same bits."""

    params: ReconstructParams = field(default_factory=ReconstructParams)

    def warm_up(self) -> None:
        """Have everything compiled that a call needs: a moment from the cache, a few seconds the first time ever."""
        geometry = StereoGeometry(32.0, 16.0, 16.0, 12.0)
        flat = np.full((24, 32), 8.0, np.float32)
        flat[8:12, 8:12] = np.nan
        depth = self.depth(DisparityMap(flat, flat * np.float32(0.02), np.zeros(flat.shape, np.uint8), 0, 9, geometry))
        left = np.zeros((*flat.shape, 3), np.uint8)
        self.filtered_cloud(depth, left)
        self.surface(depth, left)

    def depth(self, disparity: DisparityMap) -> DepthMap:
        """Filter for spatial coherence, then triangulate (paper eq. 18).

        Parameters
        ----------
        disparity : DisparityMap

        Returns
        -------
        DepthMap
            In m, or in baselines where the scale is unknown. `sigma` is the matcher's, less what the filter took away,
            propagated.

        Raises
        ------
        ValueError
            The arrays differ in shape.
        """
        _check_shapes(disparity=disparity.disparity, sigma=disparity.sigma, status=disparity.status)
        p = self.params
        kept, speckles = remove_speckles(
            disparity.disparity, max_jump_px=p.speckle_jump_px, min_area_px=p.speckle_area_px
        )
        smooth = smooth_disparity(kept, disparity.sigma, levels=p.depth_filter_levels, sigmas=p.depth_filter_sigmas)
        status = disparity.status | np.where(speckles, np.uint8(Status.FILTERED), np.uint8(0))
        left = sigma_after_smoothing(disparity.sigma, kept, smooth)
        depth, sigma, status = triangulate(smooth, left, status, disparity.geometry, p.max_relative_sigma)
        return DepthMap(depth, sigma, status, disparity.geometry, disparity.stamp_ns, disparity.frame_id)

    def texture(self, pair: RectifiedPair) -> ByteImage:
        """What of a pair colours clouds and surface."""
        return pair.left if self.params.texture == TEXTURES[0] else pair.left_matching

    def cloud(self, depth: DepthMap, left: ByteImage, *, normals: bool = True) -> PointCloud:
        """One point a pixel; NaN where there is no depth.

        Parameters
        ----------
        depth : DepthMap
        left : (H, W, 3) or (H, W) uint8
            Left rectified view.
        normals : bool
            Messages have none.

        Raises
        ------
        ValueError, TypeError
            `left` is not an image of the depth map's size.
        """
        return organised_cloud(depth, _colors(depth, left), self._frame, normals=normals)

    def filtered_cloud(self, depth: DepthMap, left: ByteImage) -> PointCloud:
        """A dense cloud: range-limited, one point a voxel, bounded in number. Raises as `cloud`."""
        return self.thin(self.cloud(depth, left))

    def thin(self, cloud: PointCloud) -> PointCloud:
        """The same from an organised cloud that is there already."""
        p, unit = self.params, _unit_length(cloud)
        return thin_cloud(
            cloud,
            min_range=p.cloud_min_range * unit,
            max_range=p.cloud_max_range * unit,
            voxel=p.cloud_voxel * unit,
            max_points=p.cloud_max_points,
        )

    def surface(self, depth: DepthMap, left: ByteImage) -> Surface:
        """A textured triangle mesh that bridges no discontinuity. Raises as `cloud`."""
        p = self.params
        surface = build_surface(
            depth,
            _colors(depth, left),
            frame=self._frame,
            max_vertices=p.surface_max_vertices,
            tolerance_px=p.surface_tolerance_px,
            max_jump_px=p.surface_max_jump_px,
            max_gap_px=p.surface_max_gap_px,
            max_obliqueness_deg=p.surface_max_obliqueness,
            min_area_px=p.speckle_area_px,
        )
        return replace(surface, frame_id=named_frame(depth.frame_id, self._frame))

    @property
    def _frame(self) -> Literal["optical", "rectified"]:
        return cast(Literal["optical", "rectified"], self.params.cloud_frame)


def _unit_length(cloud: PointCloud) -> float:
    """What counts as one metre: the metre, or the median depth where the scale is unknown."""
    depths = cloud.points[..., 2]
    if cloud.metric or not np.isfinite(depths).any():
        return 1.0
    return float(np.nanmedian(depths))


def _check_shapes(**arrays: np.ndarray) -> None:
    shapes = {name: array.shape for name, array in arrays.items()}
    if len(set(shapes.values())) > 1 or any(len(shape) != 2 or 0 in shape for shape in shapes.values()):
        text = ", ".join(f"{name} {shape}" for name, shape in shapes.items())
        raise ValueError(f"expected (H, W) arrays of one shape, got {text}")


def _colors(depth: DepthMap, left: ByteImage) -> ByteImage:
    _check_shapes(depth=depth.depth, sigma=depth.sigma, status=depth.status)
    if left.dtype != np.uint8:
        raise TypeError(f"left: expected a uint8 image, got {left.dtype}")
    if left.shape[:2] != depth.depth.shape or left.shape[2:] not in ((), (3,)):
        raise ValueError(f"left: expected {(*depth.depth.shape, 3)} as the depth map, got {left.shape}")
    return left if left.ndim == 3 else np.repeat(left[..., None], 3, axis=2)
