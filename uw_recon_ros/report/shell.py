"""The one HTML shell of all pages: templates that escape every text, styles and scripts inside, a security policy.

The policy lets the browser run and apply what the shell itself put into the page, known by its hash, show pictures
that are in the page, and load nothing. So a text that slipped through unescaped would still be dead.
"""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.resources import files
from typing import Any

from jinja2 import Environment, FunctionLoader, StrictUndefined
from markupsafe import Markup

from uw_recon_ros.report.colors import color_table
from uw_recon_ros.report.embed import clickable_json, map_json, mesh_json, picture_uri, script_safe

#: Of every page; names of files are those inside the package.
PAGE_STYLES = ("report/page.css",)
PAGE_SCRIPTS = ("report/page.js",)
VIEW_SCRIPTS = tuple(
    f"report/{name}.js" for name in ("viewer_mesh", "viewer_camera", "viewer_painter", "viewer_notes", "viewer")
)
PLATE_SCRIPTS = ("report/plate.js",)
MAP_SCRIPTS = ("report/map.js",)
CLICK_SCRIPTS = ("report/measure_numbers.js", "report/clicks.js")
MEASURE_SCRIPTS = ("report/measure.js",)
RULER_SCRIPTS = ("report/measure_model.js", "report/ruler.js")


@cache
def asset(name: str) -> str:
    """A file of the package as text, by its path inside the package."""
    return files("uw_recon_ros").joinpath(name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    made = Environment(
        loader=FunctionLoader(asset), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    made.globals.update(
        picture_uri=picture_uri, color_table=color_table, mesh_json=lambda *shown: Markup(mesh_json(*shown)),
        map_json=lambda shown: Markup(map_json(shown)), clickable_json=lambda shown: Markup(clickable_json(shown)),
    )  # fmt: skip
    made.filters["script_json"] = lambda text: Markup(script_safe(text))
    return made


def fragment(template: str, **values: Any) -> Markup:
    """Fill in a template that is a part of a page; texts among the values are escaped."""
    return Markup(_environment().get_template(template).render(values))


def render(
    template: str,
    *,
    styles: Sequence[str] = PAGE_STYLES,
    scripts: Sequence[str] = PAGE_SCRIPTS,
    framed: Sequence[str] = (),
    frames: bool = False,
    served: bool = False,
    **values: Any,
) -> str:
    """Build a page.

    Parameters
    ----------
    template : str
        Path inside the package of one that extends ``report/shell.html``.
    styles, scripts : sequence of str
        Files of the package that become part of the page.
    framed : sequence of str
        Further scripts that a page inside this one may run: it is under the policy of both.
    frames : bool
        Whether pages that lie beside this one are shown in it.
    served : bool
        Whether a server gives it out, which it may ask for more.
    **values
        What the template asks for; texts are escaped.
    """
    return fragment(
        template,
        policy=Markup(_policy(styles, [*scripts, *framed], frames=frames, served=served)),
        styles=[Markup(asset(name)) for name in styles],
        scripts=[Markup(asset(name)) for name in scripts],
        **values,
    )


def _policy(styles: Sequence[str], scripts: Sequence[str], *, frames: bool, served: bool) -> str:
    images, asks = ("data: blob:", "connect-src 'self'; ") if served else ("data:", "")
    beside = "; frame-src 'self' file:" if frames else ""
    applied = f"style-src {_hashes(styles)}; script-src {_hashes(scripts)}"
    return f"default-src 'none'; img-src {images}; {asks}{applied}{beside}; base-uri 'none'; form-action 'none'"


def _hashes(names: Sequence[str]) -> str:
    digests = (hashlib.sha256(asset(name).encode()).digest() for name in names)
    return " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
