"""Bundle adjustment: poses and points that fit best what all frames measured, columns, rows and disparities.

A relation of two frames takes depths as they are measured, with errors that neighbouring key points have in common;
here the points are unknowns too, so that where they are is told by all views of them, and disparities are left to tell
the scale.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.align.point_tracks import Observations
from uw_recon_ros.jit import kernel
from uw_recon_ros.types import Matrix

_SHARED = 3.0  # sigmas of disparities are taken so much larger: neighbours, and views of one place, err together
_LEAST_SIGMA_PX = 0.05  # of a disparity: nobody is surer
_LEAST_PLACE_PX = 0.1  # of a key point
_GATE = 16.0  # chi2 of 2, and of 1
_INFLATED = 2.5  # measured: covariances are too small by so much, for key points of one place err together
_ROUNDS, _JUDGED = 14, (3, 5, 7)  # in these it is judged anew how well key points fit
_CONVERGED = 1e-6  # largest step, m and rad
_HELD, _LOOSE = 1e12, 1.0  # information: of the first pose; of all, so that none is without any
_MEDIAN = 1.4826  # standard deviation over the median of absolute values


@dataclass(frozen=True, eq=False)
class Adjusted:
    """What a bundle adjustment finds.

    Parameters
    ----------
    poses : (N, 4, 4) float64
        The first stays where it was.
    covariance : (6N, 6N) float64
        Of the twists on the right of all poses.
    sigma_px : float
        How far key points are from where they should be, standard deviation as most of them tell it.
    """

    poses: Matrix
    covariance: Matrix
    sigma_px: float


class _Work:
    """What the rounds write into."""

    def __init__(self, poses: int, seen: Observations) -> None:
        count, points = len(seen.frame), len(seen.starts) - 1
        self.system, self.gradient = np.zeros((6 * poses, 6 * poses)), np.zeros(6 * poses)
        self.cross, self.inverse, self.pull = np.zeros((count, 6, 3)), np.zeros((points, 3, 3)), np.zeros((points, 3))
        self.missed = np.zeros((count, 3))


def adjust(poses: Matrix, lenses: Matrix, seen: Observations, sigma_px: float) -> Adjusted | None:
    """Fit poses and points to what was seen.

    Parameters
    ----------
    poses : (N, 4, 4) float64
        World <- left rectified view; where to begin.
    lenses : (N, 6) float64
        `uw_recon_ros.track.keypoints.constants` of each frame.
    seen : Observations
    sigma_px : float
        Of a key point's place, to begin with.

    Returns
    -------
    Adjusted or None
        None where it does not settle.

    Notes
    -----
    Gauss-Newton; the points are eliminated (Schur complement), as in Triggs et al., Bundle adjustment (2000). Cauchy's
    weights, for places and disparities apart: what moves with the light or at an edge is far off, not a little. How
    well key points are placed is found from the residuals' median, so that sharp pictures count for what they are
    worth.
    """
    if len(seen.starts) < 2:
        return None
    points = _first_points(poses, lenses, seen)
    white = np.empty((len(seen.frame), 3))
    white[:, 2] = 1 / (_SHARED * np.maximum(seen.sigma, _LEAST_SIGMA_PX))
    alive, work, sigma = np.ones(len(seen.frame), np.bool_), _Work(len(poses), seen), sigma_px
    for done in range(_ROUNDS):
        white[:, :2] = 1 / sigma
        solved = _step(poses, lenses, points, seen, white, alive, work)
        if solved is None:
            return None
        factor, step = solved
        poses = poses @ rigid.exp(step.reshape(-1, 6))
        if done in _JUDGED:
            sigma = _spread(work.missed, seen, sigma_px)
            alive = ((work.missed[:, :2] / sigma) ** 2).sum(axis=1) < _GATE
            alive &= (work.missed[:, 2] * white[:, 2]) ** 2 < _GATE
        elif done > _JUDGED[-1] and np.abs(step).max() < _CONVERGED:
            break
    covariance: Matrix = scipy.linalg.cho_solve(factor, np.eye(6 * len(poses)))
    return Adjusted(poses, _INFLATED * covariance, sigma)


def _first_points(poses: Matrix, lenses: Matrix, seen: Observations) -> Matrix:
    """(P, 3) means of where each frame puts a point by its disparity, in the world."""
    fx, fy, cx, cy, fb, offset = lenses[seen.frame].T
    u, v, d = seen.measured.T
    z = fb / (d + offset)
    there = np.stack([(u - cx) / fx * z, (v - cy) / fy * z, z], axis=1)
    at = poses[seen.frame]
    world = (at[:, :3, :3] @ there[..., None])[..., 0] + at[:, :3, 3]
    sums = np.add.reduceat(world, seen.starts[:-1], axis=0)
    return np.asarray(sums / np.diff(seen.starts)[:, None])


def _spread(missed: Matrix, seen: Observations, most: float) -> float:
    """Standard deviation of places, px, by the median; corrected for what the points take up of it."""
    freedom = 1 - (len(seen.starts) - 1) / len(seen.frame)
    return float(np.clip(_MEDIAN * np.median(np.abs(missed[:, :2])) / np.sqrt(freedom), _LEAST_PLACE_PX, most))


def _step(
    poses: Matrix, lenses: Matrix, points: Matrix, seen: Observations, white: Matrix, alive: NDArray[np.bool_],
    work: _Work,
) -> tuple[tuple[Matrix, bool], Matrix] | None:  # fmt: skip
    """One round: moves `points`, returns the factored system and the twists; None where there is no solution."""
    work.system[:], work.gradient[:] = 0.0, 0.0
    _accumulate(np.ascontiguousarray(poses), lenses, points, seen.frame, seen.starts, seen.measured, white, alive,
                work.system, work.gradient, work.cross, work.inverse, work.pull, work.missed)  # fmt: skip
    diagonal = work.system.ravel()[:: len(work.system) + 1]
    diagonal += _LOOSE
    diagonal[:6] += _HELD
    try:
        factor = scipy.linalg.cho_factor(work.system, lower=True)
    except (np.linalg.LinAlgError, ValueError):
        return None
    step: Matrix = scipy.linalg.cho_solve(factor, work.gradient)
    _move_points(points, seen.frame, seen.starts, step, work.cross, work.inverse, work.pull)
    return factor, step


@kernel(allocates=False)
def _accumulate(
    poses: Matrix, lenses: Matrix, points: Matrix, frame: NDArray[np.int64], starts: NDArray[np.int64],
    measured: Matrix, white: Matrix, alive: NDArray[np.bool_], system: Matrix, gradient: Matrix, cross: Matrix,
    inverse: Matrix, pull: Matrix, missed: Matrix,
) -> None:  # fmt: skip
    """Normal equations of the poses (lower half and more), the points eliminated one by one.

    `cross` (M, 6, 3) and `inverse` (P, 3, 3), `pull` (P, 3) are kept to find the points' steps; `missed` (M, 3) px.
    """
    for p in range(len(starts) - 1):
        v00 = v11 = v22 = 1e-9
        v01 = v02 = v12 = g0 = g1 = g2 = 0.0
        for m in range(starts[p], starts[p + 1]):
            t, lens = poses[frame[m]], lenses[frame[m]]
            dx, dy, dz = points[p, 0] - t[0, 3], points[p, 1] - t[1, 3], points[p, 2] - t[2, 3]
            x = t[0, 0] * dx + t[1, 0] * dy + t[2, 0] * dz
            y = t[0, 1] * dx + t[1, 1] * dy + t[2, 1] * dz
            z = t[0, 2] * dx + t[1, 2] * dy + t[2, 2] * dz
            if not z > 1e-6:
                missed[m] = 1e6
                cross[m] = 0.0
                continue
            a = 1.0 / z
            missed[m, 0] = measured[m, 0] - (lens[0] * x * a + lens[2])
            missed[m, 1] = measured[m, 1] - (lens[1] * y * a + lens[3])
            missed[m, 2] = measured[m, 2] - (lens[4] * a - lens[5])
            if not alive[m]:
                cross[m] = 0.0
                continue
            at = 6 * frame[m]
            place = (missed[m, 0] * white[m, 0]) ** 2 + (missed[m, 1] * white[m, 1]) ** 2
            depth = (missed[m, 2] * white[m, 2]) ** 2
            for row in range(6):
                for c in range(3):
                    cross[m, row, c] = 0.0
            for k in range(3):
                weight = white[m, k] ** 2 / (1.0 + (depth if k == 2 else place))
                # derivative of u, v or disparity by the point in the camera
                if k == 0:
                    jx, jy, jz = lens[0] * a, 0.0, -lens[0] * x * a * a
                elif k == 1:
                    jx, jy, jz = 0.0, lens[1] * a, -lens[1] * y * a * a
                else:
                    jx, jy, jz = 0.0, 0.0, -lens[4] * a * a
                slopes = (-jx, -jy, -jz, jy * z - jz * y, jz * x - jx * z, jx * y - jy * x)
                b0 = jx * t[0, 0] + jy * t[0, 1] + jz * t[0, 2]
                b1 = jx * t[1, 0] + jy * t[1, 1] + jz * t[1, 2]
                b2 = jx * t[2, 0] + jy * t[2, 1] + jz * t[2, 2]
                off = weight * missed[m, k]
                g0, g1, g2 = g0 + b0 * off, g1 + b1 * off, g2 + b2 * off
                v00, v01, v02 = v00 + weight * b0 * b0, v01 + weight * b0 * b1, v02 + weight * b0 * b2
                v11, v12, v22 = v11 + weight * b1 * b1, v12 + weight * b1 * b2, v22 + weight * b2 * b2
                for row in range(6):
                    s = weight * slopes[row]
                    gradient[at + row] += slopes[row] * off
                    cross[m, row, 0] += s * b0
                    cross[m, row, 1] += s * b1
                    cross[m, row, 2] += s * b2
                    for c in range(6):
                        system[at + row, at + c] += s * slopes[c]
        c00, c01, c02 = v11 * v22 - v12 * v12, v02 * v12 - v01 * v22, v01 * v12 - v02 * v11
        share = 1.0 / (v00 * c00 + v01 * c01 + v02 * c02)
        n = inverse[p]
        n[0, 0], n[0, 1], n[0, 2] = c00 * share, c01 * share, c02 * share
        n[1, 1], n[1, 2] = (v00 * v22 - v02 * v02) * share, (v01 * v02 - v00 * v12) * share
        n[2, 2] = (v00 * v11 - v01 * v01) * share
        n[1, 0], n[2, 0], n[2, 1] = n[0, 1], n[0, 2], n[1, 2]
        pull[p, 0], pull[p, 1], pull[p, 2] = g0, g1, g2
        for m in range(starts[p], starts[p + 1]):
            at = 6 * frame[m]
            for row in range(6):
                w = cross[m, row]
                t0 = w[0] * n[0, 0] + w[1] * n[1, 0] + w[2] * n[2, 0]
                t1 = w[0] * n[0, 1] + w[1] * n[1, 1] + w[2] * n[2, 1]
                t2 = w[0] * n[0, 2] + w[1] * n[1, 2] + w[2] * n[2, 2]
                gradient[at + row] -= t0 * g0 + t1 * g1 + t2 * g2
                for other in range(starts[p], starts[p + 1]):
                    to = 6 * frame[other]
                    if to <= at:
                        for c in range(6):
                            e = cross[other, c]
                            system[at + row, to + c] -= t0 * e[0] + t1 * e[1] + t2 * e[2]


@kernel(allocates=False)
def _move_points(
    points: Matrix, frame: NDArray[np.int64], starts: NDArray[np.int64], step: Matrix, cross: Matrix, inverse: Matrix,
    pull: Matrix,
) -> None:  # fmt: skip
    """Add to each point what follows from the steps of the poses."""
    for p in range(len(points)):
        g0, g1, g2 = pull[p, 0], pull[p, 1], pull[p, 2]
        for m in range(starts[p], starts[p + 1]):
            at = 6 * frame[m]
            for row in range(6):
                g0 -= cross[m, row, 0] * step[at + row]
                g1 -= cross[m, row, 1] * step[at + row]
                g2 -= cross[m, row, 2] * step[at + row]
        for c in range(3):
            points[p, c] += inverse[p, c, 0] * g0 + inverse[p, c, 1] * g1 + inverse[p, c, 2] * g2
