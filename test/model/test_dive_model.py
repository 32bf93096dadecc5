"""A simulated dive from the bag to its model, judged by its truth; and what is refused."""

from __future__ import annotations

import errno
import html
import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import cKDTree

from uw_recon_ros.cli import main
from uw_recon_ros.errors import ModelError
from uw_recon_ros.files.trajectories import read_tum, write_tum
from uw_recon_ros.findings import Code
from uw_recon_ros.measure_files import measure_on, open_model
from uw_recon_ros.model import maps
from uw_recon_ros.model.build import ModelRequest, build_model
from uw_recon_ros.model.evaluate import distances, evaluate_model
from uw_recon_ros.model.page import tracks_of
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.survey.kept_frame import read_kept, write_kept
from uw_recon_ros.trajectory import PoseStatus, trajectory_of

FRAMES = 6
PARAMS = """/**:
  ros__parameters:
    effort: navigation
    min_disparity: 2
    max_disparity: 40
"""
QUICK = {"texture_faces": 500, "texture_px": 256}
FILES = {"cloud.ply", "elevation.tif", "measure.json", "mesh.glb", "mesh.ply", "model.json", "orthomosaic.tif",
         "report.html", "trajectory.csv", "trajectory.txt"}  # fmt: skip


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a survey's in ``survey`` and the truth in ``truth``."""
    room = tmp_path_factory.mktemp("dive")
    (room / "small.yaml").write_text(PARAMS)
    size = ["--frames", str(FRAMES), "--width", "320", "--height", "240"]
    assert main(["simulate", "--track", "line", *size, "-o", str(room / "bag"), "--truth", str(room / "truth")]) == 0
    arguments = ["--params", str(room / "small.yaml"), "--write", "model", "--jobs", "1", "--quiet"]
    assert main(["survey", str(room / "bag"), "-o", str(room / "survey"), *arguments]) == 0
    return room


@pytest.fixture(scope="module")
def made(dive: Path) -> Path:
    assert main(["model", str(dive / "survey"), "--quiet", "--texture-faces", "500", "--texture-px", "256"]) == 0
    return dive / "survey" / "model"


@pytest.fixture
def survey(dive: Path, tmp_path: Path) -> Path:
    """The survey again, without its model."""
    shutil.copytree(dive / "survey", tmp_path / "survey", ignore=shutil.ignore_patterns("model"))
    return tmp_path / "survey"


def frames(survey: Path) -> list[Path]:
    return sorted((survey / "model_frames").iterdir())


def build_quietly(survey: Path, **more: Any) -> dict[str, Any]:
    return build_model(ModelRequest(str(survey), **{"params": DiveModelParams(**QUICK), **more}), lambda _: None)


def refused(survey: Path, **more: Any) -> ModelError:
    with pytest.raises(ModelError) as caught:
        build_quietly(survey, **more)
    assert "\n" not in str(caught.value)
    return caught.value


def test_every_file_is_there(made: Path) -> None:
    assert {path.name for path in made.iterdir()} == FILES


def test_the_model_is_as_near_to_the_truth_as_is_said(
    dive: Path, made: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["evaluate-model", str(dive / "survey"), str(dive / "truth")]) == 0
    found = json.loads(capsys.readouterr().out)
    (way,), (surface,) = found["trajectory"]["segments"], found["surface"]
    assert way["frames"] == FRAMES
    assert way["ate_m"] < 0.01
    assert surface["median_mm"] < 5
    assert surface["p95_mm"] < 25
    assert surface["completeness_percent"] > 80
    assert surface["within_1_sigma_percent"] > 50


def test_a_model_that_lies_elsewhere_is_found_out(dive: Path, made: Path, tmp_path: Path) -> None:
    shutil.copytree(dive / "survey" / "model", tmp_path / "model")
    data = (made / "mesh.ply").read_bytes()
    head, body = data.split(b"end_header\n", 1)
    vertices = int(head.split(b"element vertex ")[1].split(b"\n")[0])
    rows = np.frombuffer(body[: vertices * 33], np.uint8).reshape(vertices, 33).copy()
    z = rows[:, 8:12].copy().view("<f4")
    rows[:, 8:12] = (z + np.float32(0.05)).view(np.uint8)
    (tmp_path / "model" / "mesh.ply").write_bytes(head + b"end_header\n" + rows.tobytes() + body[vertices * 33 :])
    moved, right = (evaluate_model(x, dive / "truth")["surface"][0] for x in (tmp_path, dive / "survey"))
    assert moved["bias_mm"] - right["bias_mm"] == pytest.approx(50, abs=3)
    assert moved["median_mm"] > 40
    assert moved["completeness_percent"] < 10


def test_the_pages_show_the_model_first(dive: Path, made: Path) -> None:
    page, report = (made / "report.html").read_text(), (dive / "survey" / "report.html").read_text()
    order = [page.index(words) for words in ('class="viewer"', 'class="map"', "What went wrong", "Gravity is unknown")]
    assert order[:3] == sorted(order[:3])
    assert all(words in page for words in (">Sigma<", ">Views<", ">Track<", ">Orthomosaic<", ">Height<"))
    assert f"{FRAMES} of {FRAMES}" in page
    assert "North is up" not in page, "nothing told which way north is"
    assert "not known to be north" in page
    assert html.unescape(report.split('srcdoc="')[1].split('"')[0]) == page
    assert report.index("<iframe") < report.index("frames reconstructed")


def test_lengths_on_the_model_are_the_truths_within_their_sigma(dive: Path, made: Path) -> None:
    """Of places of the true ground that some pixels of the true views show, found where the model has these pixels."""
    opened, rng = open_model(made), np.random.default_rng(4)
    true, own = read_tum(dive / "truth" / "trajectory.txt"), read_tum(made / "trajectory.txt")
    surface = trimesh.load(dive / "truth" / "surface.ply", process=False)
    mesh = trimesh.load(made / "mesh.ply", process=False)
    errors = []
    for _ in range(20):
        ends = []
        for _ in range(2):
            k, ray = rng.integers(FRAMES), np.array([*rng.uniform(-0.25, 0.25, 2), 1.0])
            ends.append([seen(way.poses[k], ray, m) for way, m in ((true, surface), (own, mesh))])
        at = np.array(ends)
        if np.isfinite(at).all() and (length := np.linalg.norm(at[0, 0] - at[1, 0])) > 0.1:
            (found,) = measure_on(opened, "length", at[:, 1].tolist(), click=0.0)
            errors.append((found.value - length) / found.sigma)
    assert len(errors) > 8
    assert np.sqrt(np.mean(np.square(errors))) < 3


def seen(pose: np.ndarray, ray: np.ndarray, mesh: Any) -> np.ndarray:
    """(3,) where a ray of a camera meets a mesh first; NaN: nowhere."""
    eye, way = pose[:3, 3], pose[:3, :3] @ ray
    a, b, c = np.moveaxis(np.asarray(mesh.triangles, np.float64), 1, 0)
    across = np.cross(way, c - a)
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = ((b - a) * across).sum(axis=1)
        u = ((eye - a) * across).sum(axis=1) / whole
        other = np.cross(eye - a, b - a)
        v, t = (other @ way) / whole, ((c - a) * other).sum(axis=1) / whole
    hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
    return eye + t[hit].min() * way if hit.any() else np.full(3, np.nan)


def test_a_track_is_cut_where_the_way_of_knowing_it_changes() -> None:
    poses = np.tile(np.eye(4), (6, 1, 1))
    poses[:, 0, 3] = np.arange(6)
    way = trajectory_of(list(range(6)), poses, status=PoseStatus.TRACKED)
    way = replace(way, status=np.array([0, 0, 2, 2, 0, 0], np.uint8), segment=np.array([0, 0, 0, 0, 0, 1]))
    found = [track.points[:, 0].tolist() for track in tracks_of(way, 0)]
    assert found == [[0, 1], [1, 2, 3], [3, 4]]
    assert [track.color for track in tracks_of(way, 1)] == [next(tracks_of(way, 0)).color]


def test_the_mesh_says_how_sure_it_is(made: Path) -> None:
    mesh = trimesh.load(made / "mesh.ply", process=False)
    data = mesh.metadata["_ply_raw"]["vertex"]["data"]
    assert (data["views"] >= 1).all()
    assert data["views"].max() > 2
    assert (data["sigma"] > 0).all()
    cloud = trimesh.load(made / "cloud.ply", process=False)
    np.testing.assert_array_equal(cloud.vertices, mesh.vertices)
    glb = trimesh.load(made / "mesh.glb", force="mesh", process=False)
    assert len(glb.faces) < len(mesh.faces) / 5  # simplified: nearly the same shape
    world = np.c_[glb.vertices[:, 0], -glb.vertices[:, 2], glb.vertices[:, 1]]  # z up is y up there
    _, nearest = cKDTree(mesh.vertices).query(world)
    away = np.abs(np.einsum("ij,ij->i", world - mesh.vertices[nearest], mesh.vertex_normals[nearest]))
    assert np.quantile(away, 0.95) < 0.01


def test_the_same_survey_gives_the_same_bytes(made: Path, survey: Path) -> None:
    build_quietly(survey, params=DiveModelParams(**QUICK, jobs=2))
    for name in FILES - {"model.json"}:  # the parameters stand there
        assert (survey / "model" / name).read_bytes() == (made / name).read_bytes(), name
    build_quietly(survey, overwrite=True)
    for name in FILES:
        assert (survey / "model" / name).read_bytes() == (made / name).read_bytes(), name


def test_poses_in_a_projected_system_put_the_maps_there(dive: Path, survey: Path, tmp_path: Path) -> None:
    true = read_tum(dive / "truth" / "trajectory.txt")
    start = np.array([500_000.0, 4_649_776.0, 0.0])
    write_tum(tmp_path / "poses.txt", replace(true, origin=start))
    params = DiveModelParams(**QUICK, epsg=32633, poses_sigma_m=0.01)
    summary = build_quietly(survey, params=params, poses=str(tmp_path / "poses.txt"))
    assert summary["origin"] == [500_000.0, 4_650_000.0, 0.0]
    assert summary["crs"] == "EPSG:32633"
    middle = true.positions.mean(axis=0) + start
    (model,) = summary["models"]
    rows, columns = model["cells"]
    assert model["west"] < middle[0] < model["west"] + columns * model["cell"]
    assert model["north"] - rows * model["cell"] < middle[1] < model["north"]
    way = read_tum(survey / "model" / "trajectory.txt")
    np.testing.assert_allclose(way.positions, true.positions + start, atol=0.03)
    assert Code.TRACK_GRAVITY_UNKNOWN.value not in [w["code"] for w in summary["warnings"]]
    assert "North is up" in (survey / "model" / "report.html").read_text()


def test_without_a_scale_all_is_in_baselines_and_says_so(survey: Path, dive: Path) -> None:
    for path in frames(survey):
        frame = read_kept(path)
        write_kept(path, replace(frame, geometry=frame.geometry.unscaled))
    summary = build_quietly(survey)
    assert Code.MODEL_NOT_METRIC.value in [w["code"] for w in summary["warnings"]]
    assert not summary["reliable"]
    assert b"comment unit baselines" in (survey / "model" / "mesh.ply").read_bytes()[:200]
    with pytest.raises(ModelError, match="in metres"):
        evaluate_model(survey, dive / "truth")


@pytest.mark.parametrize("which", [0, 2])
def test_frames_of_another_scale_are_left_out_and_counted(survey: Path, which: int) -> None:
    frame = read_kept(frames(survey)[which])
    write_kept(frames(survey)[which], replace(frame, geometry=frame.geometry.unscaled))
    summary = build_quietly(survey)
    assert summary["frames"]["dropped"] == 1
    mesh = (survey / "model" / "mesh.ply").read_bytes()
    frames(survey)[which].unlink()
    assert build_quietly(survey, overwrite=True)["frames"]["dropped"] == 0
    assert (survey / "model" / "mesh.ply").read_bytes() == mesh
    assert Code.MODEL_FRAMES_DROPPED.value in [w["code"] for w in summary["warnings"]]


def test_a_folder_that_is_no_survey_is_refused(tmp_path: Path) -> None:
    assert refused(tmp_path).code == Code.MODEL_NO_SURVEY


def test_a_survey_under_way_is_refused(survey: Path) -> None:
    (survey / "state" / "finished.json").unlink()
    assert "goes on with it" in str(refused(survey))


def test_a_survey_that_kept_nothing_says_what_to_write(survey: Path) -> None:
    shutil.rmtree(survey / "model_frames")
    error = refused(survey)
    assert error.code == Code.MODEL_NOT_KEPT
    assert "--write model" in str(error)


def test_one_frame_is_refused(survey: Path) -> None:
    for path in frames(survey)[1:]:
        path.unlink()
    assert refused(survey).code == Code.MODEL_NO_OVERLAP


def test_frames_that_do_not_overlap_are_refused(survey: Path) -> None:
    for path in frames(survey)[2:]:
        path.unlink()
    frame = read_kept(frames(survey)[1])
    write_kept(frames(survey)[1], replace(frame, left=np.zeros_like(frame.left),
                                          disparity=np.full_like(frame.disparity, np.nan)))  # fmt: skip
    assert refused(survey).code == Code.MODEL_NO_OVERLAP


def test_a_damaged_frame_is_one_line(survey: Path, capsys: pytest.CaptureFixture[str]) -> None:
    frames(survey)[1].write_bytes(b"not a frame")
    assert main(["model", str(survey), "--quiet"]) == 1
    assert capsys.readouterr().err.count("\n") == 1


def test_nothing_is_overwritten_unasked(survey: Path) -> None:
    (survey / "model").mkdir()
    (survey / "model" / "model.json").write_text("{}")
    assert refused(survey).code == Code.MODEL_EXISTS
    assert (survey / "model" / "model.json").read_text() == "{}"


def test_nothing_of_the_model_before_is_left(survey: Path) -> None:
    """A cloud of another form, tiles or segments that the new model does not make would be taken for its own."""
    place = survey / "model"
    (place / "segment_1").mkdir(parents=True)
    (place / "tiles").mkdir()
    for name in ("model.json", "cloud.laz", "segment_1/mesh.ply", "tiles/0_0.glb", "my map.qgz"):
        (place / name).write_text("{}")
    build_quietly(survey, overwrite=True)
    assert {path.name for path in place.iterdir()} == FILES | {"my map.qgz"}


def test_a_full_disk_keeps_what_is_finished(survey: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, *_: Any, **__: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device", str(path))

    monkeypatch.setattr(maps, "write_geotiff", full)
    error = refused(survey)
    assert error.code == Code.MODEL_DISK
    left = {path.name for path in (survey / "model").iterdir()}
    assert {"trajectory.txt", "trajectory.csv", "mesh.ply"} <= left
    assert "model.json" not in left


def test_a_code_of_a_system_needs_poses_in_it(survey: Path) -> None:
    assert refused(survey, params=DiveModelParams(epsg=32633)).code == Code.MODEL_POSES


def test_latitude_and_longitude_are_no_map(survey: Path) -> None:
    poses = survey / "model_frames" / "absent.txt"
    assert refused(survey, params=DiveModelParams(epsg=4326), poses=str(poses)).code == Code.MODEL_POSES
    with pytest.raises(ValueError, match="epsg"):
        DiveModelParams(epsg=99998)


def test_distances_are_those_to_the_triangles() -> None:
    mesh = trimesh.creation.box((1.0, 1.0, 1.0)).subdivide().subdivide()
    points = np.random.default_rng(1).uniform(-1, 1, (200, 3))
    away, nearest = distances(points, mesh)
    outside = np.maximum(np.abs(points) - 0.5, 0)
    inside = 0.5 - np.abs(points).max(axis=1)
    np.testing.assert_allclose(away, np.where(inside > 0, inside, np.linalg.norm(outside, axis=1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(nearest - points, axis=1), away)


def test_a_survey_may_end_with_its_model(dive: Path, tmp_path: Path) -> None:
    words = ["survey", str(dive / "bag"), "-o", str(tmp_path / "out"), "--params", str(dive / "small.yaml")]
    words += ["--write", "disparity", "--max-frames", "2", "--jobs", "1", "--quiet", "--model"]
    assert main(words) == 0
    assert (tmp_path / "out" / "disparity").is_dir()
    summary = (tmp_path / "out" / "model" / "model.json").read_bytes()
    assert json.loads(summary)["models"][0]["frames"] == 2
    assert main(words) == 0
    assert (tmp_path / "out" / "model" / "model.json").read_bytes() == summary
