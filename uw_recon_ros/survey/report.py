"""``report.html``: a survey at a glance, offline, in one file; the surfaces of frames are pages beside it.

The one shown first is inside the file, so that the report can be sent alone.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Iterable
from functools import cache
from html import escape
from importlib.resources import files
from typing import Any

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.report.embed import script_safe
from uw_recon_ros.survey.figures import (
    LEFT,
    RIGHT,
    Line,
    chart,
    contact_sheet,
    counted,
    failed_frames,
    number,
    percent,
    worst_frames,
)
from uw_recon_ros.survey.store import UNRELIABLE, VIEWS, Row, Store, frame_name, succeeded

_UNITS = (("h", 3600.0), ("min", 60.0), ("s", 1.0))


def write_report(store: Store, rows: list[Row], made: dict[str, Any]) -> None:
    """Write the page.

    Parameters
    ----------
    store : Store
        Where the previews and views are.
    rows : list of Row
        Of all frames, in order.
    made : dict
        What ``report.json`` holds.
    """
    write_bytes(store.root / "report.html", render_report(store, rows, made).encode(), durable=True)


def render_report(store: Store, rows: list[Row], made: dict[str, Any]) -> str:
    """Build the page; see `write_report`."""
    ok = [row for row in rows if succeeded(row)]
    seconds, stamped = _times(rows)
    body = [
        _top(made, rows, ok),
        _chosen(store, rows, ok, seconds, made, stamped=stamped),
        _time_lines(rows, *_axis(seconds, stamped=stamped), made),
        worst_frames(store, ok, _unit(made)),
        failed_frames(store, rows),
        contact_sheet(store, rows),
        _origin(made),
    ]
    return _frame("Survey of " + ", ".join(made["input"]), body)


@cache
def _asset(room: str, name: str) -> str:
    return files(f"uw_recon_ros.{room}").joinpath(name).read_text(encoding="utf-8")


def _frame(title: str, body: Iterable[str]) -> str:
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_asset('report', 'page.css')}{_asset('survey', 'survey.css')}</style>"
        f"</head><body><div class='page'>{''.join(body)}<footer>Made by uw_recon_ros.</footer></div>"
        '<dialog id="zoom"><img alt=""><p></p></dialog>'
        f"<script>{_asset('report', 'page.js')}</script><script>{_asset('survey', 'survey.js')}</script>"
        "</body></html>\n"
    )


def _times(rows: list[Row]) -> tuple[list[float], bool]:
    """Where each frame stands on the time lines: seconds, or its number where stamps go back; whether seconds."""
    stamps = [row["stamp_ns"] for row in rows]
    if all(a <= b for a, b in itertools.pairwise(stamps)):
        return [(stamp - stamps[0]) / 1e9 for stamp in stamps], True
    return [float(row["frame"]) for row in rows], False


def _axis(seconds: list[float], *, stamped: bool) -> tuple[list[float], str]:
    """The time lines' places in a unit that people read, and its label."""
    if not stamped:
        return seconds, "frame (stamps go back)"
    unit, length = next(((unit, length) for unit, length in _UNITS if max(seconds) >= 5 * length), _UNITS[-1])
    return [second / length for second in seconds], f"{unit} since the first frame"


def _top(made: dict[str, Any], rows: list[Row], ok: list[Row]) -> str:
    unit = _unit(made)
    failed = len(rows) - len(ok)
    facts = [
        ("frames reconstructed", f"{len(ok)} of {len(rows)}"),
        ("density, median", percent(_middle(made["density"]))),
        ("row error, median", number(_middle(made["row_error_median_px"]), "px")),
        ("depth, median", number(_middle(made["depth_p50"]), unit)),
        ("a frame takes", number(_median([row["seconds"] for row in ok]), "s")),
    ]
    warnings = [*made["unreadable"], *made["notes"]]
    alarms = [_told(w) for w in made["warnings"] if w["severity"] == UNRELIABLE]
    warnings += [_told(w) for w in made["warnings"] if w["severity"] != UNRELIABLE]
    warnings += [f"rig: {text}" for rig in made["rigs"].values() for text in rig["warnings"]]
    if failed:
        warnings.insert(0, f"{failed} of {len(rows)} frames could not be reconstructed: see below.")
    if "unknown" in made["scale"]:
        warnings.append("The metric scale is unknown: lengths are in baselines of the rig.")
    cells = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in facts)
    items = "".join(f'<li class="alarm">{escape(text)}</li>' for text in alarms)
    items += "".join(f"<li>{escape(text)}</li>" for text in warnings)
    lead = f"{counted(made['frames']['pairs_in_input'], 'pair')} in the input, {len(rows)} chosen."
    return (
        f'<header class="top"><div><h1>Survey of {escape(", ".join(made["input"]))}</h1>'
        f'<p class="lead">{lead}</p></div>'
        '<button id="theme" title="light or dark" aria-label="light or dark">◐</button></header>'
        + (f'<ul class="warnings">{items}</ul>' if items else "")
        + f'<dl class="facts">{cells}</dl>'
    )


def _told(warning: dict[str, Any]) -> str:
    return f"{counted(warning['frames'], 'frame')}, first {warning['first_frame']}: {warning['text']}"


def _unit(made: dict[str, Any]) -> str:
    return "m" if made["scale"] == ["metric"] else "baselines"


def _chosen(
    store: Store, rows: list[Row], ok: list[Row], seconds: list[float], made: dict[str, Any], *, stamped: bool
) -> str:
    """The frame shown, and all that the page's script needs to show others."""
    seen = [row for row in ok if _has_view(row)]
    shown = max(seen, key=lambda row: row["density"]) if seen else rows[0]
    first = (store.root / VIEWS / f"{frame_name(shown['frame'])}.html").read_text(encoding="utf-8") if seen else ""
    low, high = min(seconds), max(seconds)
    if high <= low:
        low, high = low - 0.5, high + 0.5
    data = {
        "frames": [_compact(row, second) for row, second in zip(rows, seconds, strict=True)],
        "shown": shown["frame"], "first": first, "unit": _unit(made),
        "start": low, "end": high, "left": LEFT, "margin": RIGHT,
        "stamped": stamped,
    }  # fmt: skip
    view = (
        '<iframe class="view" allow="fullscreen" title="surface of the chosen frame"></iframe>'
        if seen
        else "<p>No surfaces were written.</p>"
    )
    return (
        '<section id="view"><h2>Surface of a frame</h2><p class="text">Choose a frame by its number, its picture, '
        "or on a time line; the folder views/ must lie beside this page for frames other than the one shown first.</p>"
        '<div class="chosen"><button id="back" aria-label="previous frame">&lsaquo;</button>'
        '<input id="number" type="number" aria-label="frame">'
        '<button id="next" aria-label="next frame">&rsaquo;</button>'
        f'<span id="says"></span><a id="open" target="_blank">open alone</a></div>{view}'
        f'<script type="application/json" id="survey">{script_safe(json.dumps(data))}</script></section>'
    )


def _has_view(row: Row) -> bool:
    return any(name.startswith(f"{VIEWS}/") for name in row["files"])


def _compact(row: Row, second: float) -> list[Any]:
    reason = "" if succeeded(row) else row["reason"]
    numbers = [row.get(name) for name in ("density", "row_error_median_px", "depth_p50")]
    rounded = [None if value is None else round(value, 4) for value in numbers]
    return [row["frame"], round(second, 3), *rounded, int(_has_view(row)), reason]


def _time_lines(rows: list[Row], x: list[float], label: str, made: dict[str, Any]) -> str:
    failures = [second for row, second in zip(rows, x, strict=True) if not succeeded(row)]
    low, high = _column(rows, "depth_p05"), _column(rows, "depth_p95")
    lines = [
        Line("Density", "%", x, [100 * value for value in _column(rows, "density")], top=100.0),
        Line("Row error, median of each frame's tie points", "px", x, _column(rows, "row_error_median_px")),
        Line("Depth: median, 5 to 95 %", _unit(made), x, _column(rows, "depth_p50"), low, high),
        Line("Time a frame took", "s", x, _column(rows, "seconds")),
    ]
    drawn = "".join(chart(line, label, failures) for line in lines)
    return (
        '<section><h2>Along the dive</h2><p class="text">Red ticks: frames that failed. Click to choose a frame.</p>'
        f'<div class="charts">{drawn}</div></section>'
    )


def _column(rows: list[Row], name: str) -> list[float]:
    values = (row.get(name) if succeeded(row) else None for row in rows)
    return [math.nan if value is None else float(value) for value in values]


def _origin(made: dict[str, Any]) -> str:
    """What it was made from, to the last bit."""
    files_of = [
        (f"{name}: {file}", digest) for name, inside in made["input"].items() for file, digest in inside.items()
    ]
    parts = [
        ("Input, SHA-256", files_of),
        ("Rigs", [(f"rig {name}", json.dumps(rig)) for name, rig in made["rigs"].items()]),
        ("Survey", list(made["survey"].items())),
        ("Parameters", list(made["parameters"].items())),
        ("Versions", list(made["versions"].items())),
    ]
    tables = "".join(
        f"<details><summary>{title}</summary><div class='tablewrap'><table><tbody>"
        + "".join(f"<tr><th scope='row'>{escape(str(a))}</th><td>{escape(str(b))}</td></tr>" for a, b in rows)
        + "</tbody></table></div></details>"
        for title, rows in parts
    )
    return f"<section><h2>Made from</h2>{tables}</section>"


def _middle(summary: dict[str, float] | None) -> float | None:
    return None if summary is None else summary["median"]


def _median(values: list[float]) -> float | None:
    return sorted(values)[len(values) // 2] if values else None
