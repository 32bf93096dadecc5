"""Content to HTML. Every text is escaped here and nowhere else."""

from __future__ import annotations

from collections.abc import Iterator
from html import escape

from uw_recon_ros.report.colors import ColorBar, color_table
from uw_recon_ros.report.content import Figure, Section, Summary
from uw_recon_ros.report.embed import mesh_json, picture_uri
from uw_recon_ros.types import Surface

_MAX_SIDE, _MAX_SIDE_WIDE = 1280, 1920  # px, of pictures in half and in full width
_STOPS = 17  # of a colour bar's gradient
_MODES = ("Texture", "Texture + relief", "Relief", "Depth")
_TOGGLES = (("wire", "Wireframe"), ("measure", "Measure"))
_ACTIONS = (("reset", "Reset"), ("fullscreen", "Full screen"))


def top_markup(title: str, summary: Summary) -> str:
    """Title, warnings, facts."""
    facts = "".join(f"<div><dt>{escape(name)}</dt><dd>{escape(value)}</dd></div>" for name, value in summary.facts)
    told = "".join(f'<li class="alarm">{escape(text)}</li>' for text in summary.alarms)
    told += "".join(f"<li>{escape(text)}</li>" for text in summary.warnings)
    return (
        f'<header class="top"><div><h1>{escape(title)}</h1><p class="lead">{escape(summary.lead)}</p></div>'
        '<button id="theme" title="light or dark" aria-label="light or dark">◐</button></header>'
        + (f'<ul class="warnings">{told}</ul>' if told else "")
        + (f'<dl class="facts">{facts}</dl>' if facts else "")
    )


def section_markup(section: Section, number: int) -> str:
    """A section; `number` makes its identifiers unique on the page."""
    title = f"<h2>{escape(section.title)}</h2>" if section.title else ""
    text = f'<p class="text">{escape(section.text)}</p>' if section.text else ""
    view = _viewer(section.surface, f"mesh-{number}") if section.surface is not None and section.has_view else ""
    figures = "".join(_figure(figure) for figure in section.figures)
    columns = " three" if len(section.figures) == 3 else ""
    grid = f'<div class="figures{columns}">{figures}</div>' if figures else ""
    return f"<section>{title}{text}{view}{grid}{_table(section)}</section>"


def _viewer(surface: Surface, identifier: str) -> str:
    size = f"{len(surface.vertices)} vertices, {len(surface.faces)} triangles"
    scale = "metres" if surface.metric else "scale unknown: lengths are in baselines of the rig"
    return (
        f'<div class="viewer" data-mesh="{identifier}"><canvas class="scene" tabindex="0" '
        'aria-label="the reconstructed surface, to be turned"></canvas><canvas class="overlay"></canvas>'
        f'<div class="tools"><div class="group">{_mode_buttons()}</div>'
        f'<div class="group">{_action_buttons()}</div></div>'
        '<div class="readout"></div><div class="hint">click the view to zoom with the wheel</div>'
        '<div class="problem"></div></div>'
        f'<p class="below">{size}; {scale}. Drag to turn, right button or <kbd>Shift</kbd> or two fingers to move, '
        "wheel or pinch to zoom, double click to turn about a point. Axes are those of the left camera.</p>"
        f'<script type="application/json" id="{identifier}">{mesh_json(surface)}</script>'
    )


def _mode_buttons() -> str:
    return "".join(
        f'<button data-act="mode-{k}" aria-pressed="{str(k == 0).lower()}">{name}</button>'
        for k, name in enumerate(_MODES)
    )


def _action_buttons() -> str:
    toggles = [f'<button data-act="{act}" aria-pressed="false">{name}</button>' for act, name in _TOGGLES]
    actions = [f'<button data-act="{act}">{name}</button>' for act, name in _ACTIONS]
    return "".join(toggles + actions)


def _figure(figure: Figure) -> str:
    side = _MAX_SIDE_WIDE if figure.wide else _MAX_SIDE
    image = picture_uri(figure.image, max_side=side, lossless=figure.lossless)
    alt, crisp = escape(f"{figure.title}. {figure.caption}"), ' class="crisp"' if figure.lossless else ""
    if figure.over is None:
        shown = f'<button class="enlarge"><img src="{image}" alt="{alt}"{crisp}></button>'
    else:
        over = picture_uri(figure.over, max_side=side, lossless=figure.lossless)
        shown = _comparison(f'<img src="{image}" alt="{alt}">', over, *map(escape, figure.labels))
    words = f"<figcaption><b>{escape(figure.title)}.</b> {escape(figure.caption)}</figcaption>"
    return f"<figure{' class=wide' if figure.wide else ''}>{shown}{_key(figure)}{words}</figure>"


def _comparison(image: str, over: str, first: str, second: str) -> str:
    return (
        f'<div class="compare">{image}<img class="over" src="{over}" alt="">'
        f'<input type="range" min="0" max="100" value="50" aria-label="{first} or {second}">'
        f'<span class="tag first">{first}</span><span class="tag second">{second}</span></div>'
    )


def _key(figure: Figure) -> str:
    """Legends: of the colour map, of the invalid pixels."""
    ramp = _ramp(figure.bar) if figure.bar is not None else ""
    items = "".join(
        f'<li><i style="background:rgb{color}"></i>{escape(words)} {100 * share:.1f} %</li>'
        for color, words, share in figure.reasons
    )
    return ramp + (f'<ul class="reasons">{items}</ul>' if items else "")


def _ramp(bar: ColorBar) -> str:
    table = color_table(bar.colormap)
    stops = ",".join(f"rgb{tuple(int(c) for c in table[round(k * 255 / (_STOPS - 1))])}" for k in range(_STOPS))
    ticks = "".join(f"<span>{tick}</span>" for tick in _ticks(bar))
    return (
        f'<div class="key"><div class="ramp" style="background:linear-gradient(90deg,{stops})"></div>'
        f'<div class="ticks">{ticks}</div><div class="what">{escape(bar.label)} [{escape(bar.unit)}]</div></div>'
    )


def _ticks(bar: ColorBar) -> Iterator[str]:
    for k in range(5):
        value = bar.low + (bar.high - bar.low) * k / 4
        yield f"{value:.3g}".replace("-", "\u2212")


def _table(section: Section) -> str:
    if not section.rows:
        return ""
    names = "".join(f"<th>{escape(cell)}</th>" for cell in section.header)
    head = f"<thead><tr>{names}</tr></thead>" if names else ""
    rows = "".join(
        f"<tr><th scope='row'>{escape(row[0])}</th>" + "".join(f"<td>{escape(cell)}</td>" for cell in row[1:]) + "</tr>"
        for row in section.rows
    )
    return f'<div class="tablewrap"><table>{head}<tbody>{rows}</tbody></table></div>'
