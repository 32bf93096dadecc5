"""How far a trajectory is from the true one: drift over sub-paths, and absolute error after laying one on the other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.errors import TrajectoryError
from uw_recon_ros.trajectory import PoseStatus, Trajectory
from uw_recon_ros.types import Matrix

SUB_PATHS_M = (1.0, 4.0, 16.0)
_SAME_NS = 1_000_000


@dataclass(frozen=True)
class SegmentErrors:
    """Errors of one segment.

    Parameters
    ----------
    frames : int
    path_m : float
        Length of the true way.
    drift_percent : dict of str to float
        Root mean square over all sub-paths of about that length (``4 m``) of the error at their end, % of their length;
        NaN where there is none.
    ate_m : float
        Root mean square of the positions' errors after the best rotation and shift.
    ate_percent : float
        The same, % of the path.
    scale : float
        Estimated over true lengths: 1 is right.
    largest_m : float
        Largest error of a position.
    """

    frames: int
    path_m: float
    drift_percent: dict[str, float]
    ate_m: float
    ate_percent: float
    scale: float
    largest_m: float


@dataclass(frozen=True)
class TrajectoryErrors:
    """Result of `trajectory_errors`: segment by segment, for nothing is known between them.

    Parameters
    ----------
    segments : tuple of SegmentErrors
    matched, predicted : int
        Frames with a true pose; of these, those that nothing was seen of.
    missing : int
        True poses without an estimate.
    """

    segments: tuple[SegmentErrors, ...]
    matched: int
    predicted: int
    missing: int

    def as_dict(self) -> dict[str, Any]:
        """As nested dictionaries, for JSON."""
        return asdict(self)


def best_fit(estimate: Matrix, truth: Matrix) -> tuple[Matrix, Matrix, float]:
    """Rotation, shift and scale that lay points (N, 3) on others (Umeyama 1991): truth = scale R estimate + t."""
    a, b = estimate - estimate.mean(axis=0), truth - truth.mean(axis=0)
    u, spread, v = np.linalg.svd(b.T @ a)
    sign = np.array([1.0, 1.0, np.sign(np.linalg.det(u @ v))])
    rotation = u @ (sign[:, None] * v)
    square = float((a**2).sum())
    scale = float((spread * sign).sum() / square) if square > 0 else 1.0
    return rotation, truth.mean(axis=0) - rotation @ estimate.mean(axis=0), scale


def _matched(estimate: Trajectory, truth: Trajectory) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Indices in both of the frames of one stamp."""
    near = np.searchsorted(truth.stamps_ns, estimate.stamps_ns - _SAME_NS)
    near = near.clip(0, len(truth) - 1)
    same = np.abs(truth.stamps_ns[near] - estimate.stamps_ns) <= _SAME_NS
    return np.flatnonzero(same), near[same]


def drift(estimate: Matrix, truth: Matrix, length_m: float) -> float:
    """Root mean square error at the end of sub-paths of the true way, % of their length; NaN where there is none."""
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(truth[:, :3, 3], axis=0), axis=1))]
    ends = np.searchsorted(way, way + length_m - 1e-9)
    starts = np.flatnonzero(ends < len(way))
    if not len(starts):
        return float("nan")
    ends = ends[starts]
    wrong = rigid.inverse(rigid.inverse(truth[starts]) @ truth[ends]) @ rigid.inverse(estimate[starts]) @ estimate[ends]
    share = np.linalg.norm(wrong[:, :3, 3], axis=1) / (way[ends] - way[starts])
    return float(100 * np.sqrt((share**2).mean()))


def _segment(estimate: Trajectory, truth: Trajectory, lengths: Sequence[float]) -> SegmentErrors:
    a, b = estimate.positions + estimate.origin, truth.positions + truth.origin
    rotation, shift, scale = best_fit(a, b)
    wrong = np.linalg.norm(a @ rotation.T + shift - b, axis=1)
    path = float(np.linalg.norm(np.diff(b, axis=0), axis=1).sum())
    ate = float(np.sqrt((wrong**2).mean()))
    return SegmentErrors(
        len(a), path, {f"{x:g} m": drift(estimate.poses, truth.poses, x) for x in lengths}, ate,
        100 * ate / path if path > 0 else float("nan"), 1 / scale if scale > 0 else float("nan"), float(wrong.max()),
    )  # fmt: skip


def trajectory_errors(
    estimate: Trajectory, truth: Trajectory, lengths_m: Sequence[float] = SUB_PATHS_M
) -> TrajectoryErrors:
    """Compare a trajectory with the truth.

    Both are of the same frame: `Trajectory.turned` changes from the rectified to the camera's own.

    Raises
    ------
    TrajectoryError
        No stamp is common to both.
    """
    ours, theirs = _matched(estimate, truth)
    if not len(ours):
        raise TrajectoryError("trajectories: expected common stamps, got none: is a clock off?")
    same, true = estimate.picked(ours), truth.picked(theirs)
    segments = tuple(
        _segment(same.picked(same.segment == s), true.picked(same.segment == s), lengths_m)
        for s in np.unique(same.segment)
        if (same.segment == s).sum() >= 2
    )
    predicted = int((same.status == int(PoseStatus.PREDICTED)).sum())
    return TrajectoryErrors(segments, len(ours), predicted, len(truth) - len(ours))
