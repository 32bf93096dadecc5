"""Lines over the time of a dive, as SVG inside the page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from uw_recon_ros.report.shell import fragment
from uw_recon_ros.types import Matrix

WIDTHS = {"wide": 1180, "narrow": 400}  # of the drawing, SVG units; the page shows one that fits
HEIGHT = 194
LEFT, RIGHT, TOP, BOTTOM = 58, 16, 12, 38
_MOST_POINTS = {"wide": 800, "narrow": 300}  # more are drawn as the range of each bucket
_TICKS = 4
_TICK_WIDTH = 130


@dataclass(frozen=True)
class Line:
    """A value over time.

    Parameters
    ----------
    title, unit : str
    x : sequence of float
        Of every frame, not decreasing.
    values : sequence of float
        NaN where there is none.
    low, high : sequence of float, optional
        A band around the values.
    bottom : float or None
        Where the axis begins; None: at the least value.
    top : float or None
    """

    title: str
    unit: str
    x: Sequence[float]
    values: Sequence[float]
    low: Sequence[float] = ()
    high: Sequence[float] = ()
    bottom: float | None = 0.0
    top: float | None = None


@dataclass(frozen=True)
class _Buckets:
    """What is drawn: a middle and a range for every place on the x axis."""

    x: Matrix
    middle: Matrix
    low: Matrix
    high: Matrix


def chart(line: Line, x_label: str, failures: Sequence[float] = ()) -> Markup:
    """Draw a line, its band, its axes, and a mark for every failure; for wide and for narrow pages."""
    drawings = [_drawing(kind, line, failures) for kind in WIDTHS]
    paper = {"height": HEIGHT, "left": LEFT, "top": TOP, "bottom": BOTTOM}
    return fragment("survey/chart.html", line=line, x_label=x_label, drawings=drawings, paper=paper)


@dataclass(frozen=True)
class _Drawing:
    """A chart's shapes: places on the paper in SVG units, and the numbers written beside them."""

    kind: str
    width: int
    right: float
    y_ticks: list[tuple[float, float]]
    x_ticks: list[tuple[float, float]]
    failures: list[str]
    bands: list[str]
    strokes: list[list[str]]


def _drawing(kind: str, line: Line, failures: Sequence[float]) -> _Drawing:
    width, buckets = WIDTHS[kind], _bucketed(line, _MOST_POINTS[kind])
    x_axis = _Axis(*_span(line.x), LEFT, width - RIGHT)
    y_axis = _Axis(*_limits(line, buckets), HEIGHT - BOTTOM, TOP)
    most = max(3, int(x_axis.at_high // _TICK_WIDTH))
    return _Drawing(
        kind, width, x_axis.at_high, [(y_axis(value), value) for value in _ticks(y_axis.low, y_axis.high)],
        [(x_axis(value), value) for value in _ticks(x_axis.low, x_axis.high, most)],
        list(dict.fromkeys(f"{x_axis(x):.1f}" for x in failures)),
        list(_bands(buckets, x_axis, y_axis)), list(_strokes(buckets, x_axis, y_axis)),
    )  # fmt: skip


@dataclass(frozen=True)
class _Axis:
    """Values to places on the paper."""

    low: float
    high: float
    at_low: float
    at_high: float

    def __call__(self, value: float) -> float:
        share = (value - self.low) / (self.high - self.low)
        return self.at_low + share * (self.at_high - self.at_low)


def _span(values: Sequence[float]) -> tuple[float, float]:
    low, high = float(min(values)), float(max(values))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def _limits(line: Line, buckets: _Buckets) -> tuple[float, float]:
    drawn = np.concatenate([buckets.low, buckets.high])
    drawn = drawn[np.isfinite(drawn)]
    low = line.bottom if line.bottom is not None else float(drawn.min(initial=0.0))
    high = line.top if line.top is not None else float(np.quantile(drawn, 0.995)) * 1.08 if drawn.size else low + 1
    return (low, high) if high > low else (low, low + 1.0)


def _bucketed(line: Line, most: int) -> _Buckets:
    x, values = np.asarray(line.x, np.float64), np.asarray(line.values, np.float64)
    low = np.asarray(line.low, np.float64) if len(line.low) else values
    high = np.asarray(line.high, np.float64) if len(line.high) else values
    if len(x) <= most:
        return _Buckets(x, values, low, high)
    parts = np.array_split(np.arange(len(x)), most)
    made = [(x[p].mean(), _of(np.median, values[p]), _of(np.min, low[p]), _of(np.max, high[p])) for p in parts]
    return _Buckets(*(np.array(column) for column in zip(*made, strict=True)))


def _of(function: object, values: Matrix) -> float:
    there = values[np.isfinite(values)]
    return float(function(there)) if there.size else math.nan  # type: ignore[operator]


def _ticks(low: float, high: float, most: int = _TICKS) -> Iterator[float]:
    """Round numbers within the limits: 1, 2 or 5 times a power of ten apart."""
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw)
    first = math.ceil(low / step - 1e-9)
    for k in range(first, math.floor(high / step + 1e-9) + 1):
        yield round(k * step, 12)


def _runs(there: NDArray[np.bool_]) -> Iterator[slice]:
    """Stretches without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(there, np.int8), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(stop))


def _bands(buckets: _Buckets, x_axis: _Axis, y_axis: _Axis) -> Iterator[str]:
    for run in _runs(np.isfinite(buckets.low) & np.isfinite(buckets.high)):
        upper = [_point(x, y, x_axis, y_axis) for x, y in zip(buckets.x[run], buckets.high[run], strict=True)]
        lower = [_point(x, y, x_axis, y_axis) for x, y in zip(buckets.x[run], buckets.low[run], strict=True)]
        yield " ".join(upper + lower[::-1])


def _strokes(buckets: _Buckets, x_axis: _Axis, y_axis: _Axis) -> Iterator[list[str]]:
    for run in _runs(np.isfinite(buckets.middle)):
        yield [_point(x, y, x_axis, y_axis) for x, y in zip(buckets.x[run], buckets.middle[run], strict=True)]


def _point(x: float, y: float, x_axis: _Axis, y_axis: _Axis) -> str:
    """On the paper; what lies beyond the axis stops at its end."""
    v = min(max(y_axis(y), TOP), HEIGHT - BOTTOM)
    return f"{x_axis(x):.1f},{v:.1f}"
