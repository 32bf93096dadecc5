"""``report.html``: a survey at a glance, offline, in one file; the surfaces of frames are pages beside it.

The one shown first is inside the file, so that the report can be sent alone.
"""

from __future__ import annotations

import base64
import itertools
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from markupsafe import Markup

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.report.content import Summary
from uw_recon_ros.report.shell import (
    CLICK_SCRIPTS,
    MAP_SCRIPTS,
    MEASURE_SCRIPTS,
    PAGE_SCRIPTS,
    PAGE_STYLES,
    PLATE_SCRIPTS,
    RULER_SCRIPTS,
    VIEW_SCRIPTS,
    render,
)
from uw_recon_ros.survey.charts import LEFT, RIGHT, Line, chart
from uw_recon_ros.survey.store import PREVIEWS, UNRELIABLE, VIEWS, Row, Store, frame_name, succeeded
from uw_recon_ros.survey.tables import failures

_FRAMED = CLICK_SCRIPTS + RULER_SCRIPTS + VIEW_SCRIPTS + PLATE_SCRIPTS + MAP_SCRIPTS + MEASURE_SCRIPTS

MODEL, PAGE = "model", "report.html"  # where the model of a survey, and its page, are
_ON_SHEET = 96
_WORST = 40
_FAILURES_SHOWN = 6
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


def show_model(root: str | Path) -> None:
    """Write the page of a finished survey again, with the model that was made of it first.

    Raises
    ------
    SurveyError
        The survey is being written to.
    """
    with Store(root) as store:
        made = json.loads((store.root / "report.json").read_text(encoding="utf-8"))
        write_report(store, [row for _, row in sorted(store.rows().items())], made)


def _model(store: Store) -> str:
    """The model's page, where there is one."""
    page = store.root / MODEL / PAGE
    return page.read_text(encoding="utf-8") if page.is_file() else ""


def render_report(store: Store, rows: list[Row], made: dict[str, Any]) -> str:
    """Build the page; see `write_report`."""
    ok = [row for row in rows if succeeded(row)]
    seconds, stamped = _times(rows)
    step = max(1, math.ceil(len(rows) / _ON_SHEET))
    return render(
        "survey/report.html",
        styles=(*PAGE_STYLES, "survey/survey.css"), scripts=(*PAGE_SCRIPTS, "survey/survey.js"),
        framed=_FRAMED, frames=True,
        title="Survey of " + ", ".join(made["input"]),
        summary=_summary(made, rows, ok), model=_model(store),
        chosen=_chosen(store, rows, ok, seconds, made, stamped=stamped), has_views=any(map(_has_view, ok)),
        charts=_charts(rows, *_axis(seconds, stamped=stamped), made),
        worst=[_frame(store, row, _unit(made)) for row in _worst(ok)],
        failures=[_failure(store, group) for group in failures(rows)],
        sheet=[_frame(store, row) for row in rows[::step]],
        sheet_words="Every frame" if step == 1 else f"Every {step}th frame",
        origin=_origin(made),
    )  # fmt: skip


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


def _summary(made: dict[str, Any], rows: list[Row], ok: list[Row]) -> Summary:
    unit = _unit(made)
    failed = len(rows) - len(ok)
    facts = [
        ("frames reconstructed", f"{len(ok)} of {len(rows)}"),
        ("density, median", percent(_middle(made["density"]))),
        ("vertical (epipolar) error, median", number(_middle(made["row_error_median_px"]), "px")),
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
    lead = f"{counted(made['frames']['pairs_in_input'], 'pair')} in the input, {len(rows)} chosen."
    return Summary(lead, facts, warnings, alarms)


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
    return json.dumps(data)


def _has_view(row: Row) -> bool:
    return any(name.startswith(f"{VIEWS}/") for name in row["files"])


def _compact(row: Row, second: float) -> list[Any]:
    reason = "" if succeeded(row) else row["reason"]
    numbers = [row.get(name) for name in ("density", "row_error_median_px", "depth_p50")]
    rounded = [None if value is None else round(value, 4) for value in numbers]
    return [row["frame"], round(second, 3), *rounded, int(_has_view(row)), reason]


def _charts(rows: list[Row], x: list[float], label: str, made: dict[str, Any]) -> list[Markup]:
    failed = [second for row, second in zip(rows, x, strict=True) if not succeeded(row)]
    low, high = _column(rows, "depth_p05"), _column(rows, "depth_p95")
    lines = [
        Line("Density", "%", x, [100 * value for value in _column(rows, "density")], top=100.0),
        Line("Vertical (epipolar) error, each frame's median", "px", x, _column(rows, "row_error_median_px")),
        Line("Depth: median, 5 to 95 %", _unit(made), x, _column(rows, "depth_p50"), low, high),
        Line("Time a frame took", "s", x, _column(rows, "seconds")),
    ]
    return [chart(line, label, failed) for line in lines]


def _worst(ok: list[Row]) -> list[Row]:
    """Frames with the least density, the worst first."""
    return sorted(ok, key=lambda row: (row["density"], -(row["row_error_median_px"] or 0.0)))[:_WORST]


def _frame(store: Store, row: Row, unit: str = "") -> dict[str, Any]:
    """What the page shows of a frame: its picture, words, and, where it has a unit, its line in the table."""
    ok = succeeded(row)
    words = f"{row['frame']} · {percent(row['density'])}" if ok else f"{row['frame']} · {row['reason']}"
    shown = {"number": row["frame"], "ok": ok, "words": words, "preview": _preview(store, row)}
    return shown | ({"cells": _cells(row, unit)} if unit else {})


def _cells(row: Row, unit: str) -> list[str]:
    searched = f"{row['min_disparity']} to {row['max_disparity']} px"
    row_error, depth = number(row["row_error_median_px"], "px"), number(row["depth_p50"], unit)
    return [percent(row["density"]), row_error, depth, searched, str(row["triangles"] or "")]


def _preview(store: Store, row: Row) -> str:
    name = f"{PREVIEWS}/{frame_name(row['frame'])}.jpg"
    if name not in row["files"]:
        return ""
    return f"data:image/jpeg;base64,{base64.b64encode((store.root / name).read_bytes()).decode()}"


def _failure(store: Store, group: list[Row]) -> dict[str, Any]:
    """Frames that could not be reconstructed for one reason."""
    return {
        "count": len(group),
        "reason": group[0]["reason"],
        "numbers": _ranges([row["frame"] for row in group]),
        "frames": [_frame(store, row) for row in group[:_FAILURES_SHOWN]],
    }


def _ranges(numbers: Sequence[int], most: int = 24) -> str:
    """``3, 5-9, 12``."""
    runs: list[list[int]] = []
    for value in numbers:
        if runs and value == runs[-1][-1] + 1:
            runs[-1][1:] = [value]
        else:
            runs.append([value])
    texts = ["-".join(map(str, run)) for run in runs]
    return ", ".join(texts[:most]) + (" ..." if len(texts) > most else "")


def _column(rows: list[Row], name: str) -> list[float]:
    values = (row.get(name) if succeeded(row) else None for row in rows)
    return [math.nan if value is None else float(value) for value in values]


def _origin(made: dict[str, Any]) -> list[tuple[str, list[tuple[str, Any]]]]:
    """What it was made from, to the last bit: tables by title."""
    files_of = [
        (f"{name}: {file}", digest) for name, inside in made["input"].items() for file, digest in inside.items()
    ]
    return [
        ("Input, SHA-256", files_of),
        ("Rigs", [(f"rig {name}", json.dumps(rig)) for name, rig in made["rigs"].items()]),
        ("Survey", list(made["survey"].items())),
        ("Parameters", list(made["parameters"].items())),
        ("Versions", list(made["versions"].items())),
    ]


def _middle(summary: dict[str, float] | None) -> float | None:
    return None if summary is None else summary["median"]


def _median(values: list[float]) -> float | None:
    return sorted(values)[len(values) // 2] if values else None


def counted(count: int, noun: str) -> str:
    """``1 pair``, ``2 pairs``."""
    return f"{count} {noun}" + ("" if count == 1 else "s")


def percent(value: float | None) -> str:
    """A share, 0 to 1, in words."""
    return "\u2013" if value is None else f"{100 * value:.0f} %"


def number(value: float | None, unit: str) -> str:
    """A value with its unit."""
    return "\u2013" if value is None else f"{value:.3g} {unit}"
