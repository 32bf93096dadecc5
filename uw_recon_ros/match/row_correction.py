"""Rows that are still off: measured on the pair itself, as a smooth field, and taken out of the right view.

A port, a knock or an estimated geometry leaves rows a pixel or two apart, different over the image; every method of
matching breaks down on that. But where the semi-global start is right, it says where a corner of the left view lies in
the right one but for its row, and from there it is followed in both directions (Lucas and Kanade, 1981). Their row
offsets are noisy and some are wrong: a polynomial in the right view's coordinates is fitted to them by least
magnitudes. Where rows agree, nothing is touched, and the start is handed on.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.planes.initial_disparity import Beginning, begin
from uw_recon_ros.types import ByteImage, FloatImage, RowOffset

POINTS, APART, QUALITY = 600, 7, 0.003  #: corners looked for: number, distance px, part of the best one's strength
HALF, LOST = 2, 0.3  #: images smaller by this factor say where to look, where the start put less than this part right
PATCH, LEVELS = 15, 1  #: of the following: side, px, and halvings
BACK_PX = 0.3  #: a point followed there and back must arrive this near
FARTHEST_PX = 8.0  #: greatest row offset that is looked for
LEVEL_WINDOW = 31  #: px; slower changes of brightness are taken out
FEWEST = 40  #: points that a field is fitted to
LEAST_PX = 0.25  #: a field smaller than this on nine tenths of the points is none
ROUNDS, ONCE_PX = 2, 0.7  #: from where on what is mended is measured once more: where rows are far off, points are few
EXPLAINED, SURE = 0.8, 0.5  #: what a field leaves of the points' offsets, at most; less where fewer corners were found
_ITERATIONS, _SMALLEST_PX, _RIDGE = 15, 0.02, 1e-3

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class RowField:
    """How far right rows lie below left ones.

    Parameters
    ----------
    coefficients : (10,) float64
        Of `_terms`, px.
    width, height : int
        Of the image, px.
    """

    coefficients: Floats
    width: int
    height: int

    @classmethod
    def none(cls, width: int, height: int) -> RowField:
        """Rows that agree."""
        return cls(np.zeros(10), width, height)

    def __add__(self, other: RowField) -> RowField:
        return replace(self, coefficients=self.coefficients + other.coefficients)

    def at(self, u: Floats, v: Floats) -> Floats:
        """Offset at pixels of the right view, px."""
        return np.asarray(_terms(u, v, self.width, self.height) @ self.coefficients)

    def mended(self, right: ByteImage) -> ByteImage:
        """The right view, its rows as those of the left."""
        v, u = (x.astype(np.float64) for x in np.indices((self.height, self.width)))
        below = v + self.at(u.ravel(), v.ravel()).reshape(v.shape)
        moved = cv2.remap(
            right, u.astype(np.float32), below.astype(np.float32), cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
        )
        return np.asarray(moved, np.uint8)


class Mended(NamedTuple):
    """A right view with its rows as those of the left.

    Parameters
    ----------
    right : as it came
        The same array where the rows agree, or where too little tells.
    offset : RowOffset
    start : Beginning or None
        Of this right view, where it was made.
    """

    right: ByteImage
    offset: RowOffset
    start: Beginning | None


class _Points(NamedTuple):
    """Pixels (u, v) of the right view, and how far below the left view's row they lie; and how many were tried."""

    u: Floats
    v: Floats
    offsets: Floats
    tried: int


def mend_rows(left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> Mended:
    """The right view with its rows as those of the left, as far as the pair shows it.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Rows nearly matching.
    low, high : int
        Limits of the disparity, inclusive, px.
    threads : int
        The result does not depend on it.
    """
    field, mended, offset = RowField.none(left.shape[1], left.shape[0]), right, RowOffset()
    even, start = _even(left), None
    corners = _corners(even)
    for _ in range(ROUNDS):
        start, there = begin(left, mended, low, high, threads), _even(mended)
        seen = _measured(corners, start, even, there)
        if len(seen.offsets) < LOST * len(corners):
            half = start.half or _half_size(left, mended, low, high, threads)
            seen = max(seen, _measured(corners, half, even, there), key=lambda s: len(s.offsets))
        if len(seen.offsets) < FEWEST:
            offset = replace(offset, points=len(seen.offsets))
            break
        more = _fitted(seen, field.width, field.height)
        explained = _explains(more.at(seen.u, seen.v), seen)
        if explained or mended is right:
            field = field + more
            offset = _told(field, seen)
        if not explained:
            break
        mended, start = field.mended(right), None
        if offset.median_px < ONCE_PX:
            break
    return Mended(mended, replace(offset, mended=mended is not right), start)


def _told(field: RowField, seen: _Points) -> RowOffset:
    """Of a field at the points it was fitted to."""
    median, most = (float(np.quantile(np.abs(field.at(seen.u, seen.v)), q)) for q in (0.5, 0.9))
    return RowOffset(median, most, len(seen.offsets))


def _explains(fitted: Floats, seen: _Points) -> bool:
    """Whether a field is worth bending an image for."""
    left_over, before = (float(np.median(np.abs(x))) for x in (seen.offsets - fitted, seen.offsets))
    most = EXPLAINED * min(1.0, len(seen.offsets) / (SURE * seen.tried))
    return float(np.quantile(np.abs(fitted), 0.9)) >= LEAST_PX and left_over <= most * before


def _even(image: ByteImage) -> ByteImage:
    """Gray, of even brightness and contrast: the cameras may be exposed differently."""
    gray = (image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)).astype(np.float32)
    level = cv2.GaussianBlur(
        cv2.resize(gray, None, fx=1 / 4, fy=1 / 4, interpolation=cv2.INTER_AREA), (0, 0), LEVEL_WINDOW / 16
    )
    fine = gray - cv2.resize(level, gray.shape[::-1])
    return np.asarray((128 + 32 * fine / max(float(fine.std()), 1.0)).clip(0, 255), np.uint8)


def _corners(even: ByteImage) -> FloatImage:
    """(N, 2) pixels worth following."""
    if min(even.shape) < 2 * PATCH * HALF:
        return np.empty((0, 2), np.float32)
    corners = cv2.goodFeaturesToTrack(even, POINTS, QUALITY, APART)
    return np.empty((0, 2), np.float32) if corners is None else np.asarray(corners, np.float32).reshape(-1, 2)


def _measured(corners: FloatImage, found: Beginning, left: ByteImage, right: ByteImage) -> _Points:
    """Follow corners from where a start puts them, there and back."""
    scale = left.shape[1] / found.status.shape[1]
    at = tuple((corners[:, ::-1] / scale).round().astype(np.intp).clip(0, np.array(found.status.shape) - 1).T)
    usable = found.usable[at]
    here, start = corners[usable], found.disparity[at][usable] * np.float32(scale)
    if not len(here):
        none = np.empty(0)
        return _Points(none, none, none, len(corners))
    there, first = _followed(left, right, here, here - np.outer(start, [1, 0]).astype(np.float32))
    back, second = _followed(right, left, there, here)
    kept = first & second & (np.abs(back - here).max(axis=1) < BACK_PX)
    kept &= (np.abs(there[:, 1] - here[:, 1]) < FARTHEST_PX) & (np.abs(here[:, 0] - there[:, 0] - start) < FARTHEST_PX)
    u, v = there[kept].T.astype(np.float64)
    return _Points(u, here[kept, 1].astype(np.float64), v - here[kept, 1], len(corners))


def _half_size(left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> Beginning:
    """A start at half size, which stands twice the error of rows."""
    small = (max(left.shape[1] // HALF, 1), max(left.shape[0] // HALF, 1))
    views = [np.asarray(cv2.resize(image, small, interpolation=cv2.INTER_AREA), np.uint8) for image in (left, right)]
    return begin(views[0], views[1], math.floor(low / HALF), math.ceil(high / HALF), threads)


def _followed(
    first: ByteImage, second: ByteImage, points: FloatImage, guess: FloatImage
) -> tuple[FloatImage, NDArray[np.bool_]]:
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, points, guess.astype(np.float32), winSize=(PATCH, PATCH), maxLevel=LEVELS,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01), flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    return np.asarray(found, np.float32).reshape(-1, 2), np.asarray(status).ravel() == 1


def _terms(u: Floats, v: Floats, width: int, height: int) -> Floats:
    """A polynomial of the third degree, about the middle of the image."""
    x, y = 2 * u / max(width - 1, 1) - 1, 2 * v / max(height - 1, 1) - 1
    return np.column_stack([x**i * y**j for i in range(4) for j in range(4 - i)])


def _fitted(seen: _Points, width: int, height: int) -> RowField:
    """Of least magnitudes; higher terms are held back by a ridge, for they know nothing beyond the points."""
    offsets, terms = seen.offsets, _terms(seen.u, seen.v, width, height)
    ridge = _RIDGE * len(offsets) * np.eye(terms.shape[1])
    ridge[0, 0] = 0
    residual = offsets - np.median(offsets)
    for _ in range(_ITERATIONS):
        weights = 1 / np.maximum(np.abs(residual), _SMALLEST_PX)
        weighted = terms * weights[:, None]
        found = np.linalg.solve(weighted.T @ terms + ridge, weighted.T @ offsets)
        residual = offsets - terms @ found
    return RowField(found, width, height)
