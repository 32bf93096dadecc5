"""``frames.csv``, ``timing.csv``: a row a pair. ``report.json``: what was made from what.

All but the times are the same whenever the same input, parameters and versions are used.
"""

from __future__ import annotations

import csv
import hashlib
import io
import json
import re
from collections import defaultdict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.files.atomic import finite
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.survey.products import QUANTILES
from uw_recon_ros.survey.store import UNRELIABLE, Row, succeeded

COLUMNS = (
    "frame", "source", "stamp_ns", "status", "reason", "density", "row_error_median_px", "row_error_p95_px",
    "residual_row_px", *(f"depth_p{q:02d}" for q in QUANTILES), "depth_density", "scale", "points", "triangles",
    "min_disparity", "max_disparity", "method", "energy", "rectification", "lag_ms", "moved_mm", "warnings", "seconds",
)  # fmt: skip
STAGE_COLUMNS = ("read", "preprocess", "rectify", "match", "depth", "cloud", "surface", "write")
#: Columns and files whose bytes differ from run to run.
TIMES = ("frames.csv: seconds", "timing.csv", "run.json", "report.html")
_DIGITS = 6
_NUMBER = re.compile(r"[0-9]+([.,][0-9]+)*")


def frames_csv(rows: Iterable[Row]) -> bytes:
    """The rows as RFC 4180, numbers to six digits."""
    return _csv(COLUMNS, ([_text(_cell(row, name)) for name in COLUMNS] for row in rows))


def _cell(row: Row, name: str) -> Any:
    return " ".join(codes(row)) if name == "warnings" else row.get(name)


def codes(row: Row) -> list[str]:
    """What was found of a frame, by code, each once."""
    return list(dict.fromkeys(finding["code"] for finding in row.get("findings", [])))


def warnings(rows: Iterable[Row]) -> list[dict[str, Any]]:
    """Every code that occurs, the number of its frames, and the words of the first; the worst first."""
    found: dict[str, dict[str, Any]] = {}
    for row in rows:
        for code in codes(row):
            first = next(finding for finding in row["findings"] if finding["code"] == code)
            entry = found.setdefault(code, {**first, "frames": 0, "first_frame": row["frame"]})
            entry["frames"] += 1
    return sorted(found.values(), key=lambda entry: (entry["severity"] != UNRELIABLE, -entry["frames"]))


def timing_csv(rows: Iterable[Row]) -> bytes:
    """Seconds of every stage, and the most memory its process had needed until then."""
    lines = (
        [row["frame"], *(_text(row["stages_seconds"].get(name)) for name in STAGE_COLUMNS), _text(row.get("peak_mb"))]
        for row in rows
    )
    return _csv(("frame", *STAGE_COLUMNS, "peak_mb"), lines)


def _csv(header: Iterable[str], lines: Iterable[Iterable[Any]]) -> bytes:
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(header)
    writer.writerows(lines)
    return stream.getvalue().encode()


def _text(value: Any) -> str:
    if value is None:
        return ""
    return f"{value:.{_DIGITS}g}" if isinstance(value, float) else str(value)


def report(
    settings: Mapping[str, Any],
    rows: list[Row],
    rectifications: Mapping[int, Rectification],
    pairs: int,
    notes: list[str],
    unreadable: list[str],
) -> dict[str, Any]:
    """What ``report.json`` holds."""
    ok = [row for row in rows if succeeded(row)]
    return {
        "input_sha256": _together(settings["input"]),
        **settings,
        "seed": {name: value for name, value in settings["parameters"].items() if name.endswith("seed")},
        "frames": {
            "pairs_in_input": pairs,
            "chosen": len(rows),
            "ok": len(ok),
            "unreliable": sum(row["status"] == UNRELIABLE for row in rows),
            "failed": len(rows) - len(ok),
            "reasons": {group[0]["reason"]: len(group) for group in failures(rows)},
        },
        "warnings": warnings(ok),
        "reliable": all(row["status"] != UNRELIABLE for row in ok),
        "scale": sorted({row["scale"] for row in ok}),
        "density": _summary(ok, "density"),
        "row_error_median_px": _summary(ok, "row_error_median_px"),
        "depth_p50": _summary(ok, "depth_p50"),
        "partners": _partners(ok),
        "rigs": {str(rig): _rig(found) for rig, found in sorted(rectifications.items())},
        "notes": notes,
        "unreadable": unreadable,
        "times": {"not the same from run to run": list(TIMES)},
    }


def _together(inputs: Mapping[str, Mapping[str, str]]) -> str:
    """One digest of all files and their names."""
    listed = sorted(f"{name}/{file} {digest}" for name, inside in inputs.items() for file, digest in inside.items())
    return hashlib.sha256("\n".join(listed).encode()).hexdigest()


def failures(rows: Iterable[Row]) -> list[list[Row]]:
    """Failed frames by reason, the most frequent first; reasons that differ in numbers only are one."""
    groups: dict[str, list[Row]] = defaultdict(list)
    for row in rows:
        if not succeeded(row):
            groups[_NUMBER.sub("#", row["reason"])].append(row)
    return sorted(groups.values(), key=len, reverse=True)


def _summary(rows: list[Row], name: str) -> dict[str, float] | None:
    """Least, median and greatest of a column."""
    values = [row[name] for row in rows if row[name] is not None]
    if not values:
        return None
    return {"least": min(values), "median": float(np.median(values)), "greatest": max(values)}


def _partners(rows: list[Row]) -> dict[str, Any] | None:
    """Pairs whose images were not taken at one moment, and what the rig did meanwhile."""
    late = [row for row in rows if row.get("lag_ms") is not None]
    if not late:
        return None
    lags = [abs(row["lag_ms"]) for row in late]
    known = [abs(row["moved_mm"]) for row in late if row.get("moved_mm") is not None]
    return {
        "not_of_one_moment": len(late),
        "lag_ms": {"median": float(np.median(lags)), "greatest": max(lags)},
        "corrected": len(known),
        "baseline_changed_mm": {"median": float(np.median(known)), "greatest": max(known)} if known else None,
    }


def _rig(found: Rectification) -> dict[str, Any]:
    quality, geometry = found.quality, found.geometry
    return {
        "method": quality.method,
        "row_error_median_px": finite(quality.row_error_median_px),
        "row_error_p95_px": finite(quality.row_error_p95_px),
        "inliers": quality.inliers,
        "medium": quality.medium or None,
        "shape_sigma_percent": finite(quality.shape_sigma_percent),
        "lens_k1": finite(quality.lens_k1),
        "calibration_depth_sigmas": quality.origin.depth_sigmas,
        "warnings": [str(finding) for finding in quality.warnings],
        "axis": geometry.axis,
        "focal_px": geometry.focal_px,
        "baseline_m": geometry.baseline_m,
        "offset_px": geometry.offset_px,
        "width": found.width,
        "height": found.height,
    }


def depth_sigmas(report: Path) -> tuple[tuple[float, float], ...]:
    """What the calibration of a finished survey's rigs leaves unknown of depth: rows of range, m, and fraction.

    Empty where it is not known, or not the same of all rigs.
    """
    if not report.is_file():
        return ()
    rigs = json.loads(report.read_text())["rigs"].values()
    tables = {tuple((float(a), float(b)) for a, b in rig.get("calibration_depth_sigmas", ())) for rig in rigs}
    return tables.pop() if len(tables) == 1 else ()
