"""The page's script gives the answers of `uw_recon measure`, for the same clicks on the same view."""

from __future__ import annotations

import json
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.browser import run_in_browser

import uw_recon_ros
from uw_recon_ros.errors import EstimationError
from uw_recon_ros.measure.random_draws import below, normals
from uw_recon_ros.measure_files import Opened, measure, rows_of
from uw_recon_ros.report.content import Clickable, clicks_section
from uw_recon_ros.report.embed import clickable_json
from uw_recon_ros.report.page import Summary, render_page
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import StereoGeometry

SCRIPT = Path(uw_recon_ros.__file__).parent / "report" / "measure_numbers.js"
GEOMETRY = StereoGeometry(310.0, 158.0, 161.0, 119.0, 0.12, focal_across_px=312.0)
TABLE = ((0.5, 0.002), (1.0, 0.004), (3.0, 0.01))
POINTS = [(60.25, 100.0), (250.0, 131.5), (201.0, 60.0), (90.0, 60.0)]
RUN = """
require(process.argv[2]);
const { jobs, data } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const { opened, measure, rowOf } = globalThis.uwMeasure;
opened(data).then(frame => console.log(JSON.stringify(jobs.map(([quantity, points, plane, clickPx]) => {
  try { return measure(frame, quantity, points, { plane, clickPx }).map(row => rowOf(frame, row)); }
  catch (error) { if (error instanceof RangeError) return error.message; throw error; }
}))));
"""


def seen(seed: int, geometry: StereoGeometry = GEOMETRY) -> DisparityFrame:
    """A sloping bottom with a box on it and a hole, noisy as a matcher is."""
    v, u = np.mgrid[:240, :320].astype(np.float64)
    disparity = 30 + 0.02 * u + 0.03 * v
    disparity[80:150, 120:200] = 45.0
    rng = np.random.default_rng(seed)
    noise = cv2.GaussianBlur(rng.standard_normal(disparity.shape), (0, 0), 2.0)
    disparity += 0.1 * noise / noise.std()
    disparity[20:50, 250:300] = np.nan
    sigma = (0.1 + 0.1 * rng.random(disparity.shape)).astype(np.float32)
    return DisparityFrame(12, np.full((240, 320, 3), 90, np.uint8), disparity.astype(np.float32), sigma, geometry)


def table(depth: float) -> float:
    ranges, errors = zip(*TABLE, strict=True)
    return float(np.interp(np.log(depth), np.log(ranges), errors))


def by_command(frame: DisparityFrame, job: list[Any]) -> list[dict[str, Any]] | str:
    quantity, points, plane, click_px = job
    opened = Opened("a", frame)
    try:
        return rows_of(opened, measure(opened, quantity, points, plane=plane, click_px=click_px, calibration=table))
    except EstimationError as error:
        return str(error)


def by_page(frame: DisparityFrame, jobs: list[list[Any]], tmp_path: Path) -> list[Any]:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on this machine: the page's script cannot be run alone")
    (tmp_path / "run.js").write_text(RUN)
    given = {"jobs": jobs, "data": json.loads(clickable_json(Clickable(frame, "a", TABLE)))}
    done = subprocess.run(
        [node, str(tmp_path / "run.js"), str(SCRIPT)],
        input=json.dumps(given),
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(done.stdout)


def hold_together(page: Any, command: Any) -> None:
    if isinstance(command, str):
        assert page == command
        return
    for one, other in zip(page, command, strict=True):
        assert list(one) == list(other)
        for name, value in other.items():
            if name == "stamp_ns":
                assert one[name] == str(value)
            elif isinstance(value, float):
                assert one[name] == pytest.approx(value, rel=2e-3, abs=1e-5), name
            else:
                assert one[name] == value, name


@pytest.mark.parametrize(
    "geometry",
    [
        GEOMETRY,
        replace(GEOMETRY, axis="vertical", baseline_m=-0.2, cx_left=400.0, cx_right=400.0, cy=160.0),
        GEOMETRY.unscaled,
    ],
)
def test_page_and_command_give_one_answer(geometry: StereoGeometry, tmp_path: Path) -> None:
    frame = seen(1, geometry)
    if geometry.focal_times_baseline < 0:
        frame = replace(frame, disparity=-frame.disparity)
    rng = np.random.default_rng(2)
    drawn = (rng.random((40, 2, 2)) * (319, 239)).round(2).tolist()
    jobs = [
        *([["length", ends, None, 1.0] for ends in drawn]), ["length", POINTS, None, 2.5],
        ["height", [(150.0, 110.0), (40.0, 200.0), (275.0, 35.0)], None, 1.0],
        ["height", [(150.0, 110.0)], [(20.0, 160.0), (300.0, 160.0), (280.5, 230.0), (30.0, 230.0)], 0.0],
        ["height", [(150.0, 110.0)], [(260.0, 25.0), (290.0, 25.0), (280.0, 45.0)], 1.0],
        ["area", POINTS, None, 1.0], ["area", [(30.0, 30.5), (180.25, 44.0), (60.0, 200.0)], None, 1.0],
        ["area", [(252.0, 22.0), (298.0, 22.0), (280.0, 48.0)], None, 1.0],
        ["length", [(5.0, 5.0), (6.0, 5.0)], None, 1.0],
    ]  # fmt: skip
    for found, job in zip(by_page(frame, jobs, tmp_path), jobs, strict=True):
        hold_together(found, by_command(frame, job))


def test_what_is_not_known_is_null_and_large_numbers_are_whole(tmp_path: Path) -> None:
    frame = replace(seen(1), stamp_ns=1_700_000_000_123_456_789)
    (rows,) = by_page(frame, [["area", POINTS, None, 1.0]], tmp_path)
    assert rows[1]["sigma_calibration"] is None
    assert rows[0]["stamp_ns"] == "1700000000123456789"


def test_draws_are_even_and_normal() -> None:
    counts = np.bincount(below(10, 100_000), minlength=10)
    assert counts.min() > 9_500
    found = normals(100_000)
    assert found.mean() == pytest.approx(0, abs=0.02)
    assert found.std() == pytest.approx(1, abs=0.02)
    assert np.corrcoef(found[:-1], found[1:])[0, 1] == pytest.approx(0, abs=0.02)
    np.testing.assert_array_equal(below(7, 20, 5), below(7, 25)[5:])


CLICKS = """
<script>
function click(root, view) {
  const { canvas } = view, box = canvas.getBoundingClientRect();
  canvas.setPointerCapture = () => {};
  const tap = (u, v) => {
    const [x, y] = view.place([u, v]), at = { clientX: box.left + x, clientY: box.top + y, pointerId: 1 };
    for (const name of ["pointerdown", "pointerup"]) canvas.dispatchEvent(new PointerEvent(name, at));
  };
  const press = name => root.querySelector(`[data-act=${name}]`).click();
  const kind = name => root.querySelector(`[data-kind=${name}]`).click();
  tap(60, 100); tap(250, 130); press("next");
  kind("height"); tap(150, 110); tap(275, 35);
  kind("to_plane"); tap(20, 160); tap(300, 160); press("next");
  document.body.dataset.refused = root.querySelector(".asks").textContent;
  tap(280, 230); press("next"); tap(150, 110);
  kind("area"); tap(60, 100); tap(250, 130); tap(200, 60); tap(90, 60); press("undo");
  document.body.dataset.csv = view.clicks.csv();
  document.body.dataset.json = view.clicks.json();
}
const root = document.querySelector(".measure");
if (root.view) click(root, root.view);
else new MutationObserver((_, observer) => { observer.disconnect(); click(root, root.view); })
  .observe(root, { attributes: true, attributeFilter: ["data-ready"] });
</script>
"""


def test_clicks_in_a_browser(tmp_path: Path) -> None:
    """Every kind by real pointer events; the policy is taken off, so that the test's own script runs."""
    frame = seen(3)
    page = str(render_page("Measure", Summary(), [clicks_section(Clickable(frame, "a", TABLE))]))
    page = page.replace('http-equiv="Content-Security-Policy"', 'name="policy"').replace("</body>", f"{CLICKS}</body>")
    (tmp_path / "page.html").write_text(page)
    dom = run_in_browser(tmp_path / "page.html", tmp_path, "--dump-dom")
    told = {
        name: dom.split(f'data-{name}="', 1)[1].split('"', 1)[0].replace("&quot;", '"')
        for name in ("csv", "json", "refused")
    }
    assert "three corners" in told["refused"]
    rows = json.loads(told["json"])
    assert [row["quantity"] for row in rows] == ["length", "height", "to_plane", "area", "rugosity"]
    assert rows[0]["stamp_ns"] == 12
    jobs = [["length", [(60.0, 100.0), (250.0, 130.0)], None, 1.0], ["height", [(150.0, 110.0)], None, 1.0]]
    for row, job in zip(rows, jobs, strict=False):
        made = by_command(frame, job)[0]
        assert row["value"] == pytest.approx(made["value"], rel=0.01)
        assert np.allclose(row["pixels"], made["pixels"], atol=0.05)
    assert told["csv"].splitlines()[0] == ",".join(rows[0])
    assert len(told["csv"].splitlines()) == 6


def test_the_policy_of_a_page_to_measure_in_stops_nothing_of_ours(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text(render_page("M", Summary(), [clicks_section(Clickable(seen(3), "a"))]))
    dom = run_in_browser(tmp_path / "page.html", tmp_path, "--dump-dom")
    assert "Click the ends of what is to be measured" in dom


def test_without_depth_the_page_says_so() -> None:
    frame = seen(1)
    frame.disparity[:] = np.nan
    page = render_page("M", Summary(), [clicks_section(Clickable(frame, "a"))])
    assert "There is no depth to measure in" in page
    assert "uwMeasure" not in page
