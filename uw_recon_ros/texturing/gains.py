"""Colours balanced over all frames at once.

The colour of a place is the same in all pictures of it; its brightness is not: exposure differs from frame to frame,
and the lamp lights the middle of every picture alike more than its rim. In logarithms both add up: ``log I = log A
(place) + g (frame) + c . phi (pixel)``, and least squares over all overlaps give g for every frame and one c for all,
in each channel. Places drop out of the equations (Brown and Lowe, 2007, for the gains; Goldman, 2010, for the field).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse.linalg import spsolve

from uw_recon_ros.fuse.frame import View
from uw_recon_ros.texturing.visibility import in_sight
from uw_recon_ros.types import ByteImage, Matrix

#: Of a pixel, across the picture from -1 to 1: x, y, x^2, x y, y^2, r^4.
FIELD_TERMS = 6
_BLUR_PX = 15
_DARK, _BRIGHT = 8, 247  # of 255; beyond, a picture does not know
_ROBUST = 0.1  # of a logarithm
_ROUNDS = 4
_GAIN_SIGMA = 0.5  # believed beforehand: without it a chain of overlaps drifts
#: Of the field's terms. A slope of the field along a straight track looks just like gains that change along it.
_FIELD_SIGMAS = (0.05, 0.05, 0.5, 0.5, 0.5, 0.5)
_NOISE = 0.05


@dataclass(frozen=True, eq=False)
class GainSample:
    """What pictures show of places.

    Parameters
    ----------
    place, frame : (N,) int64
    level : (N, 3) float64
        Logarithm of the colour.
    terms : (N, 6) float64
        `field_terms` of the pixel.
    """

    place: NDArray[np.int64]
    frame: NDArray[np.int64]
    level: Matrix
    terms: Matrix


@dataclass(frozen=True, eq=False)
class Balance:
    """What pictures are multiplied by.

    Parameters
    ----------
    gains : (F, 3) float64
        Logarithm, a frame and channel.
    field : (6, 3) float64
        Coefficients of `field_terms`, common to all.
    """

    gains: Matrix
    field: Matrix


def unbalanced(frames: int) -> Balance:
    """Pictures as they are."""
    return Balance(np.zeros((frames, 3)), np.zeros((FIELD_TERMS, 3)))


def field_terms(u: Matrix, v: Matrix, width: int, height: int) -> Matrix:
    """(N, 6) terms of pixels."""
    x, y = (2 * u - width + 1) / width, (2 * v - height + 1) / width
    return np.stack([x, y, x * x, x * y, y * y, (x * x + y * y) ** 2], axis=1)


def look_at(points: Matrix, frame: int, view: View, left: ByteImage, tolerance: float) -> GainSample:
    """What one picture shows of places (P, 3), of those in its view."""
    which, u, v = in_sight(points, view, tolerance)
    smooth = cv2.blur(left, (_BLUR_PX, _BLUR_PX))[np.rint(v).astype(int), np.rint(u).astype(int)].astype(np.float64)
    good = ((smooth > _DARK) & (smooth < _BRIGHT)).all(axis=1)
    rows, columns = left.shape[:2]
    terms = field_terms(u[good], v[good], columns, rows)
    return GainSample(which[good], np.full(int(good.sum()), frame, np.int64), np.log(smooth[good]), terms)


def balance_frames(seen: Iterable[GainSample], places: int, frames: int) -> Balance:
    """Solve for all frames together.

    Parameters
    ----------
    seen : iterable of GainSample
    places, frames : int
        How many there are.
    """
    shown = _together(seen)
    place, frame, level, terms = shown.place, shown.frame, shown.level, shown.terms
    if not len(place):
        return unbalanced(frames)
    row = np.arange(len(place))
    design = sparse.hstack(
        [sparse.csr_matrix((np.ones(len(row)), (row, frame)), (len(row), frames)), sparse.csr_matrix(terms)], "csr"
    )
    member = sparse.csr_matrix((np.ones(len(row)), (row, place)), (len(row), places))
    solved = np.stack([_solve(design, member, level[:, c], frames) for c in range(3)], axis=1)
    return Balance(solved[:frames] - solved[:frames].mean(axis=0), solved[frames:])


def _together(seen: Iterable[GainSample]) -> GainSample:
    """One after the other; the single ones are let go of on the way."""
    parts = [(s.place, s.frame, s.level, s.terms) for s in seen]
    if not parts:
        return GainSample(*(np.zeros(0, np.int64),) * 2, np.zeros((0, 3)), np.zeros((0, FIELD_TERMS)))
    return GainSample(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))


def _solve(design: sparse.csr_matrix, member: sparse.csr_matrix, level: Matrix, frames: int) -> Matrix:
    """Robust least squares with the places eliminated."""
    sigmas = np.r_[np.full(frames, _GAIN_SIGMA), _FIELD_SIGMAS]
    prior = sparse.diags((_NOISE / sigmas) ** 2)
    weight, found = np.ones(len(level)), np.zeros(design.shape[1])
    for _ in range(_ROUNDS):
        weights = sparse.diags(weight)
        count = np.maximum(np.asarray(member.T @ weight), 1e-12)
        mixed = (member.T @ weights @ design).tocsr()
        mean_level = np.asarray(member.T @ (weight * level)) / count
        normal = design.T @ weights @ design - mixed.T @ sparse.diags(1 / count) @ mixed
        right = design.T @ (weight * (level - member @ mean_level))
        found = np.asarray(spsolve((normal + prior).tocsc(), right), np.float64)
        rest = level - design @ found
        rest -= member @ (np.asarray(member.T @ (weight * rest)) / count)
        weight = 1 / (1 + (rest / _ROBUST) ** 2)
    return found
