"""Clouds: one point a pixel with its normal, and a thinned one for navigation."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.reconstruct.depth_filter import plausible_sigma
from uw_recon_ros.reconstruct.planes import fit_planes, flat_planes
from uw_recon_ros.reconstruct.triangulation import CloudFrame, normals_from_slopes, points_from_depth
from uw_recon_ros.types import ByteImage, DepthMap, FloatImage, Matrix, PointCloud, named_frame

_NORMAL_STEPS = (1, 1, 2)  # sample distances of the successive fits, px
_OCTANTS = 8
_SMALLEST_CELL = 2.0**-30  # of the range: cells are numbered by 32-bit integers
#: Voxels grow by at least this, and ever faster: points that no slightly larger voxel unites, such as a sparse lattice,
#: cost a dozen passes and not hundreds.
_GROWTH, _HASTE = 1.05, 1.5
_NORMAL_SIGMAS = 4.685  # Tukey's constant: 95 % efficient for Gaussian noise


def organised_cloud(
    depth: DepthMap, colors: ByteImage, frame: CloudFrame = "optical", *, normals: bool = True
) -> PointCloud:
    """One point a pixel, with normals of robust local planes.

    Parameters
    ----------
    depth : DepthMap
    colors : (H, W, 3) uint8
        RGB of the left rectified view.
    frame : {'optical', 'rectified'}
    normals : bool
        Without them it takes a tenth of the time.

    Returns
    -------
    PointCloud
        Organised; NaN where there is no depth. Its frame is named after `frame`.
    """
    points = points_from_depth(depth.depth, depth.geometry, frame)
    name = named_frame(depth.frame_id, frame)
    found = _normals(depth, frame) if normals else None
    return PointCloud(points, colors, found, depth.geometry.metric, depth.stamp_ns, name)


def _normals(depth: DepthMap, frame: CloudFrame) -> FloatImage:
    geometry = depth.geometry
    with np.errstate(divide="ignore", invalid="ignore"):
        level = np.float32(geometry.focal_times_baseline) / depth.depth
        sigma = depth.sigma / np.square(depth.depth) * np.float32(abs(geometry.focal_times_baseline))
    planes, band = flat_planes(level), np.float32(_NORMAL_SIGMAS) * plausible_sigma(sigma)
    for step in _NORMAL_STEPS:
        planes = fit_planes(planes, band, step)
    return normals_from_slopes(planes.value, planes.slope_u, planes.slope_v, geometry, frame)


def thin_cloud(cloud: PointCloud, *, min_range: float, max_range: float, voxel: float, max_points: int) -> PointCloud:
    """A dense cloud for costmaps and the like: range-limited, one point a voxel, bounded in number.

    Parameters
    ----------
    cloud : PointCloud
        Organised or not; points with NaN are left out.
    min_range, max_range : float
        Limits of the distance along the ray, in the unit of the points.
    voxel : float
        Edge of the voxels; enlarged until no more than `max_points` are occupied, in a number of passes that grows with
        the logarithm of the logarithm of what is missing.
    max_points : int
        At least 8, for the voxels meet at the origin.

    Returns
    -------
    PointCloud
        (N, 3) without NaN. A point is the mean of those in its voxel, and so are colour and normal, if any.
    """
    if not voxel > 0 or max_points < _OCTANTS or not np.isfinite(max_range):
        raise ValueError(
            f"voxel, max_points, max_range: expected > 0, >= {_OCTANTS} and finite, "
            f"got {voxel}, {max_points} and {max_range}"
        )
    points, colors, normals = _within_range(cloud, min_range, max_range)
    attributes: list[NDArray[Any]] = [points, colors] if normals is None else [points, colors, normals]
    voxel, growth = max(voxel, max_range * _SMALLEST_CELL), _GROWTH
    while True:
        slots, count = _occupied(np.floor(points / voxel).astype(np.int32))
        if count <= max_points:
            break
        voxel *= max(growth, np.sqrt(count / max_points))
        growth **= _HASTE
    mean, mean_color, *mean_normal = _means(attributes, slots, count)
    return PointCloud(
        mean.astype(np.float32), np.rint(mean_color).astype(np.uint8),
        _unit(mean_normal[0]).astype(np.float32) if mean_normal else None,
        cloud.metric, cloud.stamp_ns, cloud.frame_id,
    )  # fmt: skip


def _within_range(cloud: PointCloud, low: float, high: float) -> tuple[FloatImage, ByteImage, FloatImage | None]:
    points = cloud.points.reshape(-1, 3)
    normals = None if cloud.normals is None else cloud.normals.reshape(-1, 3)
    with np.errstate(invalid="ignore"):
        squared = np.einsum("ij,ij->i", points, points)
        keep = (squared >= low * low) & (squared <= high * high)
    if normals is not None:
        keep &= np.isfinite(normals[:, 0])
    at = np.flatnonzero(keep)
    colors = cloud.colors.reshape(-1, 3).take(at, axis=0)
    return points.take(at, axis=0), colors, None if normals is None else normals.take(at, axis=0)


def _means(attributes: list[NDArray[Any]], slots: NDArray[np.int32], count: int) -> list[Matrix]:
    """Mean of each attribute (N, 3) over the points of each slot."""
    sums = [np.zeros((count, 3)) for _ in attributes]
    for values, total in zip(attributes, sums, strict=True):
        _add_up(np.ascontiguousarray(values, np.float32), slots, total)
    number = np.bincount(slots, minlength=count)[:, None]
    return [total / number for total in sums]


@kernel
def _add_up(values: FloatImage, slots: NDArray[np.int32], total: Matrix) -> None:
    """Add each row of values (N, 3) to that of its slot."""
    for i in range(len(values)):
        for axis in range(3):
            total[slots[i], axis] += values[i, axis]


def _unit(vectors: Matrix) -> Matrix:
    lengths: Matrix = np.linalg.norm(vectors, axis=1, keepdims=True)
    units: Matrix = vectors / np.maximum(lengths, np.finfo(np.float64).tiny)
    return units


def _occupied(cells: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
    slots = np.empty(len(cells), np.int32)
    return slots, _number_cells(cells, slots)


@kernel
def _number_cells(cells: NDArray[np.int32], slots: NDArray[np.int32]) -> int:
    """Number the distinct rows of `cells` in order of appearance: an open-addressing hash table.

    The hash ends as SplitMix64 does (Steele, Lea and Flood, 2014): cells in regular patterns must not share their low
    bits, or the search for a free slot becomes a walk through the table.
    """
    size = 16
    while size < 2 * len(cells):
        size *= 2
    table = np.full(size, -1, np.int32)  # index of a cell's first point
    count = 0
    for i in range(len(cells)):
        x, y, z = cells[i, 0], cells[i, 1], cells[i, 2]
        h = (np.uint64(x) * np.uint64(73856093)) ^ (np.uint64(y) * np.uint64(19349663)) ^ (np.uint64(z) * np.uint64(83492791))  # fmt: skip  # noqa: E501
        h = (h ^ (h >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        h = (h ^ (h >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        h = (h ^ (h >> np.uint64(31))) & np.uint64(size - 1)
        while table[h] >= 0:
            j = table[h]
            if cells[j, 0] == x and cells[j, 1] == y and cells[j, 2] == z:
                break
            h = (h + np.uint64(1)) & np.uint64(size - 1)
        if table[h] < 0:
            table[h] = i
            slots[i] = count
            count += 1
        else:
            slots[i] = slots[table[h]]
    return count
