"""Which points of the surface a picture shows: inside it, and not behind something that its depth map knows of."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.frame import View
from uw_recon_ros.types import Matrix

_SIGMAS = 4.0


def in_sight(points: Matrix, view: View, tolerance: float) -> tuple[NDArray[np.int64], Matrix, Matrix]:
    """Indices and pixels u, v of the points (N, 3) whose depth the picture's own depth map confirms.

    Parameters
    ----------
    points : (N, 3) float64
        World, m.
    view : View
    tolerance : float
        m, beside some sigmas.
    """
    x, y, z = view.motion[:, :3] @ points.T + view.motion[:, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = view.lens[0] * x / z + view.lens[2], view.lens[1] * y / z + view.lens[3]
    rows, columns = view.depth.shape
    which = np.flatnonzero((z > 0) & (u >= 0) & (v >= 0) & (u <= columns - 1) & (v <= rows - 1))
    pixel = np.rint(v[which]).astype(int), np.rint(u[which]).astype(int)
    with np.errstate(invalid="ignore"):
        agrees = np.abs(view.depth[pixel] - z[which]) <= tolerance + _SIGMAS * view.sigma[pixel]
    which = which[agrees].astype(np.int64)
    return which, u[which], v[which]
