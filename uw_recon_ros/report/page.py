"""One HTML file that holds everything: styles, pictures, numbers, and a 3-D view. It opens without a network."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.report.content import Clickable, Figure, Section, Summary
from uw_recon_ros.report.shell import (
    CLICK_SCRIPTS,
    MAP_SCRIPTS,
    MEASURE_SCRIPTS,
    PAGE_SCRIPTS,
    PLATE_SCRIPTS,
    RULER_SCRIPTS,
    VIEW_SCRIPTS,
    render,
)
from uw_recon_ros.types import Surface

__all__ = ["Clickable", "Figure", "Section", "Summary", "render_page", "write_page"]


def write_page(
    path: str | Path, title: str, summary: Summary, sections: Sequence[Section], surface: Surface | None = None
) -> None:
    """Write a page; see `render_page`. The file appears whole or not at all.

    Raises
    ------
    OSError
        The file cannot be written.
    """
    write_bytes(path, render_page(title, summary, sections, surface).encode())


def render_page(title: str, summary: Summary, sections: Sequence[Section], surface: Surface | None = None) -> str:
    """Build a page.

    Parameters
    ----------
    title : str
    summary : Summary
    sections : sequence of Section
    surface : Surface or None
        Shown in an interactive view before the sections.

    Returns
    -------
    str
        HTML; see `shell.render`.
    """
    opening = Section(surface=surface)
    everything = [opening, *sections] if opening.has_view else list(sections)
    with_map = any(section.map is not None for section in everything)
    with_clicks = any(section.clickable is not None and section.clickable.shown for section in everything)
    with_ruler = any(section.measured is not None for section in everything)
    scripts = (
        *PAGE_SCRIPTS, *(CLICK_SCRIPTS if with_clicks or with_ruler else ()),
        *(RULER_SCRIPTS if with_ruler else ()),
        *(VIEW_SCRIPTS if any(section.has_view for section in everything) else ()),
        *(PLATE_SCRIPTS if with_map or with_clicks else ()), *(MAP_SCRIPTS if with_map else ()),
        *(MEASURE_SCRIPTS if with_clicks else ()),
    )  # fmt: skip
    return render("report/page.html", title=title, summary=summary, sections=everything, scripts=scripts)
