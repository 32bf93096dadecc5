"""The pose graph: poses that fit all relations best, by Gauss-Newton on SE(3) with sparse matrices."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from uw_recon_ros import rigid
from uw_recon_ros.types import Matrix

_ROUNDS = 30
_CONVERGED = 1e-6
_COVARIANCES = 200  # poses whose covariance is computed; between them it is interpolated
_HELD = 1e12  # information that ties the first pose of a part


@dataclass(frozen=True, eq=False)
class Edges:
    """Relations between poses.

    Parameters
    ----------
    first, second : (E,) int64
        Numbers of poses.
    motions : (E, 4, 4) float64
        first <- second.
    covariances : (E, 6, 6) float64
        Of the twist on the right.
    robust : (E,) bool
        Whether one that does not fit pulls less (loops).
    """

    first: NDArray[np.int64]
    second: NDArray[np.int64]
    motions: Matrix
    covariances: Matrix
    robust: NDArray[np.bool_]

    def picked(self, which: NDArray[np.bool_]) -> Edges:
        """Some of them."""
        return Edges(
            self.first[which], self.second[which], self.motions[which], self.covariances[which], self.robust[which]
        )


@dataclass(frozen=True, eq=False)
class Anchors:
    """What is known of poses from outside.

    Parameters
    ----------
    index : (A,) int64
        Numbers of poses.
    poses : (A, 4, 4) float64
        World <- camera.
    information : (A, 6, 6) float64
        Of the position in the world's axes, then the rotation in the camera's; zero where nothing is known.
    """

    index: NDArray[np.int64]
    poses: Matrix
    information: Matrix


@dataclass(frozen=True, eq=False)
class Solved:
    """What the graph found.

    Parameters
    ----------
    poses : (N, 4, 4) float64
    covariances : (N, 6, 6) float64
        Of the twist on the right.
    squares : (E,) float64
        chi2 (of 6) of each edge.
    anchor_squares : (A,) float64
        chi2 of each anchor.
    rounds : int
    """

    poses: Matrix
    covariances: Matrix
    squares: Matrix
    anchor_squares: Matrix
    rounds: int


def residuals(poses: Matrix, edges: Edges) -> Matrix:
    """(E, 6) twists by which the poses miss the relations."""
    between = rigid.inverse(poses[edges.first]) @ poses[edges.second]
    return rigid.log(rigid.inverse(edges.motions) @ between)


def _slopes(poses: Matrix, edges: Edges, missed: Matrix) -> tuple[Matrix, Matrix]:
    """(E, 6, 6) derivatives of `residuals` by twists on the right of the first and the second pose."""
    after = np.eye(6) + 0.5 * rigid.small_adjoint(missed)
    back = rigid.inverse(poses[edges.second]) @ poses[edges.first]
    return -after @ rigid.adjoint(back), after


def _anchor_terms(poses: Matrix, anchors: Anchors) -> tuple[Matrix, Matrix]:
    """Residuals (A, 6) and slopes (A, 6, 6)."""
    at = poses[anchors.index]
    turned = rigid.inverse(anchors.poses) @ at
    turned[:, :3, 3] = 0.0
    missed = np.concatenate([at[:, :3, 3] - anchors.poses[:, :3, 3], rigid.log(turned)[:, 3:]], axis=1)
    slopes = np.zeros((len(at), 6, 6))
    slopes[:, :3, :3] = at[:, :3, :3]
    slopes[:, 3:, 3:] = np.eye(3)
    return missed, slopes


def _squares(missed: Matrix, information: NDArray[Any]) -> Matrix:
    found: Matrix = np.einsum("ei,eij,ej->e", missed, information, missed)
    return found


def _robust(squares: Matrix, scale: float) -> Matrix:
    """Geman and McClure's weights: what misses far does not pull at all."""
    return (scale / (scale + squares)) ** 2


class _System:
    """Where the blocks of the normal equations go; the same in every round."""

    def __init__(self, count: int, edges: Edges, anchors: Anchors, held: NDArray[np.int64]) -> None:
        i, j, every = edges.first, edges.second, np.arange(count)
        self.rows = np.concatenate([i, i, j, j, anchors.index, every])
        self.columns = np.concatenate([i, j, i, j, anchors.index, every])
        self.count, self.edges, self.anchors = count, edges, anchors
        self.floor = np.tile(1e-9 * np.eye(6), (count, 1, 1))
        self.floor[held] += _HELD * np.eye(6)

    def matrix(self, blocks: Matrix) -> sparse.csc_matrix:
        """Blocks (B, 6, 6) put where they belong."""
        inner = np.arange(6)
        rows = (6 * self.rows[:, None, None] + inner[None, :, None] + 0 * inner[None, None, :]).ravel()
        columns = (6 * self.columns[:, None, None] + 0 * inner[None, :, None] + inner[None, None, :]).ravel()
        return sparse.csc_matrix((blocks.ravel(), (rows, columns)), shape=(6 * self.count, 6 * self.count))

    def build(self, poses: Matrix, weights: Matrix, anchor_weights: Matrix) -> tuple[sparse.csc_matrix, Matrix]:
        """Matrix and gradient of the normal equations."""
        missed = residuals(poses, self.edges)
        a, b = _slopes(poses, self.edges, missed)
        strong = weights[:, None, None] * np.linalg.inv(self.edges.covariances)
        at, bt = a.transpose(0, 2, 1) @ strong, b.transpose(0, 2, 1) @ strong
        off, c = _anchor_terms(poses, self.anchors)
        ct = c.transpose(0, 2, 1) @ (anchor_weights[:, None, None] * self.anchors.information)
        gradient = np.zeros((self.count, 6))
        np.add.at(gradient, self.edges.first, (at @ missed[..., None])[..., 0])
        np.add.at(gradient, self.edges.second, (bt @ missed[..., None])[..., 0])
        np.add.at(gradient, self.anchors.index, (ct @ off[..., None])[..., 0])
        blocks = np.concatenate([at @ a, at @ b, bt @ a, bt @ b, ct @ c, self.floor])
        return self.matrix(blocks), gradient.ravel()


def no_anchors() -> Anchors:
    """Nothing known from outside."""
    return Anchors(np.zeros(0, np.int64), np.zeros((0, 4, 4)), np.zeros((0, 6, 6)))


def solve_graph(
    poses: Matrix,
    edges: Edges,
    held: NDArray[np.int64],
    anchors: Anchors | None = None,
    *,
    robust_scale: float = 30.0,
    rounds: int = _ROUNDS,
) -> Solved:
    """Find the poses.

    Parameters
    ----------
    poses : (N, 4, 4) float64
        Where to begin.
    edges : Edges
    held : (H,) int64
        Poses that stay where they are, one in each part that nothing else ties.
    anchors : Anchors, optional
    robust_scale : float
        chi2 (of 6) at which a robust edge or an anchor has a quarter of its weight.

    Notes
    -----
    Gauss-Newton as in Grisetti et al. (2010), robust as in Geman and McClure; covariances from the factored normal
    equations at about 200 poses, interpolated between.
    """
    known = no_anchors() if anchors is None else anchors
    system = _System(len(poses), edges, known, held)
    information = np.linalg.inv(edges.covariances)
    factor: SuperLU | None = None
    done = 0
    for done in range(1, rounds + 1):  # noqa: B007
        squares = _squares(residuals(poses, edges), information)
        weights = np.where(edges.robust, _robust(squares, robust_scale), 1.0)
        anchor_squares = _squares(_anchor_terms(poses, known)[0], known.information)
        matrix, gradient = system.build(poses, weights, _robust(anchor_squares, robust_scale))
        factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
        step = -factor.solve(gradient).reshape(-1, 6)
        poses = poses @ rigid.exp(step)
        if np.abs(step).max() < _CONVERGED:
            break
    squares = _squares(residuals(poses, edges), information)
    anchor_squares = _squares(_anchor_terms(poses, known)[0], known.information)
    return Solved(poses, _covariances(factor, len(poses)), squares, anchor_squares, done)


def _covariances(factor: SuperLU | None, count: int) -> Matrix:
    if factor is None:
        return np.full((count, 6, 6), np.nan)
    chosen = np.unique(np.linspace(0, count - 1, min(count, _COVARIANCES)).round().astype(int))
    found = np.empty((len(chosen), 6, 6))
    for k, index in enumerate(chosen):
        unit = np.zeros((6 * count, 6))
        unit[6 * index : 6 * index + 6] = np.eye(6)
        block = factor.solve(unit)[6 * index : 6 * index + 6]
        found[k] = (block + block.T) / 2
    after = np.searchsorted(chosen, np.arange(count)).clip(0, len(chosen) - 1)
    before = np.maximum(after - 1, 0)
    width = np.maximum(chosen[after] - chosen[before], 1)
    share = ((np.arange(count) - chosen[before]) / width).clip(0, 1)[:, None, None]
    between: Matrix = (1 - share) * found[before] + share * found[after]
    return between
