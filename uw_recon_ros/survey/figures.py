"""Parts of the report that are seen: time lines as inline SVG, and frames as pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.survey.store import PREVIEWS, Row, Store, frame_name, succeeded
from uw_recon_ros.survey.tables import failures
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


def chart(line: Line, x_label: str, failures: Sequence[float] = ()) -> str:
    """Draw a line, its band, its axes, and a mark for every failure; for wide and for narrow pages."""
    drawings = "".join(_drawing(kind, line, x_label, failures) for kind in WIDTHS)
    unit = f" [{escape(line.unit)}]" if line.unit else ""
    return f'<figure class="wide"><figcaption><b>{escape(line.title)}</b>{unit}</figcaption>{drawings}</figure>'


def _drawing(kind: str, line: Line, x_label: str, failures: Sequence[float]) -> str:
    width, buckets = WIDTHS[kind], _bucketed(line, _MOST_POINTS[kind])
    x_axis = _Axis(*_span(line.x), LEFT, width - RIGHT)
    y_axis = _Axis(*_limits(line, buckets), HEIGHT - BOTTOM, TOP)
    parts = [
        f'<svg class="chart {kind}" viewBox="0 0 {width} {HEIGHT}" role="img" aria-label="{escape(line.title)}">',
        *_grid(y_axis, x_axis, x_label),
        *_marks(failures, x_axis),
        *_band(buckets, x_axis, y_axis),
        *_strokes(buckets, x_axis, y_axis),
        f'<line class="cursor" y1="{TOP}" y2="{HEIGHT - BOTTOM}" x1="-9" x2="-9"/></svg>',
    ]
    return "".join(parts)


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


def _grid(y_axis: _Axis, x_axis: _Axis, x_label: str) -> Iterator[str]:
    for value in _ticks(y_axis.low, y_axis.high):
        y = y_axis(value)
        yield f'<line class="grid" x1="{LEFT}" x2="{x_axis.at_high:g}" y1="{y:.1f}" y2="{y:.1f}"/>'
        yield f'<text class="y" x="{LEFT - 8}" y="{y + 4:.1f}">{value:g}</text>'
    for value in _ticks(x_axis.low, x_axis.high, max(3, int(x_axis.at_high // _TICK_WIDTH))):
        yield f'<text class="x" x="{x_axis(value):.1f}" y="{HEIGHT - BOTTOM + 18}">{value:g}</text>'
    yield f'<text class="what" x="{x_axis.at_high:g}" y="{HEIGHT - 5}">{escape(x_label)}</text>'


def _ticks(low: float, high: float, most: int = _TICKS) -> Iterator[float]:
    """Round numbers within the limits: 1, 2 or 5 times a power of ten apart."""
    raw = (high - low) / most
    power = 10.0 ** math.floor(math.log10(raw))
    step = next(s * power for s in (1, 2, 5, 10) if s * power >= raw)
    first = math.ceil(low / step - 1e-9)
    for k in range(first, math.floor(high / step + 1e-9) + 1):
        yield round(k * step, 12)


def _marks(failures: Sequence[float], x_axis: _Axis) -> Iterator[str]:
    places = dict.fromkeys(f"{x_axis(x):.1f}" for x in failures)
    for x in places:
        yield f'<line class="failed" x1="{x}" x2="{x}" y1="{HEIGHT - BOTTOM - 9}" y2="{HEIGHT - BOTTOM}"/>'


def _runs(there: NDArray[np.bool_]) -> Iterator[slice]:
    """Stretches without a gap."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], np.asarray(there, np.int8), [0]])))
    for start, stop in zip(edges[::2], edges[1::2], strict=True):
        yield slice(int(start), int(stop))


def _band(buckets: _Buckets, x_axis: _Axis, y_axis: _Axis) -> Iterator[str]:
    for run in _runs(np.isfinite(buckets.low) & np.isfinite(buckets.high)):
        upper = [_point(x, y, x_axis, y_axis) for x, y in zip(buckets.x[run], buckets.high[run], strict=True)]
        lower = [_point(x, y, x_axis, y_axis) for x, y in zip(buckets.x[run], buckets.low[run], strict=True)]
        yield f'<polygon class="band" points="{" ".join(upper + lower[::-1])}"/>'


def _strokes(buckets: _Buckets, x_axis: _Axis, y_axis: _Axis) -> Iterator[str]:
    for run in _runs(np.isfinite(buckets.middle)):
        points = [_point(x, y, x_axis, y_axis) for x, y in zip(buckets.x[run], buckets.middle[run], strict=True)]
        if len(points) == 1:
            x, y = points[0].split(",")
            yield f'<circle class="value" cx="{x}" cy="{y}" r="2.5"/>'
        yield f'<polyline class="value" points="{" ".join(points)}"/>'


def _point(x: float, y: float, x_axis: _Axis, y_axis: _Axis) -> str:
    """On the paper; what lies beyond the axis stops at its end."""
    v = min(max(y_axis(y), TOP), HEIGHT - BOTTOM)
    return f"{x_axis(x):.1f},{v:.1f}"


_ON_SHEET = 96
_WORST, _WORST_ROWS = 12, 40
_FAILURES_SHOWN = 6


def worst_frames(store: Store, ok: list[Row], unit: str) -> str:
    """The frames with the least density, the worst first."""
    ranked = sorted(ok, key=lambda row: (row["density"], -(row["row_error_median_px"] or 0.0)))[:_WORST_ROWS]
    if not ranked:
        return ""
    head = "".join(f"<th>{name}</th>" for name in ("frame", "density", "row error", "depth", "searched", "triangles"))
    lines = "".join(
        f'<tr class="pick" data-frame="{row["frame"]}"><th scope="row">{row["frame"]}</th>'
        f"<td>{percent(row['density'])}</td><td>{number(row['row_error_median_px'], 'px')}</td>"
        f"<td>{number(row['depth_p50'], unit)}</td>"
        f"<td>{row['min_disparity']} to {row['max_disparity']} px</td><td>{row['triangles'] or ''}</td></tr>"
        for row in ranked
    )
    return (
        '<section><h2>Worst frames first</h2><p class="text">By density.</p>'
        f"{_pictures(store, ranked[:_WORST])}"
        f'<details><summary>as a table, the worst {len(ranked)}</summary><div class="tablewrap"><table>'
        f"<thead><tr>{head}</tr></thead><tbody>{lines}</tbody></table></div></details></section>"
    )


def failed_frames(store: Store, rows: list[Row]) -> str:
    """What could not be reconstructed, by reason."""
    groups = failures(rows)
    if not groups:
        return ""
    parts = [
        f"<h3>{len(group)} &times; {escape(group[0]['reason'])}</h3>"
        f"<p class='text'>frames {_ranges([r['frame'] for r in group])}</p>"
        f"{_pictures(store, group[:_FAILURES_SHOWN])}"
        for group in groups
    ]
    return f"<section><h2>Failures</h2>{''.join(parts)}</section>"


def _ranges(numbers: Sequence[int], most: int = 24) -> str:
    """``3, 5-9, 12``."""
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1][1:] = [number]
        else:
            runs.append([number])
    texts = ["-".join(map(str, run)) for run in runs]
    return ", ".join(texts[:most]) + (" ..." if len(texts) > most else "")


def contact_sheet(store: Store, rows: list[Row]) -> str:
    """Pictures of frames spread over the survey."""
    step = max(1, math.ceil(len(rows) / _ON_SHEET))
    words = "Every frame" if step == 1 else f"Every {step}th frame"
    return (
        f'<section><h2>Contact sheet</h2><p class="text">{words}: left view and disparity (bright is near).</p>'
        f"{_pictures(store, rows[::step])}</section>"
    )


def _pictures(store: Store, rows: Iterable[Row]) -> str:
    return f'<div class="sheet">{"".join(_picture(store, row) for row in rows)}</div>'


def _picture(store: Store, row: Row) -> str:
    ok = succeeded(row)
    words = f"{row['frame']} · {percent(row['density'])}" if ok else f"{row['frame']} · {row['reason']}"
    name = f"{PREVIEWS}/{frame_name(row['frame'])}.jpg"
    image = ""
    if name in row["files"]:
        data = base64.b64encode((store.root / name).read_bytes()).decode()
        image = f'<img src="data:image/jpeg;base64,{data}" alt="frame {row["frame"]}" loading="lazy">'
    return (
        f'<button class="{"" if ok else "bad"}" data-frame="{row["frame"]}" title="{escape(words)}">{image}'
        f"<span>{escape(words)}</span></button>"
    )


def counted(count: int, noun: str) -> str:
    """``1 pair``, ``2 pairs``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def percent(value: float | None) -> str:
    """A share, 0 to 1, in words."""
    return "\u2013" if value is None else f"{100 * value:.0f} %"


def number(value: float | None, unit: str) -> str:
    """A value with its unit."""
    return "\u2013" if value is None else f"{value:.3g} {unit}"
