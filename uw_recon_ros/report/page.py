"""One HTML file that holds everything: styles, pictures, numbers, and a 3-D view. It opens without a network."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from html import escape
from importlib.resources import files
from pathlib import Path

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.report.content import Figure, Section, Summary
from uw_recon_ros.report.markup import section_markup, top_markup
from uw_recon_ros.types import Surface

__all__ = ["Figure", "Section", "Summary", "render_page", "write_page"]

_PAGE_SCRIPTS = ("page.js",)
_VIEW_SCRIPTS = ("viewer_mesh.js", "viewer_camera.js", "viewer_painter.js", "viewer_notes.js", "viewer.js")


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
        HTML. All texts are escaped, and its content policy lets the browser load and run nothing else.
    """
    opening = Section(surface=surface)
    everything = [opening, *sections] if opening.has_view else list(sections)
    with_view = any(section.has_view for section in everything)
    scripts = _PAGE_SCRIPTS + (_VIEW_SCRIPTS if with_view else ())
    body = [section_markup(section, number) for number, section in enumerate(everything)]
    return "".join([_head(title, scripts), top_markup(title, summary), *body, _bottom(scripts)])


@cache
def _asset(name: str) -> str:
    return files("uw_recon_ros.report").joinpath(name).read_text(encoding="utf-8")


def _head(title: str, scripts: Sequence[str]) -> str:
    hashes = " ".join(f"'sha256-{_digest(_asset(name))}'" for name in scripts)
    policy = f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src {hashes}"
    return (
        '<!doctype html><html lang="en"><head><meta charset="utf-8">'
        f'<meta http-equiv="Content-Security-Policy" content="{policy}">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        f'<title>{escape(title)}</title><style>{_asset("page.css")}</style></head><body><div class="page">'
    )


def _digest(script: str) -> str:
    return base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()


def _bottom(scripts: Sequence[str]) -> str:
    tags = "".join(f"<script>{_asset(name)}</script>" for name in scripts)
    return (
        "<footer>Made by uw_recon_ros. Everything on this page is in this one file.</footer></div>"
        f'<dialog id="zoom"><img alt=""><p></p></dialog>{tags}</body></html>\n'
    )
