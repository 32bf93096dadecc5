"""A network's disparities in the place of the semi-global start: checked from both cameras, then only proposals.

The network sees the pair twice, the second time mirrored and exchanged, which gives the right view's disparities. So
the same check as the semi-global start's says where both agree; the cuts start from there, correct it, and what they
find without its support is doubtful.
"""

from __future__ import annotations

import numpy as np

from uw_recon_ros.match.planes.initial_disparity import Beginning, View, compare_views
from uw_recon_ros.match.stereo_network import StereoNetwork
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Status

_BEYOND = 0.5  # px that a disparity may lie beyond the limits


def begin_with(
    network: StereoNetwork, left: ByteImage, right: ByteImage, low: int, high: int, threads: int
) -> Beginning:
    """What `planes.initial_disparity.begin` gives, by a network.

    Parameters
    ----------
    network : StereoNetwork
    left, right : (H, W) or (H, W, 3) uint8
    low, high : int
        Limits of the disparity, inclusive, px. Networks know none below 0: they are shown the views moved apart by
        `low`.
    threads : int
        Of what is done here.

    Raises
    ------
    EstimationError
        The network fails; see `StereoNetwork`.
    """
    images = View.pair(left, right, threads)
    width = images[0].gray.shape[1]
    before = max(0, -low), max(0, low)  # px to the left of either view
    first, second = (
        np.pad(view.pixels, ((0, 0), (own, abs(low) - own), (0, 0)), mode="edge")
        for view, own in zip(images, before, strict=True)
    )
    seen = network(first, second)[:, before[0] : before[0] + width] + np.float32(low)
    mirrored = network(*(np.ascontiguousarray(image[:, ::-1]) for image in (second, first)))[:, ::-1]
    back = mirrored[:, before[1] : before[1] + width] + np.float32(low)
    disparity, wild = _within(seen, low, high)
    other, lost = _within(back, low, high)
    other[lost] = np.nan
    status = compare_views(disparity, other, (low, high), threads)
    status[wild & (status == 0)] = Status.INCONSISTENT
    return Beginning(images, disparity, status, learned=True)


def _within(found: FloatImage, low: int, high: int) -> tuple[FloatImage, Mask]:
    """A map between the limits, and where it was not, or not finite."""
    wild = ~np.isfinite(found) | (found < low - _BEYOND) | (found > high + _BEYOND)
    inside = np.where(np.isfinite(found), found, np.float32(low)).clip(low, high)
    return np.ascontiguousarray(inside, np.float32), wild
