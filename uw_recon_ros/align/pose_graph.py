"""The pose graph: poses that fit all relations best, by Gauss-Newton on SE(3) with sparse matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import SuperLU, splu

from uw_recon_ros import rigid
from uw_recon_ros.trajectory import JointCovariance
from uw_recon_ros.types import Matrix

_ROUNDS = 30
_CONVERGED, _NEARLY = 1e-6, 1e-4  # largest step, m and rad; the second where a finer solution follows
_COVARIANCES = 100  # poses whose covariance is computed; between them it is interpolated
_AT_ONCE = 10  # of them: the solver is faster with several right sides, and each takes memory
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
        Of the twist on the right; NaN where they were not asked for.
    squares : (E,) float64
        chi2 (of 6) of each edge.
    anchor_squares : (A,) float64
        chi2 of each anchor.
    rounds : int
    joint : JointCovariance or None
        At about 100 poses; None where it was not asked for.
    """

    poses: Matrix
    covariances: Matrix
    squares: Matrix
    anchor_squares: Matrix
    rounds: int
    joint: JointCovariance | None = None


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
    """The normal equations. Where their blocks go is worked out once; every round only adds up."""

    def __init__(self, count: int, edges: Edges, anchors: Anchors, held: NDArray[np.int64]) -> None:
        self.count, self.edges, self.anchors = count, edges, anchors
        self.information = np.linalg.inv(edges.covariances)
        self.floor = np.tile(1e-9 * np.eye(6), (count, 1, 1))
        self.floor[held] += _HELD * np.eye(6)
        i, j, every = edges.first, edges.second, np.arange(count)
        self._place(
            np.concatenate([i, i, j, j, anchors.index, every]), np.concatenate([i, j, i, j, anchors.index, every])
        )

    def _place(self, rows: NDArray[np.int64], columns: NDArray[np.int64]) -> None:
        """The pattern of the matrix, and the slot in it of every number of blocks at (rows, columns)."""
        side, inner = 6 * self.count, np.arange(6)
        row = 6 * rows[:, None, None] + inner[None, :, None]
        column = 6 * columns[:, None, None] + inner[None, None, :]
        keys, self.slots = np.unique((column * side + row).ravel(), return_inverse=True)
        self.indices = (keys % side).astype(np.int32)
        self.starts = np.searchsorted(keys, np.arange(side + 1) * side).astype(np.int32)

    def matrix(self, blocks: Matrix) -> sparse.csc_matrix:
        """Blocks (B, 6, 6) put where they belong."""
        side = 6 * self.count
        data = np.bincount(self.slots.ravel(), weights=blocks.ravel(), minlength=len(self.indices))
        return sparse.csc_matrix((data, self.indices, self.starts), shape=(side, side))

    def build(self, poses: Matrix, weights: Matrix, anchor_weights: Matrix) -> tuple[sparse.csc_matrix, Matrix]:
        """Matrix and gradient of the normal equations."""
        missed = residuals(poses, self.edges)
        a, b = _slopes(poses, self.edges, missed)
        strong = weights[:, None, None] * self.information
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


def joined(several: Sequence[Anchors]) -> Anchors:
    """All anchors, one after the other."""
    found = [no_anchors(), *several]
    return Anchors(
        np.concatenate([a.index for a in found]), np.concatenate([a.poses for a in found]),
        np.concatenate([a.information for a in found]),
    )  # fmt: skip


def solve_graph(
    poses: Matrix,
    edges: Edges,
    held: NDArray[np.int64],
    anchors: Anchors | None = None,
    *,
    robust_scale: float = 30.0,
    rounds: int = _ROUNDS,
    final: bool = True,
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
    rounds : int
        At most.
    final : bool
        Whether covariances are wanted, and the last digits; else another solution begins from this one.

    Notes
    -----
    Gauss-Newton as in Grisetti et al. (2010), robust as in Geman and McClure; covariances from the factored normal
    equations at about 100 poses, interpolated between.
    """
    known = no_anchors() if anchors is None else anchors
    system = _System(len(poses), edges, known, held)
    information, enough = system.information, _CONVERGED if final else _NEARLY
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
        if np.abs(step).max() < enough:
            break
    squares = _squares(residuals(poses, edges), information)
    anchor_squares = _squares(_anchor_terms(poses, known)[0], known.information)
    joint = _joint(factor, len(poses)) if final and factor is not None else None
    return Solved(poses, _covariances(joint, len(poses)), squares, anchor_squares, done, joint)


def _joint(factor: SuperLU, count: int) -> JointCovariance:
    chosen = np.unique(np.linspace(0, count - 1, min(count, _COVARIANCES)).round().astype(np.int64))
    rows = (6 * chosen[:, None] + np.arange(6)).ravel()
    found = np.empty((len(rows), len(rows)))
    for first in range(0, len(rows), 6 * _AT_ONCE):
        places = rows[first : first + 6 * _AT_ONCE]
        unit = np.zeros((6 * count, len(places)), order="F")
        unit[places, np.arange(len(places))] = 1.0
        found[:, first : first + len(places)] = factor.solve(unit)[rows]
    return JointCovariance(chosen, (found + found.T) / 2)


def _covariances(joint: JointCovariance | None, count: int) -> Matrix:
    if joint is None:
        return np.full((count, 6, 6), np.nan)
    chosen = joint.index
    each = np.arange(len(chosen))
    found = joint.matrix.reshape(len(chosen), 6, len(chosen), 6)[each, :, each]
    after = np.searchsorted(chosen, np.arange(count)).clip(0, len(chosen) - 1)
    before = np.maximum(after - 1, 0)
    width = np.maximum(chosen[after] - chosen[before], 1)
    share = ((np.arange(count) - chosen[before]) / width).clip(0, 1)[:, None, None]
    between: Matrix = (1 - share) * found[before] + share * found[after]
    return between
