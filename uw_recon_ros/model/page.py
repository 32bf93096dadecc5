"""``report.html`` of a model: the surface to turn, the map to measure on, what went wrong."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.findings import Severity
from uw_recon_ros.model.compose import Composed
from uw_recon_ros.model.maps import Overview
from uw_recon_ros.report.colors import ColorBar, colorize, robust_limits
from uw_recon_ros.report.content import Layer, Map, MapLayer, Measured, Overlay, Section, Summary, Track
from uw_recon_ros.report.page import write_page
from uw_recon_ros.trajectory import PoseStatus, Trajectory
from uw_recon_ros.types import ByteImage, FloatImage

_ALARM = Severity.UNRELIABLE.name.lower()
_MOST_SHOWN = 4  # segments
_MOST_POINTS = 4000  # of a track
_STATUS = {
    PoseStatus.TRACKED: ((60, 170, 90), "tracked by features"),
    PoseStatus.BRIDGED: ((240, 160, 30), "bridged by the bottom's shape alone"),
    PoseStatus.PREDICTED: ((211, 55, 58), "interpolated between its neighbours: related to no frame"),
    PoseStatus.GIVEN: ((90, 120, 220), "given from outside"),
}


@dataclass(frozen=True, eq=False)
class SegmentPart:
    """One segment's model: its entry in ``model.json``, what `compose` left, and what ``measure.json`` holds.

    The last two are None where there is no surface.
    """

    entry: dict[str, Any]
    composed: Composed | None
    measurable: dict[str, Any] | None = None


def write_model_page(path: Path, way: Trajectory, parts: Sequence[SegmentPart], made: dict[str, Any]) -> None:
    """Write the page.

    Parameters
    ----------
    path : path
    way : Trajectory
        All frames, less the origin.
    parts : sequence of Part
        The largest first.
    made : dict
        What ``model.json`` holds.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    shown = [part for part in parts if part.composed is not None][:_MOST_SHOWN]
    sections = [section for part in shown for section in _sections(part, way, _up(made), alone=len(parts) == 1)]
    sections += [_wrong(made), _frames(way, made), _segments(parts, unit_of(way))]
    write_page(path, "Model of the dive", _summary(way, parts, made), sections)


def unit_of(way: Trajectory) -> str:
    """Of all lengths."""
    return "m" if way.metric else "baselines"


def _summary(way: Trajectory, parts: Sequence[SegmentPart], made: dict[str, Any]) -> Summary:
    unit, first = unit_of(way), parts[0].entry
    facts = [("Frames in it", f"{sum(part.entry['frames'] for part in parts)} of {len(way)}"),
             ("Track length", f"{path_length(way):.4g} {unit}")]  # fmt: skip
    if parts[0].composed is not None:
        facts += [
            ("Area seen from above", f"{first['area']:.3g} {unit}\u00b2"),
            ("Height uncertainty, median", _small(first["sigma_median"], way.metric)),
            ("Views of a place, median", f"{first['views_median']:.0f}"),
            ("Cell of the map", _small(first["orthomosaic_cell"], way.metric)),
        ]
    told: dict[bool, list[str]] = {True: [], False: []}
    for warning in made["warnings"]:
        told[warning["severity"] == _ALARM].append(_sentence(warning["text"]))
    lead = f"Coordinates: {made['crs']}; scale: {made['scale']}."
    return Summary(lead, facts, told[False], told[True])


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}."


def _small(length: float, metric: bool) -> str:
    return f"{1000 * length:.2g} mm" if metric else f"{length:.2g} baselines"


def path_length(way: Trajectory) -> float:
    """Of all segments together."""
    steps = np.linalg.norm(np.diff(way.positions, axis=0), axis=1)
    return float(steps[np.diff(way.segment) == 0].sum())


def tracks_of(way: Trajectory, segment: int) -> Iterator[Track]:
    """A segment's line, cut where the way of knowing it changes; each piece begins where the one before ends."""
    own = way.picked(way.segment == segment)
    step = max(1, len(own) // _MOST_POINTS)
    cuts = [0, *(np.flatnonzero(np.diff(own.status)) + 1).tolist(), len(own)]
    for start, end in pairwise(cuts):
        color, words = _STATUS[PoseStatus(int(own.status[start]))]
        which = np.r_[max(start - 1, 0) : end : step, end - 1]
        yield Track(own.positions[np.unique(which)], color, words)


def _sections(part: SegmentPart, way: Trajectory, up: str, *, alone: bool) -> Iterator[Section]:
    composed = part.composed
    if composed is None:
        return
    unit, shown, name = unit_of(way), composed.shown, "" if alone else f", segment {part.entry['segment']}"
    layers = [
        _layer("Sigma", shown.sigma, unit, "magma", "standard deviation of the surface"),
        _layer("Views", shown.views, "frames", "viridis", "frames that saw the place"),
    ]
    overlay = Overlay(layers, list(tracks_of(way, part.entry["segment"])), upright=True)
    text = (
        "The line is the left camera's trajectory. Sigma shows the surface's standard deviation, Views how many "
        "frames saw it."
    )
    ruler = f"ruler-{part.entry['segment']}" if part.measurable is not None else ""
    yield Section(f"Surface{name}", text, surface=shown.surface, overlay=overlay, ruler=ruler)
    if part.measurable is not None:
        yield Section(f"Measured{name}", _how_to_measure(part.measurable), measured=Measured(ruler, part.measurable))
    yield Section(f"Map{name}", "", map=map_of(composed.overview, unit, up), ruler=ruler)


def _how_to_measure(told: dict[str, Any]) -> str:
    """Where to click, and what the numbers are worth."""
    earned = "" if told["unit"] == "m" else "Metres are not earned: the scale is unknown, lengths are in baselines. "
    known = (
        "by the calibration. "
        if told["calibration"]
        else "and not by the calibration, whose uncertainty is not known: give calibration.json of uw_recon calibrate. "
    )
    return (
        f"Press Measure and click in the view above, or click in the map below. {earned}"
        "Each result has its standard deviation: by the surface's depths, by the trajectory between the places, by how "
        f"well clicks hit, {known}The numbers are those of uw_recon measure on the folder of this page."
    )


def _up(made: dict[str, Any]) -> str:
    """What lies upwards on a map: north in a projected system alone."""
    return "North is up" if made["crs"].startswith("EPSG:") else "Up is the model's y axis, not known to be north"


def _layer(name: str, found: NDArray[Any], unit: str, colors: str, label: str) -> Layer:
    values = np.asarray(found, np.float64)
    return Layer(name, values, ColorBar(0.0, max(robust_limits(values, 0.02)[1], 1e-9), unit, colors, label))


def map_of(overview: Overview, unit: str, up: str) -> Map:
    """Orthomosaic and heights, to measure on."""
    known = np.where(np.isfinite(overview.heights), 255, 0).astype(np.uint8)
    bar = ColorBar(*robust_limits(overview.heights, 0.02), unit, "viridis", "height")
    relief = colorize(overview.heights, bar) * _light(overview.heights, overview.pixel)[..., None]
    heights: ByteImage = np.dstack([np.clip(relief, 0, 255).astype(np.uint8), known])
    layers = [MapLayer("Orthomosaic", overview.color), MapLayer("Height", heights, bar)]
    return Map(layers, overview.pixel, overview.west, overview.north, unit, up)


def _light(heights: FloatImage, pixel: float) -> FloatImage:
    """Shade of the relief lit from the north-west, about 1 on level ground."""
    known = np.isfinite(heights)
    smooth = cv2.GaussianBlur(np.where(known, heights, np.nanmedian(heights) if known.any() else 0), (0, 0), 1.0)
    down, right = np.gradient(smooth.astype(np.float64), pixel)
    light: FloatImage = np.clip(1 + 0.35 * (down - right) / np.sqrt(1 + down**2 + right**2), 0.55, 1.25).astype(
        np.float32
    )
    return light


def _wrong(made: dict[str, Any]) -> Section:
    rows = [(_sentence(w["text"]), w["severity"], w["code"]) for w in made["warnings"]]
    text = "" if rows else "Nothing that is known of."
    header = ("what, and what to do", "severity", "code") if rows else ()
    return Section("What went wrong", text, rows=rows, header=header)


def _frames(way: Trajectory, made: dict[str, Any]) -> Section:
    counts, found = made["frames"], made["trajectory"]
    rows = [(f"Frames {words}", str(counts[str(status)])) for status, (_, words) in _STATUS.items()]
    rows += [
        ("Frames left out", str(counts["dropped"])),
        ("Places seen again (loops), of so many tried", f"{found['loops']} of {found['loops_tried']}"),
        ("Loops that did not fit the others", str(found["loops_dropped"])),
        ("Uncertainty of the last frame's position, relative to the first", _last_sigma(way)),
    ]
    return Section("Where the vehicle was", "", rows=rows)


def _last_sigma(way: Trajectory) -> str:
    last = np.flatnonzero(way.segment == way.segment[0])[-1]
    spread = float(np.sqrt(np.trace(way.covariances[last][:3, :3])))
    return f"{spread:.2g} {unit_of(way)}" if np.isfinite(spread) else "unknown"


def _segments(parts: Sequence[SegmentPart], unit: str) -> Section:
    header = ("segment", "folder", "frames", "triangles", f"area, {unit}\u00b2", "completeness")
    rows = [_segment_row(part.entry) for part in parts]
    text = "" if len(parts) == 1 else "Where segments lie to each other is not known."
    return Section("Segments", text, rows=rows, header=header)


def _segment_row(entry: dict[str, Any]) -> tuple[str, ...]:
    known = (f"{entry['area']:.3g}", f"{100 * entry['completeness']:.1f} %") if "area" in entry else ("-", "-")
    folder = "model" if entry["folder"] == "." else f"model/{entry['folder']}"
    return (str(entry["segment"]), folder, str(entry["frames"]), str(entry["triangles"]), *known)
