"""The oracle: the reference energy of any labelling, straight from its definition.

An assignment (p, q) joins a left and a right pixel of one row, d = u_p - u_q. With a the active ones,

    E = sum over a of (D(a) - K)  +  sum over neighbouring assignments of equal disparity, just one of them active, of V

(Kolmogorov and Zabih 2002, without the constant K x pixels: nothing matched has energy 0). Written to be read beside
that formula, in plain numpy; it shares nothing with the optimiser but the constants.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.kz2.constants import Constants
from uw_recon_ros.match.kz2.data_cost import CUT, EDGE
from uw_recon_ros.types import ByteImage, Mask

Labels = NDArray[np.int16]

#: Label of a pixel without an active assignment.
OCCLUDED = np.iinfo(np.int16).min


def energy(left: ByteImage, right: ByteImage, labels: Labels, constants: Constants) -> int:
    """Energy of a labelling, multiplied by ``constants.denominator``.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
    labels : (H, W) int16
        Disparities of the left pixels, px; `OCCLUDED` = no assignment.
    constants : Constants

    Returns
    -------
    int

    Raises
    ------
    ValueError
        A pixel of the right view has two assignments, or lies outside the image.
    """
    left_planes, right_planes = (np.atleast_3d(image).astype(np.int64) for image in (left, right))
    check_unique(labels)
    rows, columns = np.nonzero(labels != OCCLUDED)
    cost = _dissimilarity(left_planes, right_planes, rows, columns, columns - labels[rows, columns])
    total = int((constants.denominator * cost - constants.occlusion_cost).sum())
    for step in ((0, 1), (0, -1), (1, 0), (-1, 0)):
        total += _smoothness(left_planes, right_planes, labels, step, constants)
    return total


def check_unique(labels: Labels) -> None:
    """Raise ``ValueError`` unless every right pixel has at most one assignment, inside the image."""
    width = labels.shape[1]
    rows, columns = np.nonzero(labels != OCCLUDED)
    partners = columns - labels[rows, columns].astype(np.int64)
    if ((partners < 0) | (partners >= width)).any():
        raise ValueError("labels: expected partners inside the right image, got one outside")
    if np.bincount(rows * width + partners, minlength=1).max() > 1:
        raise ValueError("labels: expected at most one assignment a right pixel, got two")


def _smoothness(
    left: NDArray[np.int64], right: NDArray[np.int64], labels: Labels, step: tuple[int, int], constants: Constants
) -> int:
    """V over the active assignments whose neighbour in direction `step` exists and is not active."""
    height, width = labels.shape
    rows, columns = np.nonzero(labels != OCCLUDED)
    disparity = labels[rows, columns].astype(np.int64)
    next_rows, next_columns = rows + step[0], columns + step[1]
    next_partners = next_columns - disparity
    exists = (next_rows >= 0) & (next_rows < height) & (next_columns >= 0) & (next_columns < width)
    exists &= (next_partners >= 0) & (next_partners < width)
    inactive = np.zeros(rows.shape, np.bool_)
    inactive[exists] = labels[next_rows[exists], next_columns[exists]] != disparity[exists]
    p, p_next = (rows[inactive], columns[inactive]), (next_rows[inactive], next_columns[inactive])
    q, q_next = (p[0], p[1] - disparity[inactive]), (p_next[0], next_partners[inactive])
    smooth = _no_edge(left, p, p_next) & _no_edge(right, q, q_next)
    return int(np.where(smooth, constants.smoothness, constants.smoothness_at_edge).sum())


def _no_edge(
    image: NDArray[np.int64], here: tuple[NDArray[np.int64], ...], there: tuple[NDArray[np.int64], ...]
) -> Mask:
    return np.asarray(np.abs(image[here] - image[there]).max(axis=-1) < EDGE)


def _dissimilarity(
    left: NDArray[np.int64],
    right: NDArray[np.int64],
    rows: NDArray[np.int64],
    left_columns: NDArray[np.int64],
    right_columns: NDArray[np.int64],
) -> NDArray[np.int64]:
    """D of the assignments (row, left column) - (row, right column): symmetric Birchfield-Tomasi, cut, squared."""
    p, q = left[rows, left_columns], right[rows, right_columns]
    p_low, p_high = (bound[rows, left_columns] for bound in _interval(left))
    q_low, q_high = (bound[rows, right_columns] for bound in _interval(right))
    zero = np.zeros_like(p)
    p_from_q = np.maximum.reduce([zero, q_low - p, p - q_high])
    q_from_p = np.maximum.reduce([zero, p_low - q, q - p_high])
    squared = np.minimum(np.minimum(p_from_q, q_from_p), CUT) ** 2
    return np.asarray(squared.sum(axis=-1) // squared.shape[-1])


def _interval(image: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Least and greatest of each pixel and the half-way values to its four neighbours (a border repeats itself)."""
    height, width = image.shape[:2]
    padded = np.pad(image, ((1, 1), (1, 1), (0, 0)), mode="edge")
    around = [padded[1 + v : 1 + v + height, 1 + u : 1 + u + width] for v, u in ((0, 1), (0, -1), (1, 0), (-1, 0))]
    half = [(image + neighbour) // 2 for neighbour in around]
    return np.minimum.reduce([image, *half]), np.maximum.reduce([image, *half])
