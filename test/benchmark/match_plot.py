"""Accuracy over time as an SVG, drawn by hand: a point a matcher, error against CPU time."""

from __future__ import annotations

import math
from html import escape
from typing import Any

from match_tables import mean, methods, select

WIDTH, HEIGHT = 760, 440
LEFT, RIGHT, TOP, BOTTOM = 64, 24, 40, 56
OURS, REFERENCE, PEER = "#0a6ebd", "#6b4fa0", "#b0552a"
STYLE = "font-family='Helvetica, Arial, sans-serif'"


def accuracy_over_time(rows: list[dict[str, Any]]) -> str:
    """Mean bad-1 in air and in the hardest water (hollow), over the CPU time of one pair on one thread."""
    air = select(rows, water="air")
    least = min(row["threads"] for row in air)
    wet = [water for water in ("noisy", "snow", "hazy") if select(rows, water=water)]
    points = []
    for method in methods(rows):
        seconds = mean(select(air, method=method, threads=least), "cpu_s")
        errors = [mean(select(air, method=method, threads=least), "bad_1")]
        errors += [mean(select(rows, method=method, water=water), "bad_1") for water in wet[:1]]
        points.append((method, seconds, errors))
    scale = _Scale([p[1] for p in points], [e for p in points for e in p[2]])
    parts = [*_frame(scale, wet[:1]), *(mark for point in points for mark in _marks(*point, scale))]
    parts += _labels([(name, *scale.at(seconds, errors[0])) for name, seconds, errors in points])
    body = "\n".join(parts)
    return (
        f"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 {WIDTH} {HEIGHT}' {STYLE} font-size='12'>\n"
        f"<rect width='{WIDTH}' height='{HEIGHT}' fill='white'/>\n{body}\n</svg>\n"
    )


class _Scale:
    """Logarithmic in both, rounded outwards."""

    def __init__(self, seconds: list[float], errors: list[float]) -> None:
        self.x = math.floor(math.log10(min(seconds))), math.ceil(math.log10(max(seconds) * 1.5))
        self.y = math.log2(min(errors) * 0.8), math.log2(max(errors) * 1.15)

    def at(self, seconds: float, error: float) -> tuple[float, float]:
        across = (math.log10(seconds) - self.x[0]) / (self.x[1] - self.x[0])
        down = (self.y[1] - math.log2(error)) / (self.y[1] - self.y[0])
        return LEFT + across * (WIDTH - LEFT - RIGHT), TOP + down * (HEIGHT - TOP - BOTTOM)


def _text(x: float, y: float, text: str, extra: str = "") -> str:
    return f"<text x='{x:.1f}' y='{y:.1f}' {extra}>{escape(text)}</text>"


def _line(x1: float, y1: float, x2: float, y2: float, color: str, extra: str = "") -> str:
    return f"<line x1='{x1:.1f}' y1='{y1:.1f}' x2='{x2:.1f}' y2='{y2:.1f}' stroke='{color}' {extra}/>"


def _frame(scale: _Scale, wet: list[str]) -> list[str]:
    """Grid, ticks, titles."""
    parts = []
    for power in range(scale.x[0], scale.x[1] + 1):
        x, _ = scale.at(10.0**power, 2.0 ** scale.y[0])
        parts.append(_line(x, TOP, x, HEIGHT - BOTTOM, "#dddddd"))
        parts.append(_text(x, HEIGHT - BOTTOM + 18, f"{10.0**power:g} s", "text-anchor='middle' fill='#444'"))
    for error in (0.5, 1, 2, 3, 4, 6, 8, 12, 16, 24, 32, 48, 64):
        if scale.y[0] <= math.log2(error) <= scale.y[1]:
            _, y = scale.at(10.0 ** scale.x[0], error)
            parts.append(_line(LEFT, y, WIDTH - RIGHT, y, "#eeeeee"))
            parts.append(_text(LEFT - 8, y + 4, f"{error:g} %", "text-anchor='end' fill='#444'"))
    title = "Pixels wrong by more than 1 px (mean of four Middlebury pairs): filled circles in air"
    parts.append(_text(LEFT, 22, title + (f", rings in water ({wet[0]})" if wet else ""), "font-size='13'"))
    parts.append(_text((LEFT + WIDTH - RIGHT) / 2, HEIGHT - 12, "CPU time a pair, one thread", "text-anchor='middle'"))
    return parts


def _color(method: str) -> str:
    return OURS if method.startswith("graph_cut") else REFERENCE if method == "kz2" else PEER


def _marks(method: str, seconds: float, errors: list[float], scale: _Scale) -> list[str]:
    color = _color(method)
    x, y = scale.at(seconds, errors[0])
    parts = [f"<circle cx='{x:.1f}' cy='{y:.1f}' r='5' fill='{color}'/>"]
    for error in errors[1:]:
        _, wet = scale.at(seconds, error)
        parts.append(_line(x, y - 6, x, wet + 6, color, "stroke-dasharray='2 4' opacity='0.6'"))
        parts.append(f"<circle cx='{x:.1f}' cy='{wet:.1f}' r='5' fill='white' stroke='{color}' stroke-width='2'/>")
    return parts


def _labels(points: list[tuple[str, float, float]]) -> list[str]:
    """Names beside, below or above their points, wherever they meet no other name and no point."""
    taken = [(x - 7, y - 7, x + 7, y + 7) for _, x, y in points]
    parts = []
    for method, x, y in points:
        name = method.replace("graph_cut ", "")
        width = sum(8.6 if letter.isupper() else 6.4 for letter in name)
        places = [(x + 9, y + 4), (x - 9 - width, y + 4)]
        places += [(x - width / 2 + shift, y + down) for down in (20, -12, 34) for shift in (0, width / 3, -width / 3)]
        for left, base in places:
            box = left, base - 10, left + width, base + 3
            inside = left > LEFT and box[2] < WIDTH
            if inside and not any(box[0] < b[2] and b[0] < box[2] and box[1] < b[3] and b[1] < box[3] for b in taken):
                break
        taken.append(box)
        parts.append(
            _text(left, base, name, f"fill='{_color(method)}' stroke='white' stroke-width='3' paint-order='stroke'")
        )
    return parts
