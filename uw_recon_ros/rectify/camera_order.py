"""Signs of uncalibrated disparities: swapped cameras, the second camera above or below, points behind the rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.rectify.model_selection import Candidate
from uw_recon_ros.rectify.plane_at_infinity import baseline_side, infinity_shift
from uw_recon_ros.rectify.quality import forward_motion
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.types import Matrix

_PARALLAX_LIMIT_PX = 0.5


def _exchanged(parallax: Matrix, raw: Matrix) -> EstimationError:
    low, high = np.quantile(parallax, [0.05, 0.95])
    return EstimationError(
        "left and right images are swapped: expected positive disparities, got "
        f"{(parallax < 0).mean():.0%} of {len(parallax)} tie points "
        f"negative ({low:.0f} to {high:.0f} px; raw images: median {np.median(raw):.0f} px): give the left camera's "
        "image as the left one, or turn both images by 180 degrees if the rig hung upside down",
        Code.RECTIFY_EXCHANGED,
    )


def _check_parallax(parallax: Matrix) -> None:
    largest = float(np.quantile(np.abs(parallax), 0.95))
    if largest < _PARALLAX_LIMIT_PX:
        raise EstimationError(
            f"no parallax: expected disparities over {_PARALLAX_LIMIT_PX:g} px, got up to {largest:.2f} px (95 % of "
            f"{len(parallax)} tie points): both cameras show the same view",
            Code.RECTIFY_NO_PARALLAX,
        )


def sided(rectification: Rectification, candidate: Candidate) -> tuple[Rectification, tuple[Finding, ...]]:
    """Settle on which side the second camera stands and where infinity lies; see `infinity`.

    Parameters
    ----------
    rectification : Rectification
        In the frame where the axis is horizontal.
    candidate : Candidate
        Its tie points.

    Returns
    -------
    Rectification
        With the baseline's sign and, if need be, another offset.
    tuple of Finding
        Warnings.

    Raises
    ------
    EstimationError
        No parallax, or swapped cameras.
    """
    points, geometry = candidate.everything, rectification.geometry
    parallax, raw = rectification.parallax(points), points.left[:, 0] - points.right[:, 0]
    _check_parallax(parallax)
    side = baseline_side(parallax, raw, candidate.fit.infinity_sigma_px, candidate.axis)
    if side < 0 and candidate.axis == "horizontal":
        moving = forward_motion(points)  # both signs of parallax lie in such a pair
        raise EstimationError(moving[0].text, moving[0].code) if moving else _exchanged(parallax, raw)
    baseline = None if geometry.baseline_m is None else side * geometry.baseline_m
    shift = infinity_shift(side * parallax)
    geometry = replace(geometry, baseline_sign=side, baseline_m=baseline, cx_right=geometry.cx_right + side * shift)
    moved = f"the plane at infinity was moved by {shift:.1f} px to have all tie points in front of the rig"
    if geometry.metric:
        moved += ": metres are not to be trusted"
    warnings = (Finding(Code.RECTIFY_INFINITY_MOVED, moved),) if shift > 0 else ()
    return replace(rectification, geometry=geometry), warnings
