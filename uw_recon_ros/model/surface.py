"""The surface of a dive, tile by tile: each tile reads only the frames that see it."""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from uw_recon_ros import __version__
from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code
from uw_recon_ros.fuse.blocks import BLOCK, TILE, Keys
from uw_recon_ros.fuse.frame import view_of
from uw_recon_ros.fuse.integrate import empty_volume
from uw_recon_ros.fuse.layout import Layout, LayoutBuilder, footprint_of, voxel_for
from uw_recon_ros.fuse.marching_cubes import Patch, extract, joined
from uw_recon_ros.fuse.surface_pieces import seen_by, without_loose_pieces
from uw_recon_ros.model.work import Arrays, TileTask
from uw_recon_ros.texturing.best_view import sharpness_of
from uw_recon_ros.types import Matrix

_LOOKED_AT = 24  # frames that choose the size of the voxels
_SIGMA_VOXELS, _USUAL_SIGMAS = 1.2, 2.0  # beyond both, a depth is left out
_SHARP_WINDOW = 5  # frames to either side that sharpness is relative to


@dataclass(frozen=True, eq=False)
class Found:
    """A dive looked through.

    Parameters
    ----------
    layout : Layout
    sharpness : (F,) float64
        Relative to the frames before and after, 0.1 to 1.
    least_views : int
        That a piece of surface needs.
    max_sigma : float
        Of a depth that counts, m.
    """

    layout: Layout
    sharpness: Matrix
    least_views: int
    max_sigma: float


def chosen_sizes(task: TileTask) -> tuple[float, float]:
    """Edge of the voxels, and the sigma up to which a depth counts, m: as told, or as the dive's depths suggest.

    Raises
    ------
    ModelError
        No frame, or none with any depth.
    """
    step = max(1, len(task.frames) // _LOOKED_AT)
    views = [view_of(task.frames[k]) for k in range(0, len(task.frames), step)]
    seen = [view for view in views if np.isfinite(view.depth).any()]
    if not seen:
        text = f"frames: expected depth in some of {len(task.frames)}, got none: too little was matched"
        raise ModelError(text, Code.MODEL_NOTHING)
    voxel = task.params.voxel_m or voxel_for([footprint_of(view) for view in seen])
    usual = float(np.median([np.nanmedian(view.sigma) for view in seen]))
    return voxel, task.params.max_sigma_m or max(_SIGMA_VOXELS * voxel, float(f"{_USUAL_SIGMAS * usual:.2g}"))


def look_through(task: TileTask) -> Found:
    """Read every frame once: what of space is filled, how sharp each picture is, what the work is made from.

    Raises
    ------
    ModelError
        No frame, or none with any depth.
    """
    voxel, limit = chosen_sizes(task)
    builder, sharp, sums = LayoutBuilder(voxel, task.params.truncation_sigmas), [], []
    for number in range(len(task.frames)):
        frame = task.frames[number]
        builder.add(view_of(frame, limit))
        sharp.append(sharpness_of(frame.left))
        sums.append([frame.stamp_ns, *(_sum(a) for a in (frame.pose, frame.depth, frame.sigma, frame.left))])
        task.tell("frames looked through", number + 1, len(task.frames))
    task.claim(_made_from(task, voxel, sums))
    least = min(task.params.min_views, len(task.frames))
    return Found(builder.finish(), _relative(np.array(sharp)), least, limit)


def _sum(array: np.ndarray[Any, Any]) -> int:
    return zlib.crc32(np.ascontiguousarray(array).data)


def _made_from(task: TileTask, voxel: float, sums: list[list[int]]) -> dict[str, Any]:
    """Everything the results depend on, but for the number of jobs."""
    params = {s.name: getattr(task.params, s.name) for s in task.params.specs() if s.name != "jobs"}
    origin, crs = task.world.origin.tolist(), task.world.crs.text
    return {"version": __version__, "params": params, "voxel": voxel, "origin": origin, "crs": crs, "frames": sums}


def _relative(sharp: Matrix) -> Matrix:
    """Sharpness over the median of the frames around."""
    padded = np.pad(sharp, _SHARP_WINDOW, mode="reflect" if len(sharp) > _SHARP_WINDOW else "edge")
    around = np.lib.stride_tricks.sliding_window_view(padded, 2 * _SHARP_WINDOW + 1)
    usual = np.maximum(np.median(around, axis=1), 1e-9)
    return np.clip(sharp / usual, 0.1, 1.0)


def patch_of(task: TileTask, found: Found, tile: Keys) -> Patch:
    """The surface in one tile, from the disk where it was made before."""
    name = "tile_" + "_".join(str(k) for k in tile.tolist())
    return Patch(**task.kept(name, lambda: _as_arrays(_fuse_tile(task, found, tile))))


def _as_arrays(patch: Patch) -> Arrays:
    return {name: getattr(patch, name) for name in ("vertices", "faces", "sigma", "views", "keys")}


def _fuse_tile(task: TileTask, found: Found, tile: Keys) -> Patch:
    layout = found.layout
    volume = empty_volume(layout.blocks_of(tile), layout.voxel)
    for number in layout.frames_of(tile).tolist():
        volume.add(view_of(task.frames[number], found.max_sigma), layout.band)
    patch = seen_by(extract(volume, tile), found.least_views)
    return without_loose_pieces(patch, task.params.island_faces, _on_border(patch, tile, layout))


def _on_border(patch: Patch, tile: Keys, layout: Layout) -> np.ndarray[Any, np.dtype[np.bool_]]:
    """Vertices on a tile's faces, where a piece may go on."""
    place = patch.vertices / layout.voxel - tile * (BLOCK * TILE)
    return np.asarray(((place < 1e-6) | (place > BLOCK * TILE - 1e-6)).any(axis=1))


def fuse_all(task: TileTask, found: Found) -> int:
    """Fuse every tile, so that `patch_of` finds it; returns the number of triangles.

    Raises
    ------
    ModelError
        There is no surface at all.
    """
    faces = sum(task.each("tiles fused", lambda tile: len(patch_of(task, found, tile).faces), found.layout.tiles))
    if not faces:
        text = f"frames: expected a surface that {found.least_views} of {len(task.frames)} frames see, got none"
        raise ModelError(f"{text}: do they overlap, and are the poses theirs?", Code.MODEL_NOTHING)
    return faces


def column_patch(task: TileTask, found: Found, column: Keys) -> Patch:
    """The surface in all tiles above each other."""
    tiles = found.layout.tiles
    return joined([patch_of(task, found, tile) for tile in tiles[(tiles[:, :2] == column).all(axis=1)]])


def columns_of(layout: Layout) -> Keys:
    """(C, 2) columns of tiles, sorted."""
    return np.unique(layout.tiles[:, :2], axis=0)
