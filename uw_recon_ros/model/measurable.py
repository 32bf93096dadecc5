"""What is kept of a model so that lengths on it have their standard deviation: ``measure.json``."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from uw_recon_ros.trajectory import JointCovariance
from uw_recon_ros.types import Matrix

MEASURE = "measure.json"
_SPOTS = 3000
_ANCHORS = 40  # poses whose errors are kept together; between them they are interpolated
_AT_ONCE = 200  # spots
_ASIDE = 8.0  # how much more a view from aside counts than one from afar


def measurable(
    vertices: NDArray[Any], sigma: NDArray[Any], poses: Matrix, frames: NDArray[np.intp], joint: JointCovariance | None,
    calibration: Sequence[tuple[float, float]], told: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """What ``measure.json`` holds.

    Parameters
    ----------
    vertices : (V, 3) float
        Of the surface, world less the origin.
    sigma : (V,) float
    poses : (N, 4, 4) float64
        Of all frames, world <- camera.
    frames : (F,) int
        Those of this segment, increasing.
    joint : JointCovariance or None
    calibration : sequence of (range, fraction)
        See `measure.on_model.Spots`.
    told : dict
        What else the file says.
    """
    chosen, spacing = _spread(np.asarray(vertices, np.float64))
    places = np.asarray(vertices, np.float64)[chosen]
    best = frames[_best_views(places, poses[frames])]
    index, covariance = _anchors(poses, frames, joint)
    anchors = np.interp(best, index, np.arange(len(index))) if len(index) else np.zeros(len(best))
    rows = np.column_stack([places, np.asarray(sigma)[chosen], poses[best, :3, 3], anchors])
    return {
        **told, "calibration": [list(row) for row in calibration], "spacing": spacing, "spots": _text(rows),
        "centres": poses[index, :3, 3].tolist(), "covariance": _text(covariance),
    }  # fmt: skip


def _spread(vertices: Matrix) -> tuple[NDArray[np.intp], float]:
    """Vertices evenly spread, and how far apart they are."""
    cell = max(float(np.ptp(vertices, axis=0).max()) / 500, 1e-9)
    while True:
        first = np.unique(np.floor(vertices / cell).astype(np.int64), axis=0, return_index=True)[1]
        if len(first) <= _SPOTS:
            break
        cell *= 1.2
    chosen = np.sort(first)
    apart = cKDTree(vertices[chosen]).query(vertices[chosen], k=min(2, len(chosen)))[0]
    return chosen, max(float(np.max(apart)), cell)


def _best_views(places: Matrix, poses: Matrix) -> NDArray[np.intp]:
    """The frame that sees each place from near and with it in its middle."""
    found = []
    for some in np.array_split(places, max(1, len(places) // _AT_ONCE)):
        aside = some[:, None] - poses[:, :3, 3]
        depth = np.einsum("sfi,fi->sf", aside, poses[:, :3, 2])
        squares = (aside**2).sum(axis=2)
        cost = squares * (1 + _ASIDE * (squares / np.maximum(depth, 1e-9) ** 2 - 1))
        found.append(np.where(depth > 0, cost, np.inf).argmin(axis=1))
    return np.concatenate(found)


def _anchors(
    poses: Matrix, frames: NDArray[np.intp], joint: JointCovariance | None
) -> tuple[NDArray[np.int64], Matrix]:
    """Numbers of some poses, and their joint covariance (6K, 6K) about the world's axes."""
    own = np.flatnonzero(np.isin(joint.index, frames)) if joint is not None else np.zeros(0, np.int64)
    if joint is None or not len(own):
        return np.zeros(0, np.int64), np.zeros((0, 0))
    own = own[np.unique(np.linspace(0, len(own) - 1, min(len(own), _ANCHORS)).round().astype(int))]
    where = (6 * own[:, None] + np.arange(6)).ravel()
    turn = np.zeros((6 * len(own), 6 * len(own)))
    for k, number in enumerate(joint.index[own]):
        for half in (6 * k, 6 * k + 3):
            turn[half : half + 3, half : half + 3] = poses[number, :3, :3]
    return joint.index[own], turn @ joint.matrix[np.ix_(where, where)] @ turn.T


def _text(array: Matrix) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f4").tobytes()).decode()
