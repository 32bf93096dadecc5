"""The documents: commands in the tutorials work as they stand, the site is built strictly and asks no network."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from types import ModuleType

import pytest

import uw_recon_ros
from uw_recon_ros.catalogue import ALL_PARAMS
from uw_recon_ros.cli import VERBS
from uw_recon_ros.findings import Code
from uw_recon_ros.topics import TOPICS

ROOT = Path(__file__).resolve().parent.parent
TESTED = [
    page for page in sorted((ROOT / "docs").rglob("*.md")) if re.search("^```(sh|python) test$", page.read_text(), re.M)
]
ONE_PROCESS = pytest.mark.xdist_group("site")  # so that the site is built once
LOADED = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "image": "href"}


def blocks(page: Path) -> list[tuple[str, str]]:
    """Language and text of the blocks that are marked for testing."""
    return re.findall(r"^```(sh|python) test\n(.*?)^```$", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)


@pytest.mark.slow
@pytest.mark.parametrize("page", TESTED, ids=lambda page: page.stem)
def test_what_a_page_says_works_in_its_order(page: Path, tmp_path: Path) -> None:
    (tmp_path / "bags").symlink_to(ROOT / "bags")
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    for language, text in blocks(page):
        command = ["bash", "-euo", "pipefail", "-c", text] if language == "sh" else [sys.executable, "-c", text]
        done = subprocess.run(command, cwd=tmp_path, env={**os.environ, "PATH": path}, capture_output=True, text=True)
        assert done.returncode == 0, f"{page.name}:\n{text}\n{done.stdout}{done.stderr}"


def test_both_tutorials_are_tested() -> None:
    assert {page.name for page in TESTED} >= {"pair.md", "bag.md"}
    assert all(len(blocks(page)) >= 3 for page in TESTED)


class Resources(HTMLParser):
    """What a browser loads by itself for a page."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found += [value or "" for name, value in attrs if LOADED.get(tag) == name]


def loaded_by(text: str) -> list[str]:
    parser = Resources()
    parser.feed(text)
    return parser.found


def foreign(addresses: list[str]) -> list[str]:
    return [address for address in addresses if re.match(r"\s*(\w+:)?//", address)]


def test_what_a_page_loads_from_elsewhere_is_noticed() -> None:
    page = '<link href="//a.example/x.css"><script src=" https://b.example/y.js"></script><img src="c.png">'
    assert len(foreign(loaded_by(page))) == 2


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    for needed in ("sphinx", "myst_parser", "furo"):
        if importlib.util.find_spec(needed) is None:
            pytest.skip(f"{needed} is not installed: pip install '.[docs]'")
    out = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "--keep-going", "-b", "html", ROOT / "docs", out]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return out


@ONE_PROCESS
def test_no_page_loads_anything_from_elsewhere(site: Path) -> None:
    pages = sorted(site.rglob("*.html"))
    assert len(pages) >= 20
    assert not {str(page): bad for page in pages if (bad := foreign(loaded_by(page.read_text(encoding="utf-8"))))}
    styles = "".join(style.read_text(encoding="utf-8") for style in site.rglob("*.css"))
    assert not re.findall(r"(?:@import|url\()[\s\"'(]*(?:https?:)?//[^)\s]*", styles)


@ONE_PROCESS
def test_links_within_the_site_lead_somewhere(site: Path) -> None:
    """Files and places in them, as a browser resolves them."""
    lost = []
    texts = {page.resolve(): page.read_text(encoding="utf-8") for page in site.rglob("*.html")}
    for page, text in texts.items():
        for link in re.findall(r'<a [^>]*href="([^"]*)"', text):
            name, _, place = link.partition("#")
            target = (page.parent / name).resolve() if name else page
            if re.match(r"\w+:", link):
                continue
            if not target.exists() or (place and target in texts and f'id="{place}"' not in texts[target]):
                lost.append(f"{page.relative_to(site.resolve())}: {link}")
    assert not lost


@ONE_PROCESS
def test_the_reference_holds_everything(site: Path) -> None:
    def text(page: str) -> str:
        return re.sub(r"<[^>]*>", "", (site / page).read_text(encoding="utf-8"))

    assert [code.value for code in Code if code.value not in text("_generated/codes.html")] == []
    rooms = {name for name in uw_recon_ros.__all__ if isinstance(getattr(uw_recon_ros, name), ModuleType)}
    names = [f"uw_recon_ros.{'api.' if name in rooms else ''}{name}" for name in uw_recon_ros.__all__]
    assert [name for name in names if f'id="{name}"' not in (site / "_generated/python.html").read_text("utf-8")] == []
    assert [verb for verb in VERBS if f"usage: uw_recon {verb}" not in text("_generated/commands.html")] == []
    assert [topic.name for topic in TOPICS if topic.name not in text("topics.html")] == []
    names = [spec.name for cls in ALL_PARAMS for spec in cls.specs()]
    assert [name for name in names if name not in text("reference/parameters.html")] == []
