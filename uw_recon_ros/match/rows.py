"""Rows that are still off: measured on the pair itself, as a smooth field, and taken out of the right view.

A port, a knock or an estimated geometry leaves rows a pixel or two apart, different over the image; every method of
matching breaks down on that. So points are matched at half size, row on row, which stands twice the error, and then
followed at full size in both directions (Lucas and Kanade, 1981). Their row offsets are noisy and some are wrong: a
polynomial in the right view's coordinates is fitted to them by least magnitudes. Where rows agree, nothing is touched.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.types import ByteImage, FloatImage, RowOffset

POINTS, APART, QUALITY = 600, 7, 0.003  #: corners looked for: number, distance px, part of the best one's strength
HALF = 2  #: by this factor are images smaller whose disparities say where to look
PATCH, LEVELS = 15, 1  #: of the following: side, px, and halvings
BACK_PX = 0.3  #: a point followed there and back must arrive this near
FARTHEST_PX = 8.0  #: greatest row offset that is looked for
LEVEL_WINDOW = 31  #: px; slower changes of brightness are taken out
FEWEST = 40  #: points that a field is fitted to
LEAST_PX = 0.25  #: a field smaller than this on nine tenths of the points is none
ROUNDS, ONCE_PX = 2, 0.7  #: from where on what is mended is measured once more: where rows are far off, points are few
EXPLAINED = 0.8  #: what a field leaves of the points' offsets, at most
_ITERATIONS, _SMALLEST_PX, _RIDGE = 15, 0.02, 1e-3

Points = NDArray[np.float64]


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

    coefficients: Points
    width: int
    height: int

    @classmethod
    def none(cls, width: int, height: int) -> RowField:
        """Rows that agree."""
        return cls(np.zeros(10), width, height)

    def __add__(self, other: RowField) -> RowField:
        return replace(self, coefficients=self.coefficients + other.coefficients)

    def at(self, u: Points, v: Points) -> Points:
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


def mend_rows(left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> tuple[ByteImage, RowOffset]:
    """The right view with its rows as those of the left, as far as the pair shows it.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Rows nearly matching.
    low, high : int
        Limits of the disparity, inclusive, px.
    threads : int
        The result does not depend on it.

    Returns
    -------
    right : as it came
        The same array where the rows agree, or where too little tells.
    offset : RowOffset
    """
    field, mended, offset = RowField.none(left.shape[1], left.shape[0]), right, RowOffset()
    for _ in range(ROUNDS):
        u, v, offsets = _measured(_even(left), _even(mended), low, high, threads)
        if len(offsets) < FEWEST:
            return mended, replace(offset, points=len(offsets))
        more = _fitted(u, v, offsets, field.width, field.height)
        explained = _explains(more.at(u, v), offsets)
        if explained or mended is right:
            field = field + more
            median, most = (float(np.quantile(np.abs(field.at(u, v)), q)) for q in (0.5, 0.9))
            offset = RowOffset(median, most, len(offsets), explained)
        if not explained:
            break
        mended = field.mended(right)
        if offset.median_px < ONCE_PX:
            break
    return mended, replace(offset, mended=mended is not right)


def _explains(fitted: Points, offsets: Points) -> bool:
    """Whether a field is worth bending an image for."""
    left_over, before = (float(np.median(np.abs(x))) for x in (offsets - fitted, offsets))
    return float(np.quantile(np.abs(fitted), 0.9)) >= LEAST_PX and left_over <= EXPLAINED * before


def _even(image: ByteImage) -> ByteImage:
    """Gray, of even brightness and contrast: the cameras may be exposed differently."""
    gray = (image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)).astype(np.float32)
    fine = gray - cv2.GaussianBlur(gray, (0, 0), LEVEL_WINDOW / 4)
    return np.asarray((128 + 32 * fine / max(float(fine.std()), 1.0)).clip(0, 255), np.uint8)


def _measured(left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> tuple[Points, Points, Points]:
    """Pixels of the right view, and how far below the left view's row they lie."""
    none = np.empty(0)
    corners = cv2.goodFeaturesToTrack(left, POINTS, QUALITY, APART)
    if corners is None or min(left.shape) < 2 * PATCH * HALF:
        return none, none, none
    here = np.asarray(corners, np.float32).reshape(-1, 2)
    start = _start(left, right, low, high, threads)[tuple(np.round(here[:, ::-1]).astype(np.intp).T)]
    here, start = here[np.isfinite(start)], start[np.isfinite(start)]
    if not len(here):
        return none, none, none
    there, first = _followed(left, right, here, here - np.outer(start, [1, 0]).astype(np.float32))
    back, second = _followed(right, left, there, here)
    kept = first & second & (np.abs(back - here).max(axis=1) < BACK_PX)
    kept &= (np.abs(there[:, 1] - here[:, 1]) < FARTHEST_PX) & (np.abs(here[:, 0] - there[:, 0] - start) < FARTHEST_PX)
    u, v = there[kept].T.astype(np.float64)
    return u, here[kept, 1].astype(np.float64), v - here[kept, 1]


def _start(left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> FloatImage:
    """Disparities found at half size, px; NaN = none."""
    height, width = left.shape
    small = (max(width // HALF, 1), max(height // HALF, 1))
    views = [np.asarray(cv2.resize(image, small, interpolation=cv2.INTER_AREA), np.uint8) for image in (left, right)]
    least, greatest = math.floor(low / HALF), math.ceil(high / HALF)
    half = graph_cut(views[0], views[1], least, greatest, effort="navigation", threads=threads).disparity
    found = half * np.float32(HALF)
    return np.asarray(cv2.resize(found, (width, height), interpolation=cv2.INTER_NEAREST), np.float32)


def _followed(
    first: ByteImage, second: ByteImage, points: FloatImage, guess: FloatImage
) -> tuple[FloatImage, NDArray[np.bool_]]:
    found, status, _ = cv2.calcOpticalFlowPyrLK(
        first, second, points, guess.astype(np.float32), winSize=(PATCH, PATCH), maxLevel=LEVELS,
        criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 30, 0.01), flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    return np.asarray(found, np.float32).reshape(-1, 2), np.asarray(status).ravel() == 1


def _terms(u: Points, v: Points, width: int, height: int) -> Points:
    """A polynomial of the third degree, about the middle of the image."""
    x, y = 2 * u / max(width - 1, 1) - 1, 2 * v / max(height - 1, 1) - 1
    return np.column_stack([x**i * y**j for i in range(4) for j in range(4 - i)])


def _fitted(u: Points, v: Points, offsets: Points, width: int, height: int) -> RowField:
    """Of least magnitudes; higher terms are held back by a ridge, for they know nothing beyond the points."""
    terms = _terms(u, v, width, height)
    ridge = _RIDGE * len(u) * np.eye(terms.shape[1])
    ridge[0, 0] = 0
    residual = offsets - np.median(offsets)
    for _ in range(_ITERATIONS):
        weights = 1 / np.maximum(np.abs(residual), _SMALLEST_PX)
        weighted = terms * weights[:, None]
        found = np.linalg.solve(weighted.T @ terms + ridge, weighted.T @ offsets)
        residual = offsets - terms @ found
    return RowField(found, width, height)
