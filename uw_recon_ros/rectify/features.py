"""Features of an image and their matches in another: what tie points are made from."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Matrix

_CELLS = 8  # the image is divided into 8 x 8 parts that share the features evenly
_CHUNK = 256  # rows of the similarity matrix held at a time


def _cell_ranks(points: Matrix, order: NDArray[np.int64], width: int, height: int) -> NDArray[np.int64]:
    """Position of every point within its own part of the image, counted along `order`."""
    column = np.clip(points[:, 0] * _CELLS // max(width, 1), 0, _CELLS - 1)
    row = np.clip(points[:, 1] * _CELLS // max(height, 1), 0, _CELLS - 1)
    cell = (row * _CELLS + column).astype(np.int64)[order]
    by_cell = np.argsort(cell, kind="stable")
    starts = np.searchsorted(cell[by_cell], np.arange(_CELLS * _CELLS))
    ranks = np.empty(len(points), np.int64)
    ranks[order[by_cell]] = np.arange(len(points)) - starts[cell[by_cell]]
    return ranks


def spread(points: Matrix, priority: Matrix, count: int, width: int, height: int) -> NDArray[np.int64]:
    """Choose points evenly over the image: every part gives its best, then its second best, and so on.

    Parameters
    ----------
    points : (N, 2) float64
        px.
    priority : (N,) float64
        Larger is better.
    count : int
        How many to choose at most.
    width, height : int
        Size of the image, px.

    Returns
    -------
    (M,) int64
        Ascending indices, ``M = min(N, count)``.
    """
    order = np.argsort(-priority, kind="stable")
    ranks = _cell_ranks(points, order, width, height)
    position = np.empty(len(points), np.int64)
    position[order] = np.arange(len(points))
    return np.sort(np.lexsort((position, ranks))[:count])


def find_features(gray: ByteImage, params: RectifyParams, hidden: Mask | None = None) -> tuple[Matrix, FloatImage]:
    """SIFT key points and RootSIFT descriptors (Arandjelovic and Zisserman 2012), spread over the image.

    Parameters
    ----------
    gray : (H, W) uint8
    params : RectifyParams
        ``tie_contrast``, ``tie_features``.
    hidden : (H, W) bool or None
        Where the image shows nothing: no feature lies there.

    Returns
    -------
    (N, 2) float64, (N, 128) float32
        px; rows of length 1.
    """
    sift = cv2.SIFT.create(contrastThreshold=params.tie_contrast)
    seen = None if hidden is None or not hidden.any() else (~hidden).astype(np.uint8)
    found = sift.detect(gray, seen)
    if not found:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    points = np.array([k.pt for k in found], np.float64)
    strength = np.array([k.response for k in found])
    kept = spread(points, strength, params.tie_features, gray.shape[1], gray.shape[0])
    described, descriptors = sift.compute(gray, [found[i] for i in kept])
    if not described:
        return np.zeros((0, 2)), np.zeros((0, 128), np.float32)
    descriptors /= np.maximum(descriptors.sum(axis=1, keepdims=True), 1e-9)
    return np.array([k.pt for k in described], np.float64), np.sqrt(descriptors)


def _two_best(similarity: FloatImage) -> tuple[NDArray[np.int64], FloatImage]:
    """Column of the largest entry of every row, and the two largest; overwrites its argument."""
    best, rows = similarity.argmax(axis=1), np.arange(len(similarity))
    first = similarity[rows, best]
    similarity[rows, best] = -np.inf
    return best, np.stack([first, similarity.max(axis=1)])


def mutual_matches(left: FloatImage, right: FloatImage, ratio: float) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Pairs of unit descriptors that prefer each other, clearly.

    Parameters
    ----------
    left, right : (N, D), (M, D) float32
        Rows of length 1.
    ratio : float
        Largest ratio of the best distance to the second best (Lowe 2004).

    Returns
    -------
    (K,) int64, (K,) int64
        Indices into `left` and `right`.
    """
    if len(left) < 2 or len(right) < 2:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    best = np.empty(len(left), np.int64)
    two = np.empty((2, len(left)), np.float32)
    for start in range(0, len(left), _CHUNK):
        part = slice(start, start + _CHUNK)
        best[part], two[:, part] = _two_best(left[part] @ right.T)
    distance, runner_up = np.sqrt(np.maximum(2 - 2 * two, 0))
    clear = np.flatnonzero(distance <= ratio * runner_up)
    back = (right[best[clear]] @ left.T).argmax(axis=1)
    kept = clear[back == clear]
    return kept, best[kept]
