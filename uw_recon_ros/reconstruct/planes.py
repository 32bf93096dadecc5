"""Local planes: the robust fit that both the depth filter and the normals are made of.

A plane in space is a plane in disparity over the image (``1/Z`` is affine in u and v), and a matcher's noise is uniform
in disparity. So every fit here is made on disparities, never on depths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage


@dataclass(frozen=True, eq=False)
class Planes:
    """A plane at every pixel.

    Parameters
    ----------
    value : (H, W) float32
        Disparity at the pixel, px; NaN = invalid.
    slope_u, slope_v : (H, W) float32
        Its derivatives, px per px; 0 where invalid.
    support : (H, W) float32
        Sum of the weights of the last fit (1 = the pixel stood alone).
    """

    value: FloatImage
    slope_u: FloatImage
    slope_v: FloatImage
    support: FloatImage


def flat_planes(disparity: FloatImage) -> Planes:
    """Planes without slope through `disparity`: what a first fit starts from."""
    zeros = np.zeros(disparity.shape, np.float32)
    support = np.isfinite(disparity).astype(np.float32)
    return Planes(np.ascontiguousarray(disparity, np.float32), zeros, zeros, support)


def fit_planes(planes: Planes, bandwidth: FloatImage, step: int = 1) -> Planes:
    """Fit a plane around every valid pixel to those neighbours that agree with its present plane.

    One step of iteratively reweighted least squares over 3x3 samples with Tukey's biweight: a neighbour further than
    `bandwidth` from the plane has no say, so that nothing is mixed across a discontinuity. Invalid pixels stay invalid.

    Parameters
    ----------
    planes : Planes
        Present planes.
    bandwidth : (H, W) float32
        Largest residual that counts, px.
    step : int
        Distance of neighbouring samples, px (the holes of an "a-trous" filter).
    """
    height, width = planes.value.shape
    padded = np.empty((2, height + 2 * step, width + 2 * step), np.float32)
    _lay_out(planes.value, step, padded)
    fitted = np.empty((4, height, width), np.float32)
    _fit(padded, planes.slope_u, planes.slope_v, bandwidth, step, fitted)
    return Planes(fitted[0], fitted[1], fitted[2], fitted[3])


@kernel
def _lay_out(value: FloatImage, step: int, padded: FloatImage) -> None:
    """Value and weight with a rim of zeros, and zeros where there is no value."""
    height, width = value.shape
    padded[:, :step] = np.float32(0.0)
    padded[:, height + step :] = np.float32(0.0)
    padded[:, :, :step] = np.float32(0.0)
    padded[:, :, width + step :] = np.float32(0.0)
    zero, one = np.float32(0.0), np.float32(1.0)
    for v in range(height):
        for u in range(width):
            valid = np.isfinite(value[v, u])
            padded[0, v + step, u + step] = value[v, u] if valid else zero
            padded[1, v + step, u + step] = one if valid else zero


@kernel
def _fit(
    padded: FloatImage, slope_u: FloatImage, slope_v: FloatImage, bandwidth: FloatImage, step: int, fitted: FloatImage
) -> None:
    """Weighted least squares of the residuals to the present plane.

    Long, for the inner loop over u must be one block without calls, branches or signed indices: so it runs in vector
    registers (20 times faster than the same in pieces).
    """
    height, width = fitted.shape[1], np.uint32(fitted.shape[2])
    hole = np.uint32(step)
    size = np.float32(step)
    ridge = np.float32(0.01) * size * size  # keeps the slopes of a lonely pixel as they are
    zero, one = np.float32(0.0), np.float32(1.0)
    for v in range(height):
        above, here, below = padded[0, v], padded[0, v + step], padded[0, v + 2 * step]
        weight_above, weight_here, weight_below = padded[1, v], padded[1, v + step], padded[1, v + 2 * step]
        gu, gv, band = slope_u[v], slope_v[v], bandwidth[v]
        out, out_u, out_v, out_support = fitted[0, v], fitted[1, v], fitted[2, v], fitted[3, v]
        for u in range(width):
            k = u + hole
            inverse_band = one / max(band[u], np.float32(1e-6)) if weight_here[k] > zero else zero
            s, sx, sy, sxx, sxy, syy, sr, sxr, syr = zero, zero, zero, zero, zero, zero, zero, zero, zero
            for j in range(3):
                for i in range(3):
                    x, y = np.float32(i - 1) * size, np.float32(j - 1) * size
                    n = u + hole * np.uint32(i)
                    if j == 0:
                        value, w = above[n], weight_above[n]
                    elif j == 1:
                        value, w = here[n], weight_here[n]
                    else:
                        value, w = below[n], weight_below[n]
                    r = value - here[k] - gu[u] * x - gv[u] * y
                    t = r * inverse_band
                    t = max(zero, one - t * t)
                    w *= np.float32((2 - abs(i - 1)) * (2 - abs(j - 1))) * np.float32(0.25) * t * t
                    s, sx, sy, sr = s + w, sx + w * x, sy + w * y, sr + w * r
                    sxx, sxy, syy = sxx + w * x * x, sxy + w * x * y, syy + w * y * y
                    sxr, syr = sxr + w * x * r, syr + w * y * r
            inverse = one / max(s, np.float32(1e-6))
            mx, my, mr = sx * inverse, sy * inverse, sr * inverse
            xx, xy, yy = sxx - mx * sx + ridge, sxy - mx * sy, syy - my * sy + ridge
            xr, yr = sxr - mx * sr, syr - my * sr
            scale = weight_here[k] / (xx * yy - xy * xy)
            p, q = (yy * xr - xy * yr) * scale, (xx * yr - xy * xr) * scale
            out[u] = here[k] + weight_here[k] * (mr - p * mx - q * my) if weight_here[k] > zero else np.float32(np.nan)
            out_u[u], out_v[u] = (gu[u] + p) * weight_here[k], (gv[u] + q) * weight_here[k]
            out_support[u] = s * weight_here[k]
