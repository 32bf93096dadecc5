"""Signs of uncalibrated disparities: swapped cameras, the second camera above or below, points behind the rig."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.rectify.model_selection import Candidate
from uw_recon_ros.rectify.plane_at_infinity import baseline_side, infinity_shift, vote
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


def _order_unknown(parallax: Matrix, raw: Matrix) -> Finding:
    text = (
        "which camera is the left one cannot be told from these images (disparities: median "
        f"{np.median(parallax):.0f} px rectified, {np.median(raw):.0f} px raw): taken as they were given"
    )
    advice = "if near things come out far, exchange the images; depth relief, more frames or a calibration would tell"
    return Finding(Code.RECTIFY_ORDER_UNKNOWN, text, advice=advice)


def _side(parallax: Matrix, raw: Matrix, candidate: Candidate, infinity_px: float) -> tuple[int, tuple[Finding, ...]]:
    """Of the second camera, and what is to be told of it; refused where the images are surely exchanged.

    A horizontal rig is taken as it was given where rectified and raw images contradict each other.
    """
    side = baseline_side(parallax, candidate.fit.infinity_sigma_px, infinity_px)
    if candidate.axis == "vertical":
        return side or vote(raw) or 1, ()
    side = 0 if vote(raw) == -side else side
    if side < 0:
        moving = forward_motion(candidate.everything)  # both signs of parallax lie in such a pair
        raise EstimationError(moving[0].text, moving[0].code) if moving else _exchanged(parallax, raw)
    return 1, () if side else (_order_unknown(parallax, raw),)


def sided(
    rectification: Rectification, candidate: Candidate, infinity_px: float
) -> tuple[Rectification, tuple[Finding, ...]]:
    """Settle on which side the second camera stands and where infinity lies; see `infinity`.

    Parameters
    ----------
    rectification : Rectification
        In the frame where the axis is horizontal.
    candidate : Candidate
        Its tie points.
    infinity_px : float
        Standard deviation of infinity, a lens that nobody described included, px.

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
    side, order = _side(parallax, raw, candidate, infinity_px)
    baseline = None if geometry.baseline_m is None else side * geometry.baseline_m
    shift = infinity_shift(side * parallax)
    geometry = replace(geometry, baseline_sign=side, baseline_m=baseline, cx_right=geometry.cx_right + side * shift)
    moved = f"the plane at infinity was moved by {shift:.1f} px to have all tie points in front of the rig"
    if geometry.metric:
        moved += ": metres are not to be trusted"
    warnings = (Finding(Code.RECTIFY_INFINITY_MOVED, moved),) if shift > 0 else ()
    return replace(rectification, geometry=geometry), order + warnings
