"""Places of the bottom through many frames: key points matched where the poses expect them, joined to tracks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.jit import kernel
from uw_recon_ros.track.keypoints import PackedKeypoints
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_RADIUS_PX = 3.0  # about the expected place
_ALIKE = 0.8  # cosine of two descriptors, at least
_SCALE = 512.0**2  # of the product of two packed descriptors

Pairs = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class Observations:
    """What frames measured of points, track by track.

    Parameters
    ----------
    frame : (M,) int64
    starts : (P + 1,) int64
        Where the observations of each point begin.
    measured : (M, 3) float64
        u, v, disparity; px.
    sigma : (M,) float64
        Of the disparity, px.
    """

    frame: NDArray[np.int64]
    starts: NDArray[np.int64]
    measured: Matrix
    sigma: Matrix


def guided_matches(first: PackedKeypoints, second: PackedKeypoints, expected: Matrix) -> Pairs:
    """Key points that are most alike of all near where they are expected, seen from either side: (M, 2) indices.

    Parameters
    ----------
    first, second : PackedKeypoints
    expected : (N, 2) float64
        Where the second frame should show the first's, px.
    """
    best = np.full(len(first.sigma), -1, np.int64)
    back, level = np.full(len(second.sigma), -1, np.int64), np.zeros(len(second.sigma))
    places, a, b = second.measured.astype(np.float32), first.descriptors, second.descriptors
    _match(expected, places, np.ascontiguousarray(a), np.ascontiguousarray(b), best, back, level)
    found = np.flatnonzero(best >= 0)
    found = found[back[best[found]] == found]
    return np.stack([found, best[found]], axis=1)


@kernel(allocates=False)
def _match(
    expected: Matrix, places: FloatImage, first: ByteImage, second: ByteImage, best: NDArray[np.int64],
    back: NDArray[np.int64], level: Matrix,
) -> None:  # fmt: skip
    for i in range(len(expected)):
        most = _ALIKE
        for j in range(len(places)):
            if abs(places[j, 0] - expected[i, 0]) > _RADIUS_PX or abs(places[j, 1] - expected[i, 1]) > _RADIUS_PX:
                continue
            product = 0
            for c in range(first.shape[1]):
                product += np.int64(first[i, c]) * np.int64(second[j, c])
            alike = product / _SCALE
            if alike > most:
                most, best[i] = alike, j
            if alike > level[j]:
                level[j], back[j] = alike, i


def join_tracks(keypoints: Sequence[PackedKeypoints], matches: Mapping[tuple[int, int], Pairs]) -> Observations:
    """Chain matches to tracks; a frame that shows one track twice is left out of it, for one of the two is wrong.

    Parameters
    ----------
    keypoints : sequence of PackedKeypoints
        Of each frame.
    matches : mapping of pairs of frames to (M, 2) indices
    """
    counts = np.array([len(k.sigma) for k in keypoints], np.int64)
    first = np.r_[0, np.cumsum(counts)]
    a = np.concatenate([np.zeros(0, np.int64), *(first[i] + m[:, 0] for (i, _), m in matches.items())])
    b = np.concatenate([np.zeros(0, np.int64), *(first[j] + m[:, 1] for (_, j), m in matches.items())])
    graph = coo_matrix((np.ones(len(a), np.uint8), (a, b)), shape=(first[-1], first[-1]))
    number, labels = connected_components(graph, directed=False)
    frame = np.repeat(np.arange(len(counts)), counts)
    _, same, often = np.unique(labels.astype(np.int64) * len(counts) + frame, return_inverse=True, return_counts=True)
    once = often[same.ravel()] == 1
    once &= np.bincount(labels[once], minlength=number)[labels] >= 2
    chosen = np.flatnonzero(once)
    chosen = chosen[np.argsort(labels[chosen], kind="stable")]
    starts = np.r_[np.flatnonzero(np.diff(labels[chosen], prepend=-1)), len(chosen)]
    measured = np.concatenate([np.zeros((0, 3), np.float32), *(k.measured for k in keypoints)])
    sigma = np.concatenate([np.zeros(0, np.float32), *(k.sigma for k in keypoints)])
    return Observations(
        frame[chosen], starts.astype(np.int64), measured[chosen].astype(np.float64), sigma[chosen].astype(np.float64)
    )
