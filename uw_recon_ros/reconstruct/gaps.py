"""Small gaps in a depth map that lie within one surface, as its two sides tell."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.reconstruct.planes import Planes
from uw_recon_ros.types import FloatImage

_DIRECTIONS = np.array([[1, 0], [0, 1], [1, 1], [1, -1]], np.int32)  # (du, dv); each with its opposite


def close_gaps(planes: Planes, max_gap_px: int, max_jump_px: float) -> FloatImage:
    """Interpolate invalid pixels between two sides of one surface.

    An invalid pixel is closed when, in at least one of four directions, measured pixels on both its sides lie at most
    `max_gap_px` pixels apart and the mean slope of the two leads from one to the other within `max_jump_px`, and when
    there is no direction in which two such pixels disagree: beside a discontinuity some do.

    Parameters
    ----------
    planes : Planes
        Disparity with slopes; NaN = invalid.
    max_gap_px : int
        Invalid pixels between two measured ones at most; 0: nothing is closed.
    max_jump_px : float

    Returns
    -------
    (H, W) float32
        The disparities with the closed pixels added.
    """
    closed: FloatImage = planes.value.copy()
    if max_gap_px > 0:
        _close(planes.value, planes.slope_u, planes.slope_v, _DIRECTIONS, max_gap_px, max_jump_px, closed)
    return closed


@kernel
def _measured(value: FloatImage, u: int, v: int, du: int, dv: int, most: int) -> int:
    """Steps from (u, v) along (du, dv) to the first valid pixel; 0: none within `most`."""
    for step in range(1, most + 1):
        u, v = u + du, v + dv
        if u < 0 or v < 0 or u >= value.shape[1] or v >= value.shape[0]:
            return 0
        if not np.isnan(value[v, u]):
            return step
    return 0


@kernel
def _close(
    value: FloatImage,
    slope_u: FloatImage,
    slope_v: FloatImage,
    directions: NDArray[np.int32],
    max_gap: int,
    max_jump: float,
    closed: FloatImage,
) -> None:
    for v in range(value.shape[0]):
        for u in range(value.shape[1]):
            if not np.isnan(value[v, u]):
                continue
            total, weights, agree = 0.0, 0.0, True
            for k in range(len(directions)):
                du, dv = directions[k, 0], directions[k, 1]
                ahead = _measured(value, u, v, du, dv, max_gap)
                behind = _measured(value, u, v, -du, -dv, max_gap)
                length = ahead + behind
                if ahead == 0 or behind == 0 or length > max_gap + 1:
                    continue
                u0, v0, u1, v1 = u - behind * du, v - behind * dv, u + ahead * du, v + ahead * dv
                rise = value[v1, u1] - value[v0, u0]
                slope = du * (slope_u[v0, u0] + slope_u[v1, u1]) + dv * (slope_v[v0, u0] + slope_v[v1, u1])
                agree = agree and abs(rise - 0.5 * slope * length) <= max_jump
                weight = 1.0 / (length * length * (du * du + dv * dv))
                total += weight * (value[v0, u0] + rise * behind / length)
                weights += weight
            if agree and weights > 0.0:
                closed[v, u] = total / weights
