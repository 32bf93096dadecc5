"""Depths against the truth, in numbers."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.types import DepthMap, DisparityMap, FloatImage, RectificationQuality

Rows = list[tuple[str, ...]]


@dataclass(frozen=True)
class DepthErrors:
    """How depth departs from its truth, over the pixels where both are known.

    Parameters
    ----------
    median, rms : float
        Of the absolute error, unit of the depth; NaN without common pixels.
    bias : float
        Median of the signed error; positive: too far.
    median_relative : float
        Median of the absolute error over the true depth.
    within_2_percent, within_5_percent : float
        Share of the pixels, 0 to 1.
    density : float
        Share of the pixels with truth that have a depth, 0 to 1.
    """

    median: float
    rms: float
    bias: float
    median_relative: float
    within_2_percent: float
    within_5_percent: float
    density: float


def depth_errors(depth: DepthMap, truth: FloatImage) -> DepthErrors:
    """Compare with a true depth of the same view and unit; NaN or inf = unknown.

    Raises
    ------
    ValueError
        The two differ in size.
    """
    if truth.shape != depth.depth.shape:
        raise ValueError(f"truth: expected {depth.depth.shape} as the depth map, got {truth.shape}")
    known = np.isfinite(truth)
    both = known & np.isfinite(depth.depth)
    if not both.any():
        nan = float("nan")
        return DepthErrors(nan, nan, nan, nan, nan, nan, 0.0)
    error = depth.depth[both].astype(np.float64) - truth[both]
    relative = np.abs(error) / truth[both]
    return DepthErrors(
        median=float(np.median(np.abs(error))),
        rms=float(np.sqrt(np.mean(error**2))),
        bias=float(np.median(error)),
        median_relative=float(np.median(relative)),
        within_2_percent=float(np.mean(relative <= 0.02)),
        within_5_percent=float(np.mean(relative <= 0.05)),
        density=float(both.sum() / known.sum()),
    )


def percent(share: float) -> str:
    """``0.123`` -> ``12.3 %``."""
    return "unknown" if np.isnan(share) else f"{100 * share:.1f} %"


def measured(value: float, unit: str, digits: int = 3) -> str:
    """A number with its unit, or ``unknown``; small lengths in mm."""
    if unit == "m" and abs(value) < 0.1:
        value, unit = 1000 * value, "mm"
    return "unknown" if np.isnan(value) else f"{value:.{digits}g} {unit}"


def error_rows(errors: DepthErrors, unit: str) -> Rows:
    """A table of `errors`."""
    return [
        ("Depth error, median", measured(errors.median, unit)),
        ("Depth error, median, of the depth", percent(errors.median_relative)),
        ("Depth error, root mean square", measured(errors.rms, unit)),
        ("Bias (median signed error)", measured(errors.bias, unit)),
        ("Within 2 % of the true depth", percent(errors.within_2_percent)),
        ("Within 5 % of the true depth", percent(errors.within_5_percent)),
        ("Pixels with truth that have a depth", percent(errors.density)),
    ]


def rectification_rows(quality: RectificationQuality) -> Rows:
    """A table of how well the rows agree, and what is known of scale and shape."""
    sigma, k1 = quality.shape_sigma_percent, quality.lens_k1
    return [
        ("Method", quality.method),
        ("Vertical (epipolar) error, median", measured(quality.row_error_median_px, "px")),
        ("Vertical (epipolar) error, 95th percentile", measured(quality.row_error_p95_px, "px")),
        ("Tie points that agree", f"{quality.inliers}"),
        *([("Medium, by the rows", quality.medium)] if quality.medium else []),
        *([("Uncertainty of relative depths", f"{sigma:.1f} %")] if math.isfinite(sigma) else []),
        *([("Lens distortion estimated", f"k1 = {k1:.3f}")] if math.isfinite(k1) and k1 != 0 else []),
    ]


def matching_rows(disparity: DisparityMap, depth: DepthMap) -> Rows:
    """A table of the matcher's result; what is not known (a disparity that came as a message) has no row."""
    rows = [
        ("Method", disparity.method),
        ("Disparities searched", f"{disparity.min_disparity} to {disparity.max_disparity} px"),
        ("Pixels with a disparity", percent(disparity.density)),
        ("Residual row offset", str(disparity.rows) if disparity.rows.points else ""),
        ("Pixels with a depth", percent(float(np.isfinite(depth.depth).mean()))),
        ("Energy", "" if np.isnan(disparity.energy) else f"{disparity.energy:.6g}"),
    ]
    return [row for row in rows if row[1]]


def time_rows(seconds: Mapping[str, float]) -> Rows:
    """A table of the stages' times, with their sum."""
    rows: Rows = [(f"Time, {stage}", f"{value:.3f} s") for stage, value in seconds.items()]
    return [*rows, ("Time, together", f"{sum(seconds.values()):.3f} s")] if rows else []
