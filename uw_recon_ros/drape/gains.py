"""How much brighter each view is than the others, channel by channel, from places that several of them show.

All views at once: ``log color = gain of the view + brightness of the place`` in least squares, the places eliminated.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix, diags
from scipy.sparse.linalg import spsolve

from uw_recon_ros.rigid import inverse
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_PRIOR = 1e-3  # of a view's own places: a gain that nothing tells is 1
_DARK, _BRIGHT = 3, 252  # channels beyond are cut off
_PLACES = 30_000


class Picture(Protocol):
    """What is needed of a view: as in `uw_recon_ros.fuse.blocks.View`."""

    @property
    def color(self) -> ByteImage:
        """(H, W, 3) uint8, RGB."""

    @property
    def depth(self) -> FloatImage:
        """(H, W) float32, m."""

    @property
    def pose(self) -> Matrix:
        """(4, 4) float64, world <- camera."""

    @property
    def intrinsics(self) -> Matrix:
        """(4,) float64: fx, fy, cx, cy, px."""


def gains_of(view_of: Callable[[int], Picture], count: int, places: Matrix, tolerance_m: float) -> Matrix:
    """(count, 3) how many times brighter each view is than the mean; divide by it.

    Parameters
    ----------
    view_of : callable
        Gives view k.
    count : int
    places : (N, 3) float64
        Points of the surface; a part of them is looked at.
    tolerance_m : float
        A place whose depth differs more from a view's is hidden from it.
    """
    chosen = places[:: max(1, len(places) // _PLACES)]
    views, where, logs = [], [], []
    for k in range(count):
        seen, colors = _samples(view_of(k), chosen, tolerance_m)
        views.append(np.full(len(seen), k))
        where.append(seen)
        logs.append(np.log(colors))
    gains: Matrix = np.exp(_balanced(np.concatenate(views), np.concatenate(where), np.concatenate(logs), count))
    return gains


def _samples(view: Picture, places: Matrix, tolerance_m: float) -> tuple[NDArray[np.intp], Matrix]:
    """Which places a view shows, and (K, 3) their colours in it."""
    there = inverse(view.pose)
    local = places @ there[:3, :3].T + there[:3, 3]
    height, width = view.depth.shape
    fx, fy, cx, cy = view.intrinsics
    z = np.where(local[:, 2] > 0, local[:, 2], np.nan)
    u, v = fx * local[:, 0] / z + cx, fy * local[:, 1] / z + cy
    inside = np.flatnonzero((u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1))
    column, row = np.rint(u[inside]).astype(int), np.rint(v[inside]).astype(int)
    colors = view.color[row, column].astype(np.float64)
    good = np.abs(view.depth[row, column] - z[inside]) <= tolerance_m
    good &= ((colors >= _DARK) & (colors <= _BRIGHT)).all(axis=1)
    return inside[good], colors[good]


def _balanced(views: NDArray[np.intp], places: NDArray[np.intp], logs: Matrix, count: int) -> Matrix:
    """(count, 3) logarithms of the gains, their mean zero where views hang together."""
    if not len(views):
        return np.zeros((count, 3))
    _, numbers = np.unique(places, return_inverse=True)
    shown = csr_matrix((np.ones(len(views)), (views, numbers)), shape=(count, numbers.max() + 1))
    a_view, a_place = np.asarray(shown.sum(axis=1)).ravel(), np.asarray(shown.sum(axis=0)).ravel()
    share = shown @ diags(1 / a_place)
    system = diags(a_view * (1 + _PRIOR) + 1e-9) - share @ shown.T
    found = np.empty((count, 3))
    for channel in range(3):
        sums = np.bincount(views, logs[:, channel], count)
        means = np.bincount(numbers, logs[:, channel], len(a_place))
        found[:, channel] = spsolve(system.tocsc(), sums - share @ means)
    return found
