"""Poses from outside: when, where, and how sure; partial knowledge (a depth, a position, an attitude) included."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from uw_recon_ros import rigid
from uw_recon_ros.align.pose_graph import Anchors, no_anchors
from uw_recon_ros.trajectory import Trajectory
from uw_recon_ros.types import Matrix

_LONGEST_GAP_NS = 3_000_000_000  # between which it is interpolated
_LOOSE = np.diag([1e-6] * 3 + [1 / 0.3**2] * 3)  # holds what priors leave open where it was laid
_SURE_HEADING = 1 / 0.1**2  # information (1/rad^2) from which a heading is not turned to fit positions
_WIDE_SIGMAS = 5.0  # of the positions; a track that reaches less far does not tell a heading


@dataclass(frozen=True, eq=False)
class Priors:
    """What is known from outside.

    Parameters
    ----------
    stamps_ns : (M,) int64
        Increasing, on the clock of the images.
    poses : (M, 4, 4) float64
        World <- left rectified optical frame, m.
    information : (6, 6) float64
        Inverse covariance of the position (m) and of the rotation (rad), both in the world's axes; zero for what is not
        known.
    smooth : bool
        Whether differences between neighbours are better than the positions themselves (odometry): then they also say
        where to look.
    name : str
        What is told of it, e.g. its topic.
    absolute : bool
        Whether poses are tied to it; else only differences are used.
    """

    stamps_ns: NDArray[np.int64]
    poses: Matrix
    information: Matrix
    smooth: bool = True
    name: str = "poses from outside"
    absolute: bool = True

    @property
    def known(self) -> NDArray[np.bool_]:
        """(6,) whether anything is known of x, y, z and of the rotation about each."""
        return np.asarray(np.diag(self.information) > 0, np.bool_)


def priors_from_trajectory(
    given: Trajectory, position_sigma_m: float, rotation_sigma_rad: float, offset_ns: int = 0
) -> Priors:
    """A trajectory from outside, e.g. a CSV file; `offset_ns` is added to its stamps."""
    information = np.diag(np.r_[np.full(3, position_sigma_m**-2.0), np.full(3, rotation_sigma_rad**-2.0)])
    return Priors(given.stamps_ns + offset_ns, given.poses, information)


def _interpolated(stamps_ns: Sequence[int], priors: Priors) -> tuple[NDArray[np.int64], Matrix]:
    """Indices of the stamps that lie between two near priors, and the poses there."""
    asked = np.array(stamps_ns, np.int64)
    after = np.searchsorted(priors.stamps_ns, asked).clip(1, max(len(priors.stamps_ns) - 1, 1))
    if len(priors.stamps_ns) < 2:
        return np.zeros(0, np.int64), np.zeros((0, 4, 4))
    low, high = priors.stamps_ns[after - 1], priors.stamps_ns[after]
    inside = np.flatnonzero((asked >= low) & (asked <= high) & (high - low <= _LONGEST_GAP_NS))
    start = priors.stamps_ns[0]
    at = (asked[inside] - start) / 1e9
    known = (priors.stamps_ns - start) / 1e9
    poses = np.tile(np.eye(4), (len(inside), 1, 1))
    if len(inside):
        turns = Slerp(known, Rotation.from_matrix(priors.poses[:, :3, :3]))
        poses[:, :3, :3] = turns(at.clip(known[0], known[-1])).as_matrix()
        poses[:, :3, 3] = np.stack([np.interp(at, known, priors.poses[:, c, 3]) for c in range(3)], axis=1)
    return inside, poses


def relative_guesses(stamps_ns: list[int], priors: Sequence[Priors]) -> Iterator[Matrix | None]:
    """For each frame, as `stamps_ns` grows: its pose relative to the frame before; None where that is not known."""
    whole = next((p for p in priors if p.smooth and p.known.all()), None)
    while True:
        if whole is None or len(stamps_ns) < 2:
            yield None
            continue
        inside, poses = _interpolated(stamps_ns[-2:], whole)
        yield rigid.inverse(poses[0]) @ poses[1] if len(inside) == 2 else None


def anchors_at(stamps_ns: list[int], priors: Sequence[Priors]) -> list[Anchors]:
    """Each of the priors at the frames; none where only its differences count."""
    return [_anchors(stamps_ns, p) if p.absolute else no_anchors() for p in priors]


def _anchors(stamps_ns: list[int], priors: Priors) -> Anchors:
    """One that is measured less often than frames are taken counts no more often than it is measured."""
    inside, poses = _interpolated(stamps_ns, priors)
    often = min(1.0, _interval(stamps_ns) / max(_interval(priors.stamps_ns), 1.0))
    information = np.tile(often * priors.information, (len(inside), 1, 1))
    turn = poses[:, :3, :3]
    information[:, 3:, 3:] = turn.transpose(0, 2, 1) @ information[:, 3:, 3:] @ turn  # in the camera's axes
    return Anchors(inside, poses, information)


def _interval(stamps_ns: Sequence[int] | NDArray[np.int64]) -> float:
    return float(np.median(np.diff(np.asarray(stamps_ns, np.int64)))) if len(stamps_ns) > 1 else 1.0


def held_loosely(poses: Matrix, parts: NDArray[np.int64], anchors: Sequence[Anchors]) -> Anchors:
    """A weak anchor at the first frame of each part that has others: what they leave open stays as it was laid."""
    tied = np.isin(parts, parts[np.concatenate([np.zeros(0, np.int64), *(a.index for a in anchors)])])
    first = np.unique(parts, return_index=True)[1]
    first = first[tied[first]].astype(np.int64)
    return Anchors(first, poses[first], np.tile(_LOOSE, (len(first), 1, 1)))


def fit_to(poses: Matrix, parts: NDArray[np.int64], stamps_ns: list[int], priors: Sequence[Priors]) -> Matrix:
    """Lay each part where the priors say: attitude, then heading, then place; the graph does the rest."""
    moved: Matrix = poses.copy()
    for number in np.unique(parts):
        where = np.flatnonzero(parts == number)
        moved[where] = _laid(moved[where], [stamps_ns[k] for k in where], priors)
    return moved


def _laid(poses: Matrix, stamps_ns: list[int], priors: Sequence[Priors]) -> Matrix:
    seen = [(p, *_interpolated(stamps_ns, p)) for p in priors]
    for p, inside, given in seen:
        if p.known[3:].all() and len(inside):
            mean = Rotation.from_matrix(given[:, :3, :3] @ poses[inside, :3, :3].transpose(0, 2, 1)).mean()
            poses = _turned(poses, mean.as_matrix())
            break
    sure = any(p.information[5, 5] > _SURE_HEADING and len(inside) for p, inside, _ in seen)
    for p, inside, given in seen:
        if p.known[:2].all() and len(inside) and not sure:
            poses = _turned(poses, _heading(poses[inside, :3, 3], given[:, :3, 3], p))
    for p, inside, given in seen:
        axes = np.flatnonzero(p.known[:3])
        if len(axes) and len(inside):
            poses[:, axes, 3] += np.median(given[:, axes, 3] - poses[inside][:, axes, 3], axis=0)
    return poses


def _turned(poses: Matrix, turn: Matrix) -> Matrix:
    whole = np.eye(4)
    whole[:3, :3] = turn
    turned: Matrix = whole @ poses
    return turned


def _heading(ours: Matrix, given: Matrix, priors: Priors) -> Matrix:
    """Turn about the vertical that lays a track on positions, where it reaches far enough to tell."""
    a, b = (x[:, :2] - x[:, :2].mean(axis=0) for x in (ours, given))
    reach = float(np.linalg.norm(a, axis=1).max())
    if reach < _WIDE_SIGMAS / np.sqrt(priors.information[0, 0]) / np.sqrt(len(a)):
        return np.eye(3)
    angle = np.arctan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    return np.asarray(Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix(), np.float64)
