"""The page of one reconstructed pair: what every stage made of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.findings import Severity, severe
from uw_recon_ros.report.colors import ColorBar, colorize, reasons_in, robust_limits
from uw_recon_ros.report.content import Clickable, clicks_section
from uw_recon_ros.report.figures import (
    as_byte_rgb,
    colorize_depth,
    colorize_disparity,
    depth_bar,
    depth_unit,
    disparity_bar,
    epipolar_lines,
    error_bar,
    error_map,
)
from uw_recon_ros.report.numbers import (
    depth_errors,
    error_rows,
    matching_rows,
    measured,
    percent,
    rectification_rows,
    time_rows,
)
from uw_recon_ros.report.page import Figure, Section, Summary, write_page
from uw_recon_ros.types import DepthMap, DisparityMap, EnhancedPair, FloatImage, RectifiedPair, StereoPair, Surface


def write_pair_page(
    path: str | Path,
    raw: StereoPair,
    enhanced: EnhancedPair,
    rectified: RectifiedPair,
    disparity: DisparityMap,
    depth: DepthMap,
    surface: Surface,
    report: Mapping[str, Any] | None = None,
    *,
    clickable: Clickable | None = None,
    truth: FloatImage | None = None,
    title: str = "Stereo reconstruction",
    lead: str = "",
    more: Sequence[Section] = (),
) -> None:
    """Write the page of one pair.

    Parameters
    ----------
    path : path
        Overwritten.
    raw, enhanced, rectified, disparity, depth, surface
        What went in and what every stage made of it.
    report : mapping or None
        Its ``stages_seconds`` (stage name to s) are shown.
    clickable : Clickable or None
        To measure in.
    truth : (H, W) float32 or None
        True depth of the left rectified view, unit of `depth`; NaN or inf = unknown.
    title, lead : str
    more : sequence of Section
        Set after the stages.

    Raises
    ------
    OSError
        The file cannot be written.
    ValueError
        The truth has another size than the depth map.
    """
    seconds = dict((report or {}).get("stages_seconds", {}))
    sections = [
        *([] if clickable is None else [clicks_section(clickable)]),
        _enhancement(raw, enhanced),
        _rectification(rectified),
        _matching(disparity, depth),
        _depth(depth, truth),
        _numbers(depth, surface, seconds),
        *more,
    ]
    summary = _summary(enhanced, rectified, disparity, depth, truth, seconds, lead)
    write_page(path, title, summary, sections, surface)


def _summary(
    enhanced: EnhancedPair,
    rectified: RectifiedPair,
    disparity: DisparityMap,
    depth: DepthMap,
    truth: FloatImage | None,
    seconds: Mapping[str, float],
    lead: str,
) -> Summary:
    height, width = rectified.left.shape[:2]
    facts = [
        ("Scale", "metric" if depth.geometry.metric else "unknown"),
        ("Pixels matched", percent(disparity.density)),
        ("Median depth", _median_depth(depth)),
    ]
    if not np.isnan(rectified.quality.row_error_median_px):
        facts.insert(1, ("Vertical (epipolar) error, median", measured(rectified.quality.row_error_median_px, "px")))
    if truth is not None:
        facts.append(("Depth error, median", measured(depth_errors(depth, truth).median, depth_unit(depth))))
    if seconds:
        facts.append(("Time", f"{sum(seconds.values()):.2f} s"))
    words = lead or f"A {depth.geometry.axis} rig, {width} x {height} pixels after rectification."
    said = severe(enhanced.findings) + rectified.quality.warnings
    alarms = tuple(str(finding) for finding in said if finding.severity >= Severity.UNRELIABLE)
    warnings = tuple(str(finding) for finding in said if finding.severity < Severity.UNRELIABLE)
    return Summary(words, facts, warnings + _no_scale(depth), alarms)


def _median_depth(depth: DepthMap) -> str:
    finite = depth.depth[np.isfinite(depth.depth)]
    return measured(float(np.median(finite)), depth_unit(depth)) if finite.size else "unknown"


def _no_scale(depth: DepthMap) -> tuple[str, ...]:
    unknown = (
        "The scale is not known: without a calibration, or a baseline and an in-water focal length, the shape is shown "
        "in units of the rig's baseline, under an assumed focal length. Nothing on this page is in metres."
    )
    return () if depth.geometry.metric else (unknown,)


def _enhancement(raw: StereoPair, enhanced: EnhancedPair) -> Section:
    figures = [
        Figure(as_byte_rgb(after), f"{name} image", "Move the slider to compare.", over=as_byte_rgb(before),
               labels=("raw", "enhanced"))
        for name, before, after in (("Left", raw.left, enhanced.left), ("Right", raw.right, enhanced.right))
    ]  # fmt: skip
    text = (
        "Moire notched, light evened out by a homomorphic filter, wavelet and anisotropic denoising, contrast and "
        "colour adjusted, with the same statistics for both cameras."
    )
    return Section("Enhancement", text, figures)


def _rectification(rectified: RectifiedPair) -> Section:
    axis = rectified.geometry.axis
    lines = "rows" if axis == "horizontal" else "columns"
    figure = Figure(
        epipolar_lines(rectified.left, rectified.right, axis),
        "Rectified pair with epipolar lines",
        f"Matching points lie on the same line: after rectification the views share their {lines}.",
        wide=True,
    )
    return Section("Rectification", "", [figure], rectification_rows(rectified.quality))


def _matching(disparity: DisparityMap, depth: DepthMap) -> Section:
    known = ColorBar(0.0, robust_limits(disparity.sigma, 0.02)[1], "px", "magma", "standard deviation of the disparity")
    figures = [
        Figure(
            colorize_disparity(disparity),
            "Disparity",
            "Near is bright. Pixels without a disparity are grey, by reason.",
            disparity_bar(disparity),
            reasons_in(disparity.disparity, disparity.status),
        ),
        Figure(
            colorize(disparity.sigma, known, disparity.status),
            "Uncertainty",
            "What the matcher states of its own precision.",
            known,
        ),
    ]
    return Section("Dense matching", "", figures, matching_rows(disparity, depth))


def _depth(depth: DepthMap, truth: FloatImage | None) -> Section:
    bar = depth_bar(depth, truth)
    caption = "Along the optical axis; near is bright. Filtered for spatial coherence without crossing discontinuities."
    figures = [Figure(colorize_depth(depth, bar), "Depth", caption, bar, reasons_in(depth.depth, depth.status))]
    if truth is None:
        return Section("Depth", "", figures)
    figures += [
        Figure(colorize(truth, bar), "True depth", "In the same colours.", bar),
        Figure(error_map(depth, truth), "Depth minus truth", "Grey where either is missing.", error_bar(depth, truth)),
    ]
    return Section("Depth against the truth", "", figures, error_rows(depth_errors(depth, truth), depth_unit(depth)))


def _numbers(depth: DepthMap, surface: Surface, seconds: Mapping[str, float]) -> Section:
    rows = [
        ("Surface", f"{len(surface.vertices)} vertices, {len(surface.faces)} triangles"),
        ("Unit of all lengths", depth_unit(depth) + ("" if depth.geometry.metric else " (scale unknown)")),
        ("Frame", surface.frame_id or "left camera"),
        *time_rows(seconds),
    ]
    return Section("Numbers", "", (), rows)
