"""The disparity at the ends of a segment, robust where an end lies on a silhouette.

Along a straight line in space disparity is linear in the image. So disparities are read along the segment, and a line
is fitted that most of them agree with. An end on a smooth surface is what is seen there. An end on a silhouette is what
the line says, where it holds from end to end as well as its noise lets it, as along a board; where not, as over
anything round, what the segment shows right before it: background seen past an edge does not agree, nor does it count.
The line must be seen next to the end, and not behind what the end's pixel shows. Where another surface is seen within a
few px of the end, which of them was meant is not known: both are told. The numbers are chosen by
``test/benchmark/length_ends.py``.

``report/measure_numbers.js`` does the same in pages; a test holds the two together.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.measure.random_draws import below
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix

_SPOT_PX = (4, 2)  # radius of what is one surface, or a silhouette; the larger first
_BAND_PX = 2  # to either side of the segment
_INWARDS_PX = 6.0
_BORNE_PX = 8.0  # from an end, in which a line must be seen
_EDGE_PX = 3  # a click and the matcher's edge may be off by as much
_ANOTHER_PX = 2.0  # disparities further apart belong to two surfaces
_LEAST = 8  # disparities
_STRAIGHT = 0.7  # share that must agree for the whole segment to be one line
_BY_NOISE = 1.25  # scatter over sigma, up to which a line is as straight as its noise tells
_TOLERANCE = 3.0  # times sigma
_LEAST_TOLERANCE_PX = 0.3
_MOST_TOLERANCE_PX = 1.0  # of one surface: with more, a plane goes through two
_AVERAGED = 0.8  # sigma of a plane's disparity over that of its pixels
CORRELATED_PX = 8.0  #: along the image, over which a matcher's errors are alike
_DRAWS = 200


@dataclass(frozen=True)
class End:
    """One end of a segment.

    Parameters
    ----------
    u, v : float
        Rectified px, as clicked.
    disparity, sigma : float
        px.
    agreed : float
        Share of the disparities read that agree, 0 to 1.
    beside : float
        px, of another surface seen within 3 px; NaN: there is none.
    """

    u: float
    v: float
    disparity: float
    sigma: float
    agreed: float
    beside: float = float("nan")


@dataclass(frozen=True, eq=False)
class _Line:
    """``d = offset + slope t``, t in px from the segment's first end."""

    offset: float
    slope: float
    sigma: float
    middle: float
    spread: float
    count: float
    agreed: float
    reach: tuple[float, float]
    by_noise: bool

    def straight(self, length: float) -> bool:
        """Whether it holds from end to end."""
        return (
            self.by_noise and self.agreed >= _STRAIGHT and self.reach[0] < 0.2 * length and self.reach[1] > 0.8 * length
        )

    def at(self, t: float) -> tuple[float, float]:
        """Disparity and its standard deviation."""
        leverage = 1 + ((t - self.middle) / max(self.spread, 1e-9)) ** 2
        return self.offset + self.slope * t, self.sigma * float(np.sqrt(leverage / self.count))


def segment_ends(frame: DisparityFrame, first: Matrix, second: Matrix) -> tuple[End, End]:
    """Disparities at both ends of a segment.

    Parameters
    ----------
    frame : DisparityFrame
    first, second : (2,) float64
        Rectified px (u, v).

    Raises
    ------
    EstimationError
        There are too few disparities along the segment.
    """
    length = float(np.linalg.norm(second - first))
    if length < 2:
        raise EstimationError("segment: expected points 2 px apart or more, got one twice", Code.MEASURE_NO_DEPTH)
    t, d, sigma = _read(frame, first, second, length)
    whole, ends = _fitted(t, d, sigma), list[End]()
    for point, at in ((first, 0.0), (second, length)):
        found = _seen_there(frame, point, _SPOT_PX[0])
        if found is None and whole is not None and whole.straight(length):
            found = _along(frame, point, whole, at, t, d, sigma)
        found = found or _seen_there(frame, point, _SPOT_PX[1]) or _inwards(point, at, length, t, d, sigma)
        ends.append(replace(found, beside=_beside(frame, found)))
    return ends[0], ends[1]


def _along(
    frame: DisparityFrame, point: Matrix, line: _Line, at: float, t: Matrix, d: Matrix, sigma: Matrix
) -> End | None:
    """An end on the line of the whole segment; None where the line is not seen near it, or behind what is there."""
    near = np.abs(t - at) <= _BORNE_PX
    agree = np.abs(d[near] - line.offset - line.slope * t[near]) <= _limit(sigma)
    u, v = (round(float(x)) for x in point)
    there, found = float(frame.disparity[v, u]), _end(point, line, at)
    behind = (there - found.disparity) * np.sign(frame.geometry.focal_times_baseline)
    return None if agree.sum() < _LEAST or behind > _MOST_TOLERANCE_PX else found  # NaN is not behind


def _limit(sigma: Matrix) -> float:
    """How far from a line disparities of it lie, px."""
    return max(_TOLERANCE * float(np.median(sigma)), _LEAST_TOLERANCE_PX)


def _beside(frame: DisparityFrame, end: End) -> float:
    """Disparity of another surface near an end, px; NaN: there is none."""
    u, v = round(end.u), round(end.v)
    part = frame.disparity[max(v - _EDGE_PX, 0) : v + _EDGE_PX + 1, max(u - _EDGE_PX, 0) : u + _EDGE_PX + 1]
    with np.errstate(invalid="ignore"):
        others = part[np.abs(part - end.disparity) > _ANOTHER_PX]
    return float(np.median(others)) if len(others) > 1 else float("nan")


def _inwards(point: Matrix, at: float, length: float, t: Matrix, d: Matrix, sigma: Matrix) -> End:
    """An end on a silhouette: what the segment shows right before it."""
    near = np.abs(t - at) <= min(_INWARDS_PX, max(length / 3, 6.0))
    line = _fitted(t[near], d[near], sigma[near])
    if line is None:
        raise EstimationError(
            f"no depth at ({point[0]:.0f}, {point[1]:.0f}): expected at least {_LEAST} disparities towards the other "
            f"end, got {int(near.sum())}: click where the picture has depth",
            Code.MEASURE_NO_DEPTH,
        )
    return _end(point, line, at)


def _seen_there(frame: DisparityFrame, point: Matrix, reach: int) -> End | None:
    """An end on one surface, smooth within `reach` px; None at a silhouette, or without depth."""
    u, v = (round(float(x)) for x in point)
    height, width = frame.disparity.shape
    part = slice(max(v - reach, 0), min(v + reach + 1, height)), slice(max(u - reach, 0), min(u + reach + 1, width))
    rows, columns = np.mgrid[part]
    d, sigma = frame.disparity[part], frame.sigma[part]
    known = np.isfinite(d)
    if known.sum() < 0.6 * d.size or d.size < _LEAST:
        return None
    places = np.stack([columns[known] - point[0], rows[known] - point[1], np.ones(int(known.sum()))], axis=1)
    values = d[known].astype(np.float64)
    plane = np.linalg.lstsq(places, values, rcond=None)[0]
    scatter = float(np.abs(values - places @ plane).max())
    noise = float(np.nanmedian(sigma[known])) if np.isfinite(sigma[known]).any() else 1.0
    if scatter > min(max(_TOLERANCE * noise, _LEAST_TOLERANCE_PX), _MOST_TOLERANCE_PX):
        return None
    return End(float(point[0]), float(point[1]), float(plane[2]), _AVERAGED * noise, float(known.mean()))


def _end(point: Matrix, line: _Line, t: float) -> End:
    disparity, sigma = line.at(t)
    return End(float(point[0]), float(point[1]), disparity, sigma, line.agreed)


def _read(frame: DisparityFrame, first: Matrix, second: Matrix, length: float) -> tuple[Matrix, Matrix, Matrix]:
    """Place along the segment, disparity and sigma of all pixels in a band about it."""
    along = (second - first) / length
    across = np.array([-along[1], along[0]])
    steps = np.arange(0.0, length + 0.5)
    found = []
    for aside in range(-_BAND_PX, _BAND_PX + 1):
        places = np.rint(first + steps[:, None] * along + aside * across).astype(int)
        height, width = frame.disparity.shape
        inside = (places >= 0).all(axis=1) & (places[:, 0] < width) & (places[:, 1] < height)
        u, v = places[inside].T
        found.append(np.stack([steps[inside], frame.disparity[v, u], frame.sigma[v, u]]))
    t, d, sigma = np.concatenate(found, axis=1).astype(np.float64)
    known = np.isfinite(d)
    return t[known], d[known], np.where(np.isfinite(sigma[known]), sigma[known], 1.0)


def _fitted(t: Matrix, d: Matrix, sigma: Matrix) -> _Line | None:
    """The line that most disparities agree with, refined on those; None for too few."""
    if len(t) < _LEAST:
        return None
    limit = _limit(sigma)
    offset, slope = _most_agreed(t, d, limit)
    agree = np.abs(d - offset - slope * t) <= limit
    if agree.sum() < _LEAST:
        return None
    slope, offset = _line_through(t[agree], d[agree])
    scatter = float(np.sqrt(np.mean((d[agree] - offset - slope * t[agree]) ** 2)))
    length, noise = max(float(np.ptp(t[agree])), 1.0), float(np.median(sigma[agree]))
    return _Line(
        offset, slope, max(scatter, noise), float(t[agree].mean()), float(t[agree].std()),
        max(length / CORRELATED_PX, 1.0), float(agree.mean()), (float(t[agree].min()), float(t[agree].max())),
        scatter <= _BY_NOISE * noise,
    )  # fmt: skip


def _line_through(t: Matrix, d: Matrix) -> tuple[float, float]:
    """Slope and offset by least squares; level where all lie at one place."""
    if np.ptp(t) < 1:
        return 0.0, float(d.mean())
    aside, mean = t - t.mean(), float(d.mean())
    slope = float(aside @ (d - mean) / (aside @ aside))
    return slope, mean - slope * float(t.mean())


def _most_agreed(t: Matrix, d: Matrix, limit: float) -> tuple[float, float]:
    """Offset and slope of the line through two disparities that most others agree with; the same draws always."""
    one, other = below(len(t), 2 * _DRAWS).reshape(2, _DRAWS)
    apart = np.where(np.abs(t[other] - t[one]) < 1, np.inf, t[other] - t[one])
    slopes = (d[other] - d[one]) / apart
    offsets = d[one] - slopes * t[one]
    counts = (np.abs(d - offsets[:, None] - slopes[:, None] * t) <= limit).sum(axis=1)
    best = int(counts.argmax())
    return float(offsets[best]), float(slopes[best])
