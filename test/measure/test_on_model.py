"""Lengths on a model: the sigma holds for errors of known size, and the page gives the answers of the command."""

from __future__ import annotations

import csv
import html
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.browser import run_in_browser

import uw_recon_ros
from uw_recon_ros.cli import main
from uw_recon_ros.errors import EstimationError, ReconError
from uw_recon_ros.measure.on_model import Spots, measure_off_plane, measure_way
from uw_recon_ros.measure_files import measure_on, model_rows, open_model
from uw_recon_ros.model.measurable import measurable
from uw_recon_ros.report.content import Map, MapLayer, Measured, Overlay, Section
from uw_recon_ros.report.page import Summary, render_page
from uw_recon_ros.trajectory import JointCovariance
from uw_recon_ros.types import Surface

SCRIPTS = Path(uw_recon_ros.__file__).parent / "report"
TABLE = ((0.5, 0.002), (1.0, 0.004), (3.0, 0.01))
FRAMES = 21
STEP_M = 0.1
DRIFT_M = 0.004  # a step
DOWN = np.diag([1.0, -1.0, -1.0])  # a camera that looks down, z of the world up


def way(rng: np.random.Generator | None = None) -> np.ndarray:
    """Poses of a camera that swims along x one metre above the ground; with a generator, as drift leaves them."""
    poses = np.tile(np.eye(4), (FRAMES, 1, 1))
    poses[:, :3, :3] = DOWN
    poses[:, 0, 3] = STEP_M * np.arange(FRAMES)
    poses[:, 2, 3] = 1.0
    if rng is not None:
        poses[1:, :3, 3] += np.cumsum(DRIFT_M * rng.standard_normal((FRAMES - 1, 3)), axis=0)
    return poses


def drift() -> JointCovariance:
    """Of positions that walk at random; rotations are known."""
    number = np.arange(FRAMES)
    shared = DRIFT_M**2 * np.minimum.outer(number, number)
    matrix = np.kron(shared, np.diag([1.0, 1, 1, 0, 0, 0]))
    return JointCovariance(number.astype(np.int64), matrix)


def told(calibration: Any = (), unit: str = "m", origin: tuple[float, ...] = (0.0, 0.0, 0.0)) -> dict[str, Any]:
    """``measure.json`` of a level ground with a low step."""
    x, y = (a.ravel() for a in np.meshgrid(np.arange(-0.3, 2.3, 0.03), np.arange(-0.4, 0.4, 0.03)))
    ground = np.stack([x, y, np.where(x > 1.2, 0.1, 0.0)], axis=1)
    words = {
        "segment": 0,
        "origin": list(origin),
        "crs": "local",
        "unit": unit,
        "click": 0.002,
        "reliable": unit == "m",
    }
    sigma = np.full(len(x), 0.003)
    return measurable(ground, sigma, way(), np.arange(FRAMES), drift(), calibration, words)


def written(folder: Path, **more: Any) -> Path:
    (folder / "measure.json").write_text(json.dumps(told(**more)))
    return folder


@pytest.fixture
def model(tmp_path: Path) -> Path:
    return written(tmp_path, calibration=TABLE, origin=(500000.0, 4000000.0, -20.0))


def test_a_length_and_its_parts(model: Path) -> None:
    opened = open_model(model)
    ends = [tuple(np.array(p) + opened.origin) for p in ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0))]
    (found,) = measure_on(opened, "length", ends)  # type: ignore[arg-type]
    assert found.value == pytest.approx(1.0)
    assert found.sigma_trajectory == pytest.approx(DRIFT_M * np.sqrt(10), rel=0.05)
    assert found.sigma_calibration == pytest.approx(0.004, rel=0.05)
    assert found.sigma_click == pytest.approx(0.002 * np.sqrt(2), rel=1e-3)
    parts = [found.sigma_surface, found.sigma_trajectory, found.sigma_calibration, found.sigma_click]
    assert found.sigma == pytest.approx(np.linalg.norm(parts))


def test_a_point_without_the_origin_is_told_what_it_lacks(model: Path) -> None:
    opened = open_model(model)
    for point, lacks in (((0.5, 0.0, 0.0), True), ((50.0, 0.0, 0.0), False)):
        with pytest.raises(EstimationError) as caught:
            measure_on(opened, "length", [point, (1.0, 0.0, 0.0)])
        assert str(caught.value).startswith(f"({point[0]:g}, 0, 0)")
        assert ("add the model's origin (500000, 4000000, -20)" in str(caught.value)) is lacks


def test_the_stated_sigma_holds_two_thirds_of_the_errors(tmp_path: Path) -> None:
    """Points are laid into the world by poses that drift, with depths and clicks that err: all as the model knows."""
    opened, rng = open_model(written(tmp_path)), np.random.default_rng(5)
    true, within = way(), []
    for _ in range(400):
        ends = np.array([[*rng.uniform([0, -0.2], [1.1, 0.2]), 0.0] for _ in range(2)])
        if np.linalg.norm(ends[1] - ends[0]) < 0.1:
            continue
        drifted = way(rng)
        frames = np.rint(ends[:, 0] / STEP_M).astype(int)
        seen = (ends - true[frames, :3, 3]) * (1 + 0.003 * rng.standard_normal((2, 1)))
        found = drifted[frames, :3, 3] + seen + 0.01 * rng.standard_normal((2, 3))
        made = measure_way(opened.spots, found, np.full(2, 0.01))
        within.append(abs(made.value - np.linalg.norm(ends[1] - ends[0])) <= made.sigma)
    assert 0.58 <= np.mean(within) <= 0.78


def test_places_seen_from_one_pose_do_not_drift_apart(tmp_path: Path) -> None:
    spots = open_model(written(tmp_path)).spots
    across = measure_way(spots, np.array([[1.0, -0.2, 0], [1.0, 0.2, 0]]), np.zeros(2))
    along = measure_way(spots, np.array([[0.1, 0.0, 0], [1.1, 0.0, 0]]), np.zeros(2))
    assert across.sigma_trajectory < 0.1 * along.sigma_trajectory


def test_the_height_of_a_step_above_the_plane_before_it(tmp_path: Path) -> None:
    spots = open_model(written(tmp_path)).spots
    corners = np.array([[0.0, -0.3, 0], [1.0, -0.3, 0], [1.0, 0.3, 0], [0.0, 0.3, 0]])
    found = measure_off_plane(spots, np.array([1.3, 0.0, 0.1]), corners, np.full(5, 0.001))
    assert found.value == pytest.approx(0.1)
    assert found.sigma > 0.003
    with pytest.raises(EstimationError, match="one line"):
        measure_off_plane(spots, np.array([1.3, 0.0, 0.1]), corners * [1, 0, 0], np.full(5, 0.001))


def test_a_point_beside_the_surface_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EstimationError, match="surface"):
        measure_way(open_model(written(tmp_path)).spots, np.array([[0.0, 0, 0], [0.5, 0, 0.8]]), np.zeros(2))


def test_what_is_not_known_is_not_told_as_zero() -> None:
    nothing = Spots(
        np.zeros((1, 3)), np.ones(1), np.ones((1, 3)), np.zeros(1), np.zeros((0, 3)), np.zeros((0, 0)), (), 1.0
    )
    found = measure_way(nothing, np.array([[0.0, 0, 0], [0.5, 0, 0]]), np.zeros(2))
    assert np.isnan([found.sigma_trajectory, found.sigma_calibration]).all()
    assert np.isfinite(found.sigma)


def test_the_command(model: Path, capsys: pytest.CaptureFixture[str]) -> None:
    ends = ["500000,4000000,-20", "500001,4000000,-20"]
    assert main(["measure", str(model), "length", *ends, "--click-mm", "5"]) == 0
    told = capsys.readouterr()
    (row,) = json.loads(told.out)
    assert row["value"] == pytest.approx(1.0)
    assert row["clicks"] == [0.005, 0.005]
    assert row["points"] == [[500000.0, 4000000.0, -20.0], [500001.0, 4000000.0, -20.0]]
    assert row["reliable"]
    assert "±" in told.err
    plane = ["--plane", "500000,3999999.8,-20", "500001,3999999.8,-20", "500001,4000000.2,-20"]
    assert main(["measure", str(model), "height", "500001.5,4000000,-19.9", *plane, "-o", str(model / "a.csv")]) == 0
    with (model / "a.csv").open(newline="") as stream:
        (line,) = csv.DictReader(stream)
    assert float(line["value"]) == pytest.approx(0.1)
    assert line["points"].startswith("500001.5,4000000,-19.9 500000,3999999.8,-20")


@pytest.mark.parametrize(
    ("words", "status", "told"),
    [
        (["length", "500000,4000000,-20"], 2, "2 points"),
        (["length", "500000,4000000", "500001,4000000"], 2, "X,Y,Z"),
        (["length", "500000,4000000,nan", "500001,4000000,0"], 2, "X,Y,Z"),
        (["height", "500000,4000000,-20"], 2, "--plane"),
        (["area", "1,1,1", "2,2,2", "3,3,3"], 2, "area.tif"),
        (["length", "500000,4000000,-20", "500001,4000000,5"], 1, "surface"),
    ],
)
def test_wrong_words_are_one_line(
    model: Path, words: list[str], status: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(model), *words]) == status
    error = capsys.readouterr().err
    assert told in error
    assert len(error.strip().splitlines()) == 1


def test_without_a_scale_lengths_are_in_baselines_and_not_reliable(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["measure", str(written(tmp_path, unit="baselines")), "length", "0,0,0", "1,0,0"]) == 0
    found = capsys.readouterr()
    (row,) = json.loads(found.out)
    assert (row["unit"], row["reliable"]) == ("baselines", False)
    assert "metres are not earned" in found.err


def test_a_model_of_an_older_version_is_told(tmp_path: Path) -> None:
    (tmp_path / "model.json").write_text("{}")
    with pytest.raises(ReconError, match="--overwrite"):
        open_model(tmp_path)


RUN = """
for (const script of process.argv.slice(2)) require(script);
const { jobs, told } = JSON.parse(require("fs").readFileSync(0, "utf8"));
const { opened, measure, rowOf } = globalThis.uwModel, model = opened(told);
console.log(JSON.stringify(jobs.map(([kind, points, plane, clicks]) => {
  try { return rowOf(model, measure(model, kind, points, plane, clicks)); }
  catch (error) { if (error instanceof RangeError) return error.message; throw error; }
})));
"""


def test_page_and_command_give_one_answer(model: Path) -> None:
    node = shutil.which("node")
    if node is None:
        pytest.skip("no node on this machine: the page's script cannot be run alone")
    rng, opened = np.random.default_rng(3), open_model(model)
    place = lambda: [*rng.uniform([-0.2, -0.3], [1.1, 0.3]).tolist(), 0.0]  # noqa: E731
    jobs: list[list[Any]] = [["length", [place() for _ in range(n)], None, [0.004] * n] for n in (2, 2, 2, 3, 5)]
    corners = [place() for _ in range(4)]
    jobs += [["to_plane", [[1.5, 0.1, 0.1]], corners, [0.003] * 5]]
    jobs += [["to_plane", [[1.5, 0.1, 0.1]], [[0.1 * k, 0.0, 0.0] for k in range(4)], [0.003] * 5]]
    jobs += [["length", [place(), [0.0, 0.0, 0.9]], None, [0.004] * 2]]
    (model / "run.js").write_text(RUN)
    scripts = [str(SCRIPTS / name) for name in ("measure_numbers.js", "measure_model.js")]
    given = json.dumps({"jobs": jobs, "told": json.loads((model / "measure.json").read_text())})
    done = subprocess.run(
        [node, str(model / "run.js"), *scripts], input=given, capture_output=True, text=True, check=True
    )
    for page, (kind, points, plane, clicks) in zip(json.loads(done.stdout), jobs, strict=True):
        quantity, at = ("length" if kind == "length" else "height"), (np.array(points) + opened.origin).tolist()
        corner = (np.array(plane) + opened.origin).tolist() if plane else None
        if isinstance(page, str):
            with pytest.raises(EstimationError, match=page):
                measure_on(opened, quantity, at, plane=corner, click=clicks[0])
            continue
        (row,) = model_rows(opened, measure_on(opened, quantity, at, plane=corner, click=clicks[0]))
        assert list(page) == list(row)
        for name, value in row.items():
            assert page[name] == (pytest.approx(value, rel=1e-4, abs=1e-7) if isinstance(value, float) else value), name


def page_of(told: dict[str, Any]) -> str:
    """A level ground of 1 m by 0.6 m to look at from above, with a map of it."""
    x, y = np.meshgrid(np.linspace(0, 1, 21), np.linspace(-0.3, 0.3, 13))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1).astype(np.float32)
    first = (np.arange(12)[:, None] * 21 + np.arange(20)).ravel()
    halves = [first, first + 1, first + 21], [first + 1, first + 22, first + 21]
    faces = np.concatenate([np.stack(half, axis=1) for half in halves])
    picture = np.random.default_rng(1).integers(60, 200, (60, 100, 3)).astype(np.uint8)
    surface = Surface(
        vertices, faces.astype(np.int32), np.tile(np.float32([0, 0, 1]), (len(vertices), 1)),
        np.stack([vertices[:, 0], vertices[:, 1] / 0.6 + 0.5], axis=1).astype(np.float32),
        np.full((len(vertices), 3), 128, np.uint8), picture, told["unit"] == "m", 0, "world",
    )  # fmt: skip
    layer = MapLayer("Orthomosaic", np.dstack([picture, np.full((60, 100), 255, np.uint8)]))
    west, north, _ = told["origin"]
    seen = Map([layer], 0.01, west, north + 0.3, told["unit"])
    return str(render_page("Model", Summary(), [
        Section("Surface", surface=surface, overlay=Overlay(upright=True), ruler="ruler-0"),
        Section("Measured", measured=Measured("ruler-0", told)), Section("Map", map=seen, ruler="ruler-0"),
    ]))  # fmt: skip


CLICKS = """
<script>
addEventListener("load", () => {
  const tap = (view, [x, y]) => {
    const { canvas } = view, box = canvas.getBoundingClientRect();
    canvas.setPointerCapture = () => {};
    const at = { clientX: box.left + x, clientY: box.top + y, pointerId: 1, bubbles: true };
    for (const name of ["pointerdown", "pointerup"]) canvas.dispatchEvent(new PointerEvent(name, at));
  };
  const viewer = document.querySelector(".viewer").view, map = document.querySelector(".map").view;
  const panel = document.querySelector(".ruler"), { clicks } = panel.ruler;
  const press = name => panel.querySelector(`[data-act=${name}]`).click();
  viewer.act("measure");
  for (const point of [[0.2, 0, 0], [0.8, 0.1, 0]]) tap(viewer, viewer.camera.project(point));
  press("next");
  const [east, north] = panel.ruler.model.origin;
  for (const [x, y] of [[0.2, 0], [0.8, 0.1], [0.8, -0.2]]) tap(map, map.place(east + x, north + y));
  press("next");
  panel.querySelector("[data-kind=to_plane]").click();
  for (const [x, y] of [[0.1, -0.2], [0.9, -0.2], [0.5, 0.2]]) tap(map, map.place(east + x, north + y));
  press("next");
  tap(map, map.place(east + 0.4, north));
  document.body.dataset.csv = clicks.csv();
  document.body.dataset.json = clicks.json();
  document.body.dataset.table = panel.querySelector("tbody").textContent;
  tap(map, map.place(east - 0.004, north + 0.304));
  document.body.dataset.refused = panel.querySelector(".asks").textContent;
});
</script>
"""


def test_clicks_in_the_view_and_the_map(model: Path) -> None:
    """By real pointer events; the policy is taken off, so that the test's own script runs."""
    told, opened = json.loads((model / "measure.json").read_text()), open_model(model)
    page = page_of(told).replace('http-equiv="Content-Security-Policy"', 'name="policy"')
    (model / "page.html").write_text(page.replace("</body>", f"{CLICKS}</body>"))
    dom = run_in_browser(model / "page.html", model, "--dump-dom")
    words = ("csv", "json", "refused")
    got = {name: html.unescape(dom.split(f'data-{name}="', 1)[1].split('"', 1)[0]) for name in words}
    rows = json.loads(got["json"])
    assert [row["quantity"] for row in rows] == ["length", "polyline", "to_plane"]
    assert rows[0]["value"] == pytest.approx(np.hypot(0.6, 0.1), rel=0.01)
    assert rows[1]["value"] == pytest.approx(np.hypot(0.6, 0.1) + 0.3, rel=0.01)
    assert rows[2]["value"] == pytest.approx(0.0, abs=1e-3)
    assert got["refused"] == "no surface there"
    assert len(got["csv"].splitlines()) == 4
    for row in rows[:2]:
        (again,) = model_rows(opened, measure_on(opened, "length", row["points"], click=row["clicks"][0]))
        for name in ("value", "sigma_surface", "sigma_trajectory", "sigma_calibration"):
            assert row[name] == pytest.approx(again[name], rel=1e-3), name


def test_the_policy_of_the_page_stops_nothing_of_ours(model: Path) -> None:
    (model / "page.html").write_text(page_of(json.loads((model / "measure.json").read_text())))
    dom = run_in_browser(model / "page.html", model, "--dump-dom")
    assert "Click the ends of what is to be measured" in dom
