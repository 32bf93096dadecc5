"""From posed frames to files: what is in them, where they lie, that they are the same however they came about."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
import tifffile
import trimesh
from helpers.surface_scenes import Ground, looking_down, paint, taken

from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.georeference.crs import WITHOUT_SCALE, Crs
from uw_recon_ros.model import colors
from uw_recon_ros.model import compose as composing
from uw_recon_ros.model.compose import Composed, compose
from uw_recon_ros.model.files import has_laz
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.work import Tell, TileTask, World, say_nothing
from uw_recon_ros.texturing.gains import Balance, GainSample, balance_frames
from uw_recon_ros.texturing.simplify import has_extra

GROUND = Ground(((np.array([0.1, 0.0, 0.1]), 0.12),))
PARAMS = DiveModelParams(voxel_m=0.02, texture_px=256, tiles="always", terrain="yes", texture_faces=400)
FILES = {"mesh.ply", "mesh.glb", "orthomosaic.tif", "elevation.tif", "area.tif", "slope.tif", "rugosity.tif",
         "cloud.ply", "tileset.json"}  # fmt: skip
needs_extra = pytest.mark.skipif(not has_extra(), reason="fast-simplification is not installed")


def dive(count: int = 6) -> list[PosedFrame]:
    return [
        taken(GROUND, looking_down(0.12 * k - 0.3, 0.05 * (k % 2)), noise_m=0.002, number=k, gain=1 + 0.03 * (k % 3))
        for k in range(count)
    ]


def composed(
    folder: Path, frames: list[PosedFrame] | None = None, params: DiveModelParams = PARAMS, tell: Tell = say_nothing,
    world: World | None = None,
) -> Composed:  # fmt: skip
    return compose(TileTask(dive() if frames is None else frames, folder, params, world or World(), tell))


def contents(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("model")
    found = composed(folder)
    assert set(found.files) == FILES
    assert found.statistics["frames"] == 6
    assert found.statistics["coloured_share"] > 0.95
    json.dumps(found.statistics, allow_nan=False)
    return folder


def test_all_files_are_there_and_nothing_else(made: Path) -> None:
    assert {name for name in contents(made) if not name.startswith("tiles/")} == FILES


def test_the_mesh_is_where_the_ground_is(made: Path) -> None:
    mesh = trimesh.load(made / "mesh.ply", process=False)
    away = np.hypot(mesh.vertices[:, 0] - 0.1, mesh.vertices[:, 1]) > 0.2
    assert np.median(np.abs(mesh.vertices[away, 2])) < 0.002
    attributes = mesh.metadata["_ply_raw"]["vertex"]["data"]
    assert 0.0005 < np.median(attributes["sigma"]) < 0.005
    assert 2 <= attributes["views"].min() <= attributes["views"].max() <= 6
    ratio = mesh.visual.vertex_colors[:, :3] / paint(np.asarray(mesh.vertices))
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.03


@needs_extra
def test_the_textured_mesh_stands_upright_and_shows_the_ground(made: Path) -> None:
    placed = trimesh.load(made / "mesh.glb").to_geometry()
    assert np.median(np.abs(placed.vertices[:, 1])) < 0.01  # glTF: y is up
    assert placed.vertices[:, 1].max() == pytest.approx(0.22, abs=0.02)
    texture = np.asarray(placed.visual.material.baseColorTexture.convert("RGB"), float)
    size, uv = len(texture), placed.visual.uv
    row, column = (np.clip((x * size).astype(int), 0, size - 1) for x in (1 - uv[:, 1], uv[:, 0]))
    pixel, place = texture[row, column], placed.vertices[:, [0, 2, 1]] * [1, -1, 1]
    ratio = (pixel / paint(place))[pixel.sum(axis=1) > 0]
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.06


def test_the_maps_show_the_ground(made: Path) -> None:
    with tifffile.TiffFile(made / "orthomosaic.tif") as file:
        page = file.pages[0]
        color, tie, scale = page.asarray(), page.tags[33922].value, page.tags[33550].value
    rows, columns = np.nonzero(color[..., 3])
    x, y = tie[3] + (columns + 0.5) * scale[0], tie[4] - (rows + 0.5) * scale[1]
    away = np.hypot(x - 0.1, y) > 0.25
    ratio = color[rows, columns, :3][away] / paint(np.stack([x, y, 0 * x], axis=-1))[away]
    assert np.median(np.abs(ratio / np.median(ratio) - 1)) < 0.03
    assert np.std(ratio) < 0.06  # gains of 1, 1.03, 1.06 are balanced, no breaks
    heights = tifffile.imread(made / "elevation.tif")
    assert np.nanmax(heights) == pytest.approx(0.22, abs=0.01)
    assert np.nanmedian(np.abs(heights)) < 0.003
    assert np.nanmedian(tifffile.imread(made / "slope.tif")) < 6
    assert 1 <= np.nanmedian(tifffile.imread(made / "rugosity.tif")) < 1.1


def test_tiles_are_named_in_the_tileset_and_hold_their_points(made: Path) -> None:
    tileset = json.loads((made / "tileset.json").read_text())
    assert tileset["asset"]["version"] == "1.1"
    listed = {child["content"]["uri"] for child in tileset["root"]["children"]}
    assert listed == {name for name in contents(made) if name.startswith("tiles/")}
    for child in tileset["root"]["children"]:
        box = np.array(child["boundingVolume"]["box"])
        placed = trimesh.load(made / child["content"]["uri"]).to_geometry().vertices
        z_up = placed[:, [0, 2, 1]] * [1, -1, 1]
        assert (np.abs(z_up - box[:3]) <= box[[3, 7, 11]] + 1e-5).all()


class Killed(BaseException):
    """What no handler of errors catches."""


def killed_at(folder: Path, step: str, frames: list[PosedFrame] | None = None) -> None:
    def tell(name: str, done: int, total: int) -> None:
        if name == step:
            raise Killed

    with pytest.raises(Killed):
        composed(folder, frames, tell=tell)


@pytest.mark.parametrize("step", ["tiles fused", "colours compared", "columns coloured", "texture drawn"])
def test_jobs_and_restarts_leave_the_same_bytes(made: Path, tmp_path: Path, step: str) -> None:
    if step == "texture drawn" and not has_extra():
        pytest.skip("fast-simplification is not installed")
    killed_at(tmp_path, step)
    composed(tmp_path, params=dataclasses.replace(PARAMS, jobs=2))
    assert contents(tmp_path) == contents(made)


def test_what_was_begun_from_other_frames_is_not_gone_on_with(made: Path, tmp_path: Path) -> None:
    others = [dataclasses.replace(f, depth=f.depth - np.float32(0.05)) for f in dive()]
    killed_at(tmp_path, "colours compared", others)
    composed(tmp_path)
    assert contents(tmp_path) == contents(made)


@pytest.mark.skipif(not has_laz(), reason="the extra 'laz' is not installed")
def test_an_origin_is_in_every_file(tmp_path: Path) -> None:
    import laspy

    origin = np.array([500_000.0, 4_800_000.0, -20.0])
    composed(tmp_path, params=dataclasses.replace(PARAMS, cloud_format="laz"), world=World(origin, Crs(32631)))
    cloud = laspy.read(tmp_path / "cloud.laz")
    assert cloud.x.min() > 499_990
    assert np.median(cloud.z) == pytest.approx(-20, abs=0.005)
    assert cloud["views"].max() == 6
    assert cloud.header.vlrs.get("WktCoordinateSystemVlr")[0].string == Crs(32631).wkt
    assert np.nanmedian(tifffile.imread(tmp_path / "elevation.tif")) == pytest.approx(-20, abs=0.005)
    with tifffile.TiffFile(tmp_path / "orthomosaic.tif") as file:
        tie = file.pages[0].tags[33922].value
    assert np.abs(np.array(tie[3:5]) - origin[:2]).max() < 10
    head = (tmp_path / "mesh.ply").read_bytes()[:300]
    assert b"comment crs EPSG:32631" in head
    assert b"comment add the origin 500000.000 4800000.000 -20.000" in head
    near = trimesh.load(tmp_path / "mesh.ply", process=False).vertices
    assert np.abs(near).max() < 10  # float32 far from an origin would be steps of centimetres
    assert trimesh.load(tmp_path / "mesh.glb").metadata["origin"] == origin.tolist()
    assert json.loads((tmp_path / "tileset.json").read_text())["asset"]["extras"]["origin"] == origin.tolist()


def test_without_a_scale_nothing_is_in_metres(tmp_path: Path) -> None:
    composed(tmp_path, world=World(crs=WITHOUT_SCALE, metric=False))
    assert b"comment unit baselines" in (tmp_path / "mesh.ply").read_bytes()[:200]
    with tifffile.TiffFile(tmp_path / "elevation.tif") as file:
        tags = file.pages[0].tags
        assert 3076 not in np.array(tags[34735].value).reshape(-1, 4)[:, 0]
        assert "unit unknown" in tags[34737].value


def test_pictures_of_one_place_are_compared_at_the_same_few_points(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Memory is bounded by how many there are; pictures that each chose others would have nothing in common."""
    seen: list[GainSample] = []

    def spied(samples: Iterable[GainSample], places: int, frames: int) -> Balance:
        seen.extend(samples)
        return balance_frames(seen, places, frames)

    monkeypatch.setattr(colors, "balance_frames", spied)
    monkeypatch.setattr(colors, "_SEEN_A_FRAME", 12)
    composed(tmp_path)
    assert [len(s.place) for s in seen] == [12] * 6
    assert len(set(seen[2].place.tolist()) & set(seen[3].place.tolist())) >= 6


def test_one_frame_gives_a_model(tmp_path: Path) -> None:
    assert composed(tmp_path, dive(1)).statistics["min_views"] == 1


@pytest.mark.parametrize("case", ["none", "blind", "apart"])
def test_what_gives_no_surface_is_refused_in_one_line(tmp_path: Path, case: str) -> None:
    frames: list[PosedFrame] = []
    if case == "blind":
        frames = [dataclasses.replace(f, depth=np.full_like(f.depth, np.nan)) for f in dive(2)]
    if case == "apart":
        frames = [taken(GROUND, looking_down(20.0 * k, 0.0), number=k) for k in range(2)]
    with pytest.raises(ModelError, match=r"^frames: expected [^\n]+$") as caught:
        composed(tmp_path, frames)
    assert caught.value.code is Code.MODEL_NOTHING


def test_a_map_too_large_is_coarser_and_says_so(tmp_path: Path) -> None:
    found = composed(tmp_path, params=dataclasses.replace(PARAMS, most_cells=100_000, tiles="never"))
    assert Code.MODEL_COARSENED in {finding.code for finding in found.findings}
    raster = tifffile.imread(tmp_path / "orthomosaic.tif")
    assert raster.shape[0] * raster.shape[1] <= 100_000
    assert (raster[..., 3] > 0).any()


def test_without_the_extra_the_mesh_is_whole_and_that_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from uw_recon_ros.model import mesh

    for module in (composing, mesh):
        monkeypatch.setattr(module, "has_extra", lambda: False)
    found = composed(tmp_path)
    assert Code.MODEL_EXTRA_ABSENT in {finding.code for finding in found.findings}
    assert 0.99 < found.statistics["triangles"] / found.statistics["triangles_before_simplification"] <= 1
    assert trimesh.load(tmp_path / "mesh.glb").to_geometry().visual.kind == "vertex"
