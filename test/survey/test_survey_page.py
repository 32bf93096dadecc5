"""The survey's page: words, numbers and drawings that people read."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from helpers.browser import run_in_browser
from helpers.report_results import surface

from uw_recon_ros.report import shell
from uw_recon_ros.report.page import Summary, render_page
from uw_recon_ros.survey.charts import WIDTHS, Line, chart
from uw_recon_ros.survey.report import _axis, counted, render_report
from uw_recon_ros.survey.store import STATE, VIEWS, Store, frame_name
from uw_recon_ros.survey.write import time_of


@pytest.mark.parametrize(
    ("stamp_ns", "words"),
    [
        (0, "0.000 s"),
        (12_345_678_000, "12.346 s"),
        (1_700_000_001_250_000_000, "2023-11-14 22:13:21.250 UTC"),
        (951_782_400 * 10**9 - 1, "2000-02-28 23:59:59.999 UTC"),
        (2**62, "4611686018.427 s"),
    ],
)
def test_stamps_that_count_from_1970_are_dates(stamp_ns: int, words: str) -> None:
    assert time_of(stamp_ns) == words


@pytest.mark.parametrize(
    ("last", "label", "end"), [(3.0, "s", 3.0), (299.0, "s", 299.0), (600.0, "min", 10.0), (36000.0, "h", 10.0)]
)
def test_time_lines_have_a_unit_that_people_read(last: float, label: str, end: float) -> None:
    places, words = _axis([0.0, last], stamped=True)
    assert places == [0.0, pytest.approx(end)]
    assert words == f"{label} since the first frame"


@pytest.mark.parametrize(("count", "words"), [(0, "0 pairs"), (1, "1 pair"), (2, "2 pairs")])
def test_one_is_singular(count: int, words: str) -> None:
    assert counted(count, "pair") == words


@pytest.mark.parametrize("last", [3.0, 47.0, 6480.0, 1e6])
def test_a_chart_keeps_to_its_paper_wide_and_narrow(last: float) -> None:
    x = [last * k / 4999 for k in range(5000)]
    drawn = chart(Line("Depth", "m", x, [2 + math.sin(k / 50) for k in range(5000)]), "s since the first frame", [last])
    figure = ElementTree.fromstring(drawn)
    pictures = figure.findall("svg")
    assert [picture.get("class") for picture in pictures] == [f"chart {kind}" for kind in WIDTHS]
    for picture, width in zip(pictures, WIDTHS.values(), strict=True):
        _, _, right, bottom = map(float, str(picture.get("viewBox")).split())
        assert right == width
        places = [
            float(v) for line in picture.iter("polyline") for v in re.findall(r"([0-9.]+),", str(line.get("points")))
        ]
        assert 0 < min(places) < max(places) <= right
        labels = [text for text in picture.iter("text") if text.get("class") == "x"]
        assert 2 <= len(labels) <= width / 65 + 1
        ends = [float(str(text.get("x"))) + 3.5 * len(str(text.text)) for text in labels]  # half a figure is 3.5 wide
        starts = [float(str(text.get("x"))) - 3.5 * len(str(text.text)) for text in labels]
        assert all(end < start for end, start in zip(ends, starts[1:], strict=False))
        assert max(float(str(text.get("y"))) for text in picture.iter("text")) <= bottom - 4


EVIL = "</script><script>alert('x')</script><img src=x onerror=\"alert(1)\">&'"


def row(number: int, *, reason: str = "", files: tuple[str, ...] = ()) -> dict[str, Any]:
    numbers = {"density": 0.5, "row_error_median_px": 0.2, "depth_p05": 1.0, "depth_p50": 2.0, "depth_p95": 3.0}
    ranges = {"min_disparity": 0, "max_disparity": 64, "triangles": 12}
    return {
        "frame": number, "source": EVIL, "stamp_ns": number * 10**9, "status": "failed" if reason else "ok",
        "reason": reason, "seconds": 1.5, "findings": [], "files": dict.fromkeys(files, 1),
        **({} if reason else {**numbers, **ranges}),
    }  # fmt: skip


def made_of(rows: list[dict[str, Any]]) -> dict[str, Any]:
    middle = {"least": 0.1, "median": 0.5, "greatest": 0.9}
    warning = {"code": "x", "text": EVIL, "severity": "unreliable", "frames": 1, "first_frame": 0}
    return {
        "input": {EVIL: {EVIL: "00"}}, "unreadable": [EVIL], "notes": [EVIL], "warnings": [warning],
        "scale": ["metric"],
        "rigs": {EVIL: {"warnings": [EVIL]}}, "frames": {"pairs_in_input": len(rows)}, "survey": {EVIL: EVIL},
        "parameters": {EVIL: EVIL}, "versions": {EVIL: EVIL},
        "density": middle, "row_error_median_px": middle, "depth_p50": middle,
    }  # fmt: skip


@pytest.fixture
def report_of_two(tmp_path: Path) -> Iterator[tuple[Store, list[dict[str, Any]]]]:
    """Two frames with views, the first shown first, and one that failed."""
    names = [f"{VIEWS}/{frame_name(number)}.html" for number in range(2)]
    (tmp_path / VIEWS).mkdir()
    for name in names:
        (tmp_path / name).write_text(render_page(f"Frame {name}", Summary(), [], surface()), encoding="utf-8")
    (tmp_path / STATE).mkdir()
    with Store(tmp_path) as store:
        yield store, [*(row(k, files=(name,)) for k, name in enumerate(names)), row(2, reason=EVIL)]


def test_no_name_becomes_markup_in_a_survey(report_of_two: tuple[Store, list[dict[str, Any]]]) -> None:
    store, rows = report_of_two
    page = render_report(store, rows, made_of(rows))
    assert "<script>alert" not in page
    assert "<img src=x" not in page
    assert page.count("&lt;script&gt;alert(&#39;x&#39;)") >= 15
    assert "default-src 'none'; img-src data:; style-src 'sha256-" in page
    assert " style=" not in re.sub(r"<(script|style).*?</\1>", "", page, flags=re.S), "the policy would stop it"


@pytest.mark.parametrize("click", [0, 1])
def test_the_views_of_frames_run_inside_the_survey(
    report_of_two: tuple[Store, list[dict[str, Any]]], click: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The frame shown first lies in the page, the next beside it; `run_in_browser` fails where the policy stops one."""
    store, rows = report_of_two
    press = 'document.getElementById("next").click();'
    watch = 'document.querySelector("iframe").addEventListener("load", e => e.target.dataset.loaded = e.target.src);'
    true = shell.asset
    monkeypatch.setattr(
        shell, "asset", lambda name: true(name) + (watch + press * click if name == "survey/survey.js" else "")
    )
    page = tmp_path / "report.html"
    page.write_text(render_report(store, rows, made_of(rows)), encoding="utf-8")
    dom = run_in_browser(page, tmp_path, "--dump-dom", "--allow-file-access-from-files")
    loaded = re.search(r'<iframe[^>]* data-loaded="([^"]*)"', dom)
    assert loaded
    assert loaded[1].endswith("views/000001.html" if click else "")
