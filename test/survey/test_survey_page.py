"""The survey's page: words, numbers and drawings that people read."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import pytest

from uw_recon_ros.survey.figures import WIDTHS, Line, chart, counted
from uw_recon_ros.survey.report import _axis
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
