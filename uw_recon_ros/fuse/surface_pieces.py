"""Pieces of surface: what hangs together, what is too little to be believed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.fuse.marching_cubes import Patch


def picked(patch: Patch, faces: NDArray[np.bool_]) -> Patch:
    """Some of its faces (M,), and the vertices they use."""
    kept = patch.faces[faces]
    used, inverse = np.unique(kept, return_inverse=True)
    return replace(
        patch, vertices=patch.vertices[used], faces=inverse.reshape(-1, 3).astype(np.int32), sigma=patch.sigma[used],
        views=patch.views[used], keys=patch.keys[used],
    )  # fmt: skip


def seen_by(patch: Patch, least_views: int) -> Patch:
    """The part that at least so many frames saw."""
    return picked(patch, np.asarray((patch.views[patch.faces] >= least_views).all(axis=1), np.bool_))


def without_loose_pieces(patch: Patch, least: int, touching: NDArray[np.bool_] | None = None) -> Patch:
    """Without pieces of fewer than `least` triangles.

    Parameters
    ----------
    patch : Patch
    least : int
    touching : (N,) bool, optional
        Vertices whose piece stays in any case: it may go on in a neighbour.
    """
    if not len(patch.faces):
        return patch
    count, labels = _pieces(patch)
    stays = np.bincount(labels[patch.faces[:, 0]], minlength=count) >= least
    if touching is not None:
        stays[labels[touching]] = True
    return picked(patch, stays[labels[patch.faces[:, 0]]])


def _pieces(patch: Patch) -> tuple[int, NDArray[np.int32]]:
    """How many pieces there are, and which one each vertex is in."""
    n, (a, b, c) = len(patch.vertices), patch.faces.T
    joints = coo_matrix((np.ones(2 * len(a), np.int8), (np.r_[a, b], np.r_[b, c])), (n, n))
    count, labels = connected_components(joints, directed=False)
    return int(count), labels
