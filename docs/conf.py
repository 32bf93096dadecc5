"""How Sphinx builds these documents: ``make site``, strictly and offline.

Pages of the reference that follow from the code are written into ``_generated/`` before anything is read.
"""

from __future__ import annotations

import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "tools"))

project = "uw_recon_ros"
release = version = installed_version(project)
copyright = "the uw_recon_ros maintainers, Apache-2.0"
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["images"]
highlight_language = "none"
myst_heading_anchors = 3

autodoc_member_order = "bysource"
autodoc_typehints = "signature"
autodoc_default_options = {"members": True, "show-inheritance": True, "undoc-members": True}
autodoc_preserve_defaults = True
napoleon_google_docstring = False
napoleon_use_param = False
napoleon_use_ivar = True
suppress_warnings = ["ref.python"]  # words of a type in a docstring, such as width, that two classes have too
default_role = "code"  # `name` in docstrings is code

html_theme = "furo"
html_title = f"uw_recon_ros {release}"
html_show_sphinx = False
html_copy_source = False
html_static_path = ["_static"]
html_css_files = ["tables.css"]


def _generate(_: Sphinx) -> None:
    import reference_pages

    reference_pages.write(HERE / "_generated")


def setup(app: Sphinx) -> None:
    """Have the generated pages written first."""
    app.connect("builder-inited", _generate)
