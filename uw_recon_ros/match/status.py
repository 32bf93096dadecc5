"""Why a pixel has no disparity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.planes.left_right_check import fill_rows
from uw_recon_ros.types import ByteImage, FloatImage, Mask, MatchingPair, Status, Window
from uw_recon_ros.unseen_pixels import unseen


def explain(disparity: FloatImage, min_disparity: int, max_disparity: int, pair: MatchingPair) -> ByteImage:
    """Status bits of a disparity map; what either image does not show, see `unseen`, has none.

    Parameters
    ----------
    disparity : (H, W) float32
        As in `DisparityMap`; NaN = no match found.
    min_disparity, max_disparity : int
        Limits searched, inclusive, px.
    pair : MatchingPair
        What was matched.

    Returns
    -------
    (H, W) uint8
        ``UNSEEN`` outside the left image's valid window, and where it shows nothing. ``OUTSIDE`` where the match lies
        outside the other view's valid window, or where that shows nothing, or, where no match was found, would lie
        there at the disparity of the surroundings. ``OCCLUDED`` elsewhere without a match. 0 where the disparity is
        good.
    """
    vertical = pair.axis == "vertical"
    status = np.zeros(disparity.shape, np.uint8)
    unmatched = ~np.isfinite(disparity)
    along = np.array(disparity.T if vertical else disparity, np.float32, order="C")
    fill_rows(along)
    expected = along.T if vertical else along
    expected = np.clip(np.where(np.isfinite(expected), expected, min_disparity), min_disparity, max_disparity)
    hidden = unseen(pair.right)
    outside = ~_partner_seen(np.where(unmatched, expected, disparity), vertical, pair.valid_right, hidden)
    status[unmatched & ~outside] = Status.OCCLUDED
    status[outside] = Status.OUTSIDE
    status[unseen(pair.left)] = Status.UNSEEN
    if pair.valid_left is not None:
        beyond = np.ones(disparity.shape, np.bool_)
        beyond[pair.valid_left.slices] = False
        status[beyond] = Status.UNSEEN
    return status


def _partner_seen(
    disparity: NDArray[np.floating], vertical: bool, window: Window | None, hidden: Mask
) -> NDArray[np.bool_]:
    """Whether the partner lies in the right view's valid window, and not where that shows nothing."""
    height, width = disparity.shape
    v, u = (axis.astype(np.float32) for axis in np.ogrid[:height, :width])
    partner_v, partner_u = (v - disparity, u) if vertical else (v, u - disparity)
    seen = window or Window(0, 0, width, height)
    inside = (
        (partner_u >= seen.u)
        & (partner_u <= seen.u + seen.width - 1)
        & (partner_v >= seen.v)
        & (partner_v <= seen.v + seen.height - 1)
    )
    if hidden.any():
        at_v, at_u = (np.round(at).astype(np.intp) for at in (partner_v, partner_u))
        inside &= ~hidden[at_v.clip(0, height - 1), at_u.clip(0, width - 1)]
    return np.asarray(inside)
