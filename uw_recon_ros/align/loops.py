"""Loops: frames that see the same place again, sought where the track says so and believed only with good reason."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.types import Matrix

_APART = 8  # frames; nearer ones are neighbours, no loop
_CLUSTER = 6  # frames of which only the best is tried
_GATE = 80.0  # chi2 of 6, of a loop against the track that leads to it
_INFLATED = 9.0  # of the track's own covariance, which is not to decide too narrowly
_FLOOR = np.diag([4e-4] * 3 + [4e-4] * 3)  # (2 cm)^2, (0.02 rad)^2


def footprints(poses: Matrix, depths: Matrix) -> Matrix:
    """(N, 3) places that the cameras look at, m: along the optical axes of `poses` (N, 4, 4), `depths` (N,) away."""
    return poses[:, :3, 3] + depths[:, None] * poses[:, :3, 2]


def candidates(
    seen: Matrix,
    radii: Matrix,
    parts: NDArray[np.int64],
    each: int,
    tried: set[tuple[int, int]],
    first: int = 0,
) -> list[tuple[int, int]]:
    """Pairs of frames that may show the same place, nearest first, at most `each` a frame.

    Parameters
    ----------
    seen : (N, 3) float64
        See `footprints`.
    radii : (N,) float64
        How far apart two footprints may be, m.
    parts : (N,) int
        Frames of different numbers have no common place yet.
    each : int
    tried : set of pairs
        Left out.
    first : int
        Frames before this one only serve as the other end.
    """
    found: list[tuple[int, int]] = []
    for k in range(max(_APART, first), len(seen)):
        before = np.arange(k - _APART + 1)
        apart = np.linalg.norm(seen[before] - seen[k], axis=1)
        near = before[(apart < radii[k]) & (parts[before] == parts[k])]
        chosen: list[int] = []
        for i in near[np.argsort(apart[near], kind="stable")]:
            if len(chosen) >= each:
                break
            if all(abs(int(i) - c) >= _CLUSTER for c in chosen):
                chosen.append(int(i))
        found += [(i, k) for i in chosen if (i, k) not in tried]
    return found


def summed_covariances(poses: Matrix, steps: Matrix) -> Matrix:
    """(N, 6, 6) sums of the steps' covariances carried into the world, so that any stretch is a difference of two.

    Parameters
    ----------
    poses : (N, 4, 4) float64
    steps : (N, 6, 6) float64
        Covariance of the step that leads to each pose (zero where none does), twist on the right.
    """
    carry = rigid.adjoint(poses)
    return np.asarray(np.cumsum(carry @ steps @ carry.transpose(0, 2, 1), axis=0))


def loop_chi2(poses: Matrix, sums: Matrix, i: int, k: int, motion: Matrix, covariance: Matrix) -> float:
    """chi2 (of 6) of a loop ``i <- k`` against the track between the two."""
    back = rigid.adjoint(rigid.inverse(poses[k]))
    track = back @ (sums[k] - sums[i]) @ back.T
    missed = rigid.log(rigid.inverse(motion) @ rigid.inverse(poses[i]) @ poses[k])
    whole = _INFLATED * track + covariance + _FLOOR
    return float(missed @ np.linalg.solve(whole, missed))


def passes_chi2_gate(chi2: float) -> bool:
    """Whether a loop may be: the track, drifting as it does, could have led there."""
    return chi2 < _GATE
