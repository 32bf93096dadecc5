"""Parts of the report that show frames as pictures: the worst, the failures, a contact sheet."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from html import escape

from uw_recon_ros.survey.store import Row, Store, succeeded
from uw_recon_ros.survey.tables import failures
from uw_recon_ros.survey.write import PREVIEWS, frame_name

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


def percent(value: float | None) -> str:
    """A share, 0 to 1, in words."""
    return "\u2013" if value is None else f"{100 * value:.0f} %"


def number(value: float | None, unit: str) -> str:
    """A value with its unit."""
    return "\u2013" if value is None else f"{value:.3g} {unit}"
