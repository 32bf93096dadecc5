"""A few metres of the dive: depth maps fused one by one, then a surface with colours that stays as it is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from uw_recon_ros.fuse.blocks import touched_blocks
from uw_recon_ros.fuse.frame import PosedFrame, View, view_of
from uw_recon_ros.fuse.integrate import Volume, empty_volume
from uw_recon_ros.fuse.layout import band_of
from uw_recon_ros.fuse.marching_cubes import Patch, extract
from uw_recon_ros.fuse.surface_pieces import seen_by, without_loose_pieces
from uw_recon_ros.types import ByteImage, Matrix

_SIGMAS, _SIGMA_VOXELS = 3.0, 2.0  # of the truncation; beyond so many voxels a depth is left out
_LEAST_VIEWS, _LEAST_FACES = 2, 30
_NEAR_VOXELS = 3.0  # between surface and a picture's depth


@dataclass(frozen=True, eq=False)
class Submap:
    """What is left of a submap when it is closed.

    Parameters
    ----------
    anchor : int
        Number of its first key frame.
    patch : Patch
        In the frame that the key frames' poses are in.
    colors : (N, 3) uint8
        RGB of its vertices.
    """

    anchor: int
    patch: Patch
    colors: ByteImage


class OpenSubmap:
    """A submap that frames are added to.

    Parameters
    ----------
    anchor : int
    voxel : float
        m.
    """

    def __init__(self, anchor: int, voxel: float) -> None:
        self.anchor, self._band = anchor, band_of(voxel, _SIGMAS)
        self._volume = empty_volume(np.empty(0, np.int64), voxel)
        self._seen: list[tuple[View, ByteImage]] = []

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, frame: PosedFrame) -> None:
        """Fuse a frame."""
        view = view_of(frame, _SIGMA_VOXELS * self._volume.voxel)
        self._volume = _grown(self._volume, touched_blocks(view, self._volume.voxel, self._band))
        self._volume.add(view, self._band)
        self._seen.append((view, frame.left))

    def closed(self) -> Submap:
        """Its surface as it is now."""
        patch = seen_by(extract(self._volume), min(_LEAST_VIEWS, len(self)))
        patch = without_loose_pieces(patch, _LEAST_FACES)
        return Submap(self.anchor, patch, self._colors(patch.vertices))

    def _colors(self, points: Matrix) -> ByteImage:
        """The mean of the pictures that show a point; gray where none does."""
        sums, counts = np.zeros((len(points), 3)), np.zeros(len(points))
        for view, left in self._seen:
            x, y, z = (points @ view.motion[:, :3].T + view.motion[:, 3]).T
            with np.errstate(divide="ignore", invalid="ignore"):
                u, v = (np.rint(view.lens[k] * p / z + view.lens[2 + k]) for k, p in ((0, x), (1, y)))
            height, width = view.depth.shape
            inside = np.flatnonzero((z > 0) & (u >= 0) & (v >= 0) & (u < width) & (v < height))
            rows, columns = v[inside].astype(int), u[inside].astype(int)
            shown = np.abs(view.depth[rows, columns] - z[inside]) < _NEAR_VOXELS * self._volume.voxel
            sums[inside[shown]] += left[rows[shown], columns[shown]]
            counts[inside[shown]] += 1
        mean = np.where(counts[:, None] > 0, sums / np.maximum(counts, 1)[:, None], 128.0)
        return np.asarray(np.rint(mean), np.uint8)


def warm_up() -> None:
    """Have every kernel compiled that fuses a frame."""
    flat, size = np.ones((16, 16), np.float32), (16, 16)
    frame = PosedFrame(
        0, np.zeros((*size, 3), np.uint8), flat, 0.01 * flat, np.array([16.0, 16.0, 8.0, 8.0]), np.eye(4)
    )
    submap = OpenSubmap(0, 0.05)
    submap.add(frame)
    submap.closed()


def _grown(volume: Volume, keys: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Volume:
    """With blocks of these names as well."""
    every = np.union1d(volume.keys, keys)
    if len(every) == len(volume.keys):
        return volume
    grown, place = empty_volume(every, volume.voxel), np.searchsorted(every, volume.keys)
    for name in ("distance", "weight", "square", "views"):
        getattr(grown, name)[place] = getattr(volume, name)
    return replace(grown, keys=every)
