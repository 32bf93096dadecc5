"""Clouds as LAZ (ASPRS LAS, compressed by lazrs), written by laspy, an extra."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np

from uw_recon_ros.errors import ReconError
from uw_recon_ros.types import PointCloud

_LAZ_STEP_M = 1e-4


def write_laz(path: Path, cloud: PointCloud) -> None:
    """Write the points of a cloud as LAZ 1.4, point format 7, in steps of 0.1 mm.

    Raises
    ------
    ReconError
        The extra ``laz`` is not installed.
    """
    try:
        import laspy
    except ImportError as error:
        text = "cloud_format laz: expected the extra 'laz': pip install '.[laz]' in the sources' folder"
        raise ReconError(text) from error
    points, colors = cloud.points.reshape(-1, 3), cloud.colors.reshape(-1, 3)
    there = np.isfinite(points).all(axis=1)
    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales, header.offsets = np.full(3, _LAZ_STEP_M), np.zeros(3)
    header.generating_software = "uw_recon_ros"
    header.creation_date = datetime.datetime.fromtimestamp(cloud.stamp_ns // 10**9, datetime.timezone.utc).date()
    las = laspy.LasData(header)
    las.x, las.y, las.z = points[there].astype(np.float64).T
    las.red, las.green, las.blue = colors[there].astype(np.uint16).T * np.uint16(257)
    las.write(str(path), do_compress=True)
