"""Poses from outside: when, where, and how sure; partial knowledge (a depth, a position, an attitude) included."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation, Slerp

from uw_recon_ros import rigid
from uw_recon_ros.align.graph import Anchors
from uw_recon_ros.trajectory import Trajectory
from uw_recon_ros.types import Matrix

_LONGEST_GAP_NS = 3_000_000_000  # between which it is interpolated
_EARTH_M = 6_378_137.0


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
        Inverse covariance of the position in the world's axes (m), then of the rotation in the camera's (rad); zero for
        what is not known.
    smooth : bool
        Whether differences between neighbours are better than the positions themselves (odometry): then they also say
        where to look.
    """

    stamps_ns: NDArray[np.int64]
    poses: Matrix
    information: Matrix
    smooth: bool = True


def priors_from_trajectory(
    given: Trajectory, position_sigma_m: float, rotation_sigma_rad: float, offset_ns: int = 0
) -> Priors:
    """A trajectory from outside, e.g. a CSV file; `offset_ns` is added to its stamps."""
    information = np.diag(np.r_[np.full(3, position_sigma_m**-2.0), np.full(3, rotation_sigma_rad**-2.0)])
    return Priors(given.stamps_ns + offset_ns, given.poses, information)


def _interpolated(stamps_ns: list[int], priors: Priors) -> tuple[NDArray[np.int64], Matrix]:
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


def relative_guesses(stamps_ns: list[int], priors: Priors) -> Iterator[Matrix | None]:
    """For each frame, as `stamps_ns` grows: its pose relative to the frame before; None where that is not known."""
    whole = priors.smooth and bool((np.diag(priors.information) > 0).all())
    while True:
        if not whole or len(stamps_ns) < 2:
            yield None
            continue
        inside, poses = _interpolated(stamps_ns[-2:], priors)
        yield rigid.inverse(poses[0]) @ poses[1] if len(inside) == 2 else None


def anchors_at(stamps_ns: list[int], priors: Priors) -> Anchors:
    """The priors at the frames."""
    inside, poses = _interpolated(stamps_ns, priors)
    return Anchors(inside, poses, np.tile(priors.information, (len(inside), 1, 1)))


def fit_to(poses: Matrix, parts: NDArray[np.int64], stamps_ns: list[int], priors: Priors | None) -> Matrix:
    """Lay each part where the priors say, by the first pose they know of it: the graph does the rest."""
    if priors is None or not (np.diag(priors.information) > 0).all():
        return poses
    inside, known = _interpolated(stamps_ns, priors)
    moved: Matrix = poses.copy()
    for number in np.unique(parts):
        shared = np.flatnonzero(parts[inside] == number)
        if len(shared):
            middle = shared[len(shared) // 2]
            change = known[middle] @ rigid.inverse(poses[inside[middle]])
            moved[parts == number] = change @ poses[parts == number]
    return moved
