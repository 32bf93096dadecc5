"""The page of a calibration: what it is worth, what it was made of, what to do better."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uw_recon_ros.report.colors import ColorBar, colorize
from uw_recon_ros.report.numbers import measured
from uw_recon_ros.report.page import Figure, Section, Summary, write_page
from uw_recon_ros.types import ByteImage, Matrix

Points = Sequence[tuple[Matrix, Matrix]]

_WIDTH = 900  # px, of a drawing
_CELLS = (12, 9)
_PAPER, _INK, _FRAME = (255, 255, 255), (38, 70, 140), (150, 150, 150)
_ARROW = 0.03  # of the drawing's width, for the arrow of a large residual


def write_calibration_page(
    path: str | Path, report: Mapping[str, Any], points: tuple[Points, Points], notes: Sequence[str] = ()
) -> None:
    """Write the page.

    Parameters
    ----------
    path : path
    report : mapping
        What ``calibration.json`` holds.
    points : two of sequence of (pixels, residuals)
        (N, 2) px each, of every pair in the left and in the right image.
    notes : sequence of str
        What could not be read.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    size = int(report["image_width"]), int(report["image_height"])
    sections = [
        _depth(report), _advice(report), _coverage(report, points, size),
        _residuals(points, size, float(report["noise_px"])), _ports(report), _numbers(report), _pairs(report),
        _left_out(report, notes),
    ]  # fmt: skip
    write_page(path, "Calibration of a stereo rig", _summary(report), [s for s in sections if s is not None])


def _summary(report: Mapping[str, Any]) -> Summary:
    held = report["held_out"]
    facts = [
        ("Pairs used", f"{len(report['pairs'])} of {len(report['pairs']) + len(report['left_out'])}"),
        ("Reprojection error", f"{report['rms_px']:.2f} px"),
        ("Reprojection error of held-out pairs", "not checked" if held is None else f"{held['rms_px']:.2f} px"),
        ("Baseline", _baseline(report)),
        *((f"Depth error at {e['range_m']:g} m", _percent(e["mean_percent"])) for e in report["depth_errors"]
          if e["range_m"] in (1.0, 3.0)),
    ]  # fmt: skip
    medium = "an untold medium" if report["medium"] == "unknown" else report["medium"]
    medium += ", then in water behind flat ports," if report["ports"] else ""
    size = f"{report['image_width']} x {report['image_height']} px"
    lead = f"Made in {medium} with a {report['board']['text']}, {size}."
    alarms = tuple(w["text"] for w in report["warnings"] if w["severity"] == "unreliable")
    warnings = tuple(w["text"] for w in report["warnings"] if w["severity"] == "warn")
    return Summary(lead, facts, warnings, alarms)


def _baseline(report: Mapping[str, Any]) -> str:
    if report["baseline_m"] is None:
        return "not known"
    return f"{1000 * report['baseline_m']:.2f} ± {1000 * report['baseline_sigma_m']:.2f} mm"


def _percent(value: float | None) -> str:
    if value is None:
        return "not known"
    return "over 100 %" if value > 100 else f"{value:.2g} %"


def _depth(report: Mapping[str, Any]) -> Section:
    if not report["depth_errors"]:
        return Section("Depth error", "Not known: the size of the board's squares was not given, nothing is in metres.")
    text = (
        "One standard deviation of depth by the calibration alone, from its covariance, as a percentage of the "
        "distance; matching adds its own. The covariance is that of whole pairs, whose points err alike. It holds as "
        "far as the camera model does: held-out pairs check that. The "
        "mean is over what both cameras see at that distance."
    )
    rows = [
        (
            f"{e['range_m']:g} m",
            _percent(e["middle_percent"]),
            _percent(e["mean_percent"]),
            _percent(e["worst_percent"]),
        )
        for e in report["depth_errors"]
    ]
    return Section("Depth error", text, rows=rows, header=("distance", "in the middle", "mean", "at the worst place"))


def _advice(report: Mapping[str, Any]) -> Section:
    held = report["held_out"]
    if held is None:
        return Section("Held-out pairs", "Not checked: there are fewer than eight pairs.")
    rows = [
        ("Reprojection error (pairs left out of the fit)", f"{held['rms_px']:.3f} px"),
        ("Reprojection error (all pairs in the fit)", f"{report['rms_px']:.3f} px"),
        ("Lengths across the board, median error", f"{held['length_percent']:.2f} %"),
        ("Lengths across the board, mean signed error", f"{held['length_bias_percent']:+.2f} %"),
    ]
    text = "Every fifth pair is judged by a calibration that has not seen it, five times over."
    return Section("Held-out pairs", text, rows=rows)


def _coverage(report: Mapping[str, Any], points: tuple[Points, Points], size: tuple[int, int]) -> Section:
    figures = [
        Figure(_dots(side, size), name, f"{sum(len(pixels) for pixels, _ in side)} points, a colour for each pair.")
        for name, side in zip(("Left image", "Right image"), points, strict=True)
    ]
    text = (
        "Where the board was seen, and how much of each image lies near its points: within 5 % of the image's "
        "diagonal. A corner is a fifth of the image wide and high. Empty corners are where depth is least known."
    )
    told = report["coverage"]
    names = ("image", *told["left"]["corners"])
    rows = [
        (f"{name} corner" if name in told["left"]["corners"] else "whole image",
         *(f"{told[side]['corners'].get(name, told[side]['image']):.0%}" for side in ("left", "right")))
        for name in names
    ]  # fmt: skip
    return Section("Coverage", text, figures, rows, ("near points of the board", "left", "right"))


def _sheet(size: tuple[int, int]) -> tuple[ByteImage, float]:
    scale = _WIDTH / size[0]
    sheet = np.full((round(size[1] * scale), _WIDTH, 3), _PAPER, np.uint8)
    cv2.rectangle(sheet, (0, 0), (_WIDTH - 1, sheet.shape[0] - 1), _FRAME, 2)
    return sheet, scale


def _dots(side: Points, size: tuple[int, int]) -> ByteImage:
    sheet, scale = _sheet(size)
    for k, (pixels, _) in enumerate(side):
        color = tuple(int(c) for c in _hue(k / max(len(side), 1)))
        for u, v in np.rint(scale * pixels).astype(int):
            cv2.circle(sheet, (int(u), int(v)), 4, color, -1, cv2.LINE_AA)
    return sheet


def _hue(share: float) -> ByteImage:
    pixel = np.array([[[round(179 * share), 190, 190]]], np.uint8)
    color: ByteImage = np.asarray(cv2.cvtColor(pixel, cv2.COLOR_HSV2RGB), np.uint8)[0, 0]
    return color


def _residuals(points: tuple[Points, Points], size: tuple[int, int], noise: float) -> Section:
    figures = []
    for name, side in zip(("Left image", "Right image"), points, strict=True):
        caption = (
            "Mean reprojection error in each part of the image; an arrow of a cell's width is "
            f"{_arrow_px(noise):.2g} px."
        )
        figures.append(Figure(_arrows(side, size, noise), name, caption))
    rows, bar = _rows(points, size, noise)
    figures.append(
        Figure(
            rows,
            "Rows, left minus right",
            "Mean reprojection error across the baseline, where the left camera sees it.",
            bar,
        )
    )
    text = (
        "What is left after the fit. Arrows in all directions are noise; arrows that agree over a part of the image "
        "are a lens that the model does not describe, a board that is not flat, or cameras not triggered together."
    )
    return Section("Residuals", text, figures)


def _arrow_px(noise: float) -> float:
    return max(2 * noise, 1e-6)


def _cells(pixels: Matrix, values: Matrix, size: tuple[int, int]) -> tuple[Matrix, Matrix]:
    """Mean value and count in each cell, (rows, columns)."""
    limits = ((0, size[1]), (0, size[0]))
    bins = (_CELLS[1], _CELLS[0])
    counts, _, _ = np.histogram2d(pixels[:, 1], pixels[:, 0], bins=bins, range=limits)
    sums, _, _ = np.histogram2d(pixels[:, 1], pixels[:, 0], bins=bins, range=limits, weights=values)
    with np.errstate(invalid="ignore", divide="ignore"):
        return sums / counts, counts


def _arrows(side: Points, size: tuple[int, int], noise: float) -> ByteImage:
    sheet, scale = _sheet(size)
    pixels, misses = (np.concatenate(part) for part in zip(*side, strict=True))
    across, counts = _cells(pixels, misses[:, 0], size)
    down, _ = _cells(pixels, misses[:, 1], size)
    cell = _WIDTH / _CELLS[0]
    for row, column in np.argwhere(counts >= 3):
        start = scale * np.array([(column + 0.5) * size[0] / _CELLS[0], (row + 0.5) * size[1] / _CELLS[1]])
        end = start + cell / _arrow_px(noise) * np.array([across[row, column], down[row, column]])
        ends = [tuple(int(x) for x in np.rint(at)) for at in (start, end)]
        cv2.arrowedLine(sheet, ends[0], ends[1], _INK, 2, cv2.LINE_AA, tipLength=0.3)
    return sheet


def _rows(points: tuple[Points, Points], size: tuple[int, int], noise: float) -> tuple[ByteImage, ColorBar]:
    paired = [
        (left[0], left[1][:, 1] - right[1][:, 1])
        for left, right in zip(*points, strict=True)
        if len(left[0]) == len(right[0])
    ]
    bar = ColorBar(-2 * noise, 2 * noise, "px", "diverging", "row residual, left minus right")
    if not paired:
        return _sheet(size)[0], bar
    pixels, misses = (np.concatenate(part) for part in zip(*paired, strict=True))
    means, _ = _cells(pixels, misses, size)
    cells = colorize(means.astype(np.float32), bar)
    height = round(_WIDTH * size[1] / size[0])
    return np.asarray(cv2.resize(cells, (_WIDTH, height), interpolation=cv2.INTER_NEAREST), np.uint8), bar


def _numbers(report: Mapping[str, Any]) -> Section:
    rows = []
    names = [name.removeprefix("left_") for name in report["parameters"] if name.startswith("left_")]
    for name in [name for name in names if f"right_{name}" in report["parameters"] and not name.startswith("lean")]:
        rows.append((name, *(_value(report, f"{side}_{name}") for side in ("left", "right"))))
    rows += [("baseline", _baseline(report), ""), ("model of the lenses", report["distortion_model"], "")]
    text = "Value and standard deviation; calibration.json has all of them with their covariance."
    return Section("Numbers", text, rows=rows, header=("", "left", "right"))


def _value(report: Mapping[str, Any], name: str) -> str:
    value, sigma = report["parameters"][name], report["sigmas"][name]
    return "0 (held)" if sigma == 0 else f"{value:.6g} ± {sigma:.2g}"


def _ports(report: Mapping[str, Any]) -> Section | None:
    ports = report["ports"]
    if ports is None:
        return None
    sigmas, found = report["sigmas"], report["parameters"]
    rows = [
        ("from the lens to the pane", f"{1000 * ports['distance_m']:.1f} ± {1000 * sigmas['port_distance']:.1f} mm"),
        ("thickness (told)", f"{1000 * ports['thickness_m']:.1f} mm"),
        ("indices of pane and water (told)", f"{ports['glass']:g}, {ports['water']:g}"),
    ]
    for side in ("left", "right"):
        names = [f"{side}_lean_{axis}" for axis in "xy"]
        turns = (f"{np.rad2deg(found[name]):.2f} ± {np.rad2deg(sigmas[name]):.2f}°" for name in names)
        rows.append((f"{side} pane turned to the right, down", ", ".join(turns)))
    text = (
        "Found from the board in water; the rig's own numbers moved as far as their covariance in air let them. Given "
        "calibration.json, pair and survey trace rays through these ports."
    )
    return Section("Flat ports", text, rows=rows)


def _pairs(report: Mapping[str, Any]) -> Section:
    rows = [
        (
            pair["name"], f"{pair['points_left']} / {pair['points_right']}", f"{pair['rms_px']:.2f} px",
            f"{pair['tilt_deg']:.0f}°", "" if pair["distance_m"] is None else measured(pair["distance_m"], "m"),
        )
        for pair in report["pairs"]
    ]  # fmt: skip
    return Section("Pairs", "", rows=rows, header=("pair", "points", "reprojection error", "tilt", "distance"))


def _left_out(report: Mapping[str, Any], notes: Sequence[str]) -> Section | None:
    rows = [(out["name"], out["text"]) for out in report["left_out"]] + [("", note) for note in notes]
    return Section("Left out", "", rows=rows, header=("pair", "why")) if rows else None
