"""Files read back by another reader hold what was written, and never half of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from helpers.reconstruct_scenes import HORIZONTAL, depth_map, picture, plane_depth, sphere_depth

from uw_recon_ros.errors import ReconError
from uw_recon_ros.files.meshes import GLTF_FROM_OPTICAL, write_glb, write_ply
from uw_recon_ros.reconstruct.cloud import organised_cloud
from uw_recon_ros.reconstruct.surface import build_surface


@pytest.fixture(scope="module")
def depth():
    truth = np.minimum(sphere_depth(HORIZONTAL, (0, 0, 2), 0.6), plane_depth(HORIZONTAL, (0.3, 0.2, 1), 2.2))
    truth[10:30, 20:50] = np.nan
    return depth_map(truth, HORIZONTAL)


@pytest.fixture(scope="module")
def surface(depth):
    return build_surface(
        depth,
        picture(),
        max_vertices=2000,
        tolerance_px=0.1,
        max_jump_px=1.0,
        max_gap_px=0,
        max_obliqueness_deg=85.0,
        min_area_px=9,
    )


def ply_element(path):
    """Vertex properties of a PLY file as a structured array, read by hand."""
    header, _, body = path.read_bytes().partition(b"end_header\n")
    lines = header.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    start = next(i for i, line in enumerate(lines) if line.startswith("element vertex"))
    kinds, names = {"float": "<f4", "uchar": "u1"}, []
    for line in lines[start + 1 :]:
        if not line.startswith("property"):
            break
        names.append((line.split()[2], kinds[line.split()[1]]))
    return np.frombuffer(body, names, int(lines[start].split()[2]))


def columns(element, names):
    return np.stack([element[name] for name in names], axis=1)


def test_ply_of_a_cloud_holds_points_normals_and_colours(tmp_path, depth):
    cloud = organised_cloud(depth, picture())
    write_ply(tmp_path / "cloud.ply", cloud)
    there = np.isfinite(cloud.points[..., 0])
    element = ply_element(tmp_path / "cloud.ply")
    assert np.array_equal(columns(element, "xyz"), cloud.points[there])
    assert np.array_equal(columns(element, ("nx", "ny", "nz")), cloud.normals[there])
    assert np.array_equal(columns(element, ("red", "green", "blue")), cloud.colors[there])
    read = trimesh.load(tmp_path / "cloud.ply")
    assert isinstance(read, trimesh.PointCloud)
    assert np.array_equal(np.float32(read.vertices), cloud.points[there])
    assert np.array_equal(read.colors[:, :3], cloud.colors[there])


def test_ply_of_a_cloud_without_normals(tmp_path, depth):
    write_ply(tmp_path / "c.ply", replace(organised_cloud(depth, picture()), normals=None))
    assert "nx" not in ply_element(tmp_path / "c.ply").dtype.names


def test_ply_of_a_surface_reads_back(tmp_path, surface):
    write_ply(tmp_path / "mesh.ply", surface)
    read = trimesh.load(tmp_path / "mesh.ply", process=False)
    assert np.array_equal(read.faces, surface.faces)
    np.testing.assert_allclose(read.vertices, surface.vertices)
    np.testing.assert_allclose(read.vertex_normals, surface.normals, atol=1e-6)
    assert np.array_equal(read.visual.vertex_colors[:, :3], surface.colors)
    assert np.array_equal(columns(ply_element(tmp_path / "mesh.ply"), ("nx", "ny", "nz")), surface.normals)


def test_glb_reads_back_with_texture_normals_and_gltf_axes(tmp_path, surface):
    write_glb(tmp_path / "mesh.glb", surface)
    scene = trimesh.load(tmp_path / "mesh.glb", process=False)
    (read,) = scene.geometry.values()
    assert np.array_equal(read.faces, surface.faces)
    np.testing.assert_allclose(read.vertices, surface.vertices)
    np.testing.assert_allclose(read.vertex_normals, surface.normals, atol=1e-6)
    np.testing.assert_allclose(read.visual.uv, surface.uv, atol=1e-6)
    assert np.array_equal(np.asarray(read.visual.material.baseColorTexture.convert("RGB")), surface.texture)
    in_gltf = scene.to_mesh().vertices
    np.testing.assert_allclose(in_gltf, surface.vertices * [1, -1, -1], atol=1e-6)
    assert np.linalg.det(GLTF_FROM_OPTICAL) == pytest.approx(1)  # no mirror image


def test_glb_texture_lands_where_the_vertex_colours_say(tmp_path, surface):
    """glTF's v runs down, ours up: the file must say which pixel a vertex shows."""
    write_glb(tmp_path / "mesh.glb", surface)
    (read,) = trimesh.load(tmp_path / "mesh.glb", process=False).geometry.values()
    shown = read.visual.to_color().vertex_colors[:, :3].astype(int)
    assert np.median(np.abs(shown - surface.colors)) <= 4


def test_glb_needs_a_triangle(tmp_path, surface):
    with pytest.raises(ReconError, match=r"x\.glb: expected a surface of at least one triangle, got none"):
        write_glb(tmp_path / "x.glb", replace(surface, faces=np.zeros((0, 3), np.int32)))
    assert list(tmp_path.iterdir()) == []


def test_a_failed_write_leaves_the_old_file_and_no_litter(tmp_path, surface, monkeypatch):
    path = tmp_path / "mesh.ply"
    path.write_text("old")

    def full_disk(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full_disk)
    with pytest.raises(OSError, match="No space left"):
        write_ply(path, surface)
    assert path.read_text() == "old"
    assert [p.name for p in tmp_path.iterdir()] == ["mesh.ply"]


def test_a_missing_folder_is_an_os_error(tmp_path, surface):
    with pytest.raises(OSError, match="nowhere"):
        write_ply(tmp_path / "nowhere" / "mesh.ply", surface)
