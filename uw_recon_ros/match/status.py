"""Why a pixel has no disparity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.evaluate import fill_rows
from uw_recon_ros.types import ByteImage, FloatImage, RectifiedPair, Status, Window


def explain(disparity: FloatImage, min_disparity: int, max_disparity: int, pair: RectifiedPair) -> ByteImage:
    """Status bits of a disparity map.

    Parameters
    ----------
    disparity : (H, W) float32
        As in `DisparityMap`; NaN = no match found.
    min_disparity, max_disparity : int
        Limits searched, inclusive, px.
    pair : RectifiedPair
        What was matched.

    Returns
    -------
    (H, W) uint8
        ``UNSEEN`` outside the left image's valid window. ``OUTSIDE`` where the match lies outside the other view's
        valid window, or, where none was found, would lie there at the disparity of the surroundings. ``OCCLUDED``
        elsewhere without a match. 0 where the disparity is good.
    """
    vertical = pair.geometry.axis == "vertical"
    status = np.zeros(disparity.shape, np.uint8)
    unmatched = ~np.isfinite(disparity)
    expected = fill_rows(disparity.T).T if vertical else fill_rows(disparity)
    expected = np.clip(np.where(np.isfinite(expected), expected, min_disparity), min_disparity, max_disparity)
    outside = ~_partner_seen(np.where(unmatched, expected, disparity), vertical, pair.valid_right)
    status[unmatched & ~outside] = Status.OCCLUDED
    status[outside] = Status.OUTSIDE
    if pair.valid_left is not None:
        unseen = np.ones(disparity.shape, np.bool_)
        unseen[pair.valid_left.slices] = False
        status[unseen] = Status.UNSEEN
    return status


def _partner_seen(disparity: NDArray[np.floating], vertical: bool, window: Window | None) -> NDArray[np.bool_]:
    """Whether the partner lies in the right view's valid window."""
    height, width = disparity.shape
    v, u = np.indices((height, width))
    partner_v, partner_u = (v - disparity, u) if vertical else (v, u - disparity)
    seen = window or Window(0, 0, width, height)
    return np.asarray(
        (partner_u >= seen.u)
        & (partner_u <= seen.u + seen.width - 1)
        & (partner_v >= seen.v)
        & (partner_v <= seen.v + seen.height - 1)
    )
