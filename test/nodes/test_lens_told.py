"""A lens' distortion that was estimated is told on every door: page, ``report.json``, diagnostics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest
from helpers.report_results import pair_results

from uw_recon_ros import pair as pair_files
from uw_recon_ros.nodes.rectify_node import report_rectification
from uw_recon_ros.report.pair import write_pair_page
from uw_recon_ros.ros.diagnostics import Diagnostics

LENS, NONE = 0.417, float("nan")


def results(k1: float):
    raw, enhanced, rectified, *found = pair_results()
    return raw, enhanced, replace(rectified, quality=replace(rectified.quality, lens_k1=k1)), *found


@pytest.mark.parametrize(("k1", "told"), [(LENS, True), (0.0, False), (NONE, False)])
def test_the_page_tells_it(tmp_path: Path, k1: float, told: bool) -> None:
    write_pair_page(tmp_path / "page.html", *results(k1), {})
    page = (tmp_path / "page.html").read_text()
    assert ("Lens distortion" in page) is told
    assert ("0.417" in page) is told


@pytest.mark.parametrize(("k1", "told"), [(LENS, LENS), (0.0, 0.0), (NONE, None)])
def test_report_json_tells_it(k1: float, told: float | None) -> None:
    _, enhanced, rectified, disparity, depth, _ = results(k1)
    products = SimpleNamespace(
        enhanced=enhanced, rectified=rectified, disparity=disparity, depth=depth, stages_seconds={"match": 0.1}
    )
    assert pair_files._report(products)["rectification"]["lens_k1"] == told  # type: ignore[arg-type]


@pytest.mark.parametrize(("k1", "told"), [(LENS, "0.417"), (0.0, "0.000"), (NONE, None)])
def test_diagnostics_tell_it(k1: float, told: str | None) -> None:
    diagnostics = Diagnostics()
    report_rectification(diagnostics, results(k1)[2])
    values = {value.key: value.value for value in diagnostics.tick("/rectify").values}
    assert values.get("lens_k1") == told
