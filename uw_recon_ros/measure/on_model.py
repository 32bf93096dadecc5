"""Lengths and distances on the model of a dive, each with its standard deviation.

A point of the surface errs by its own depths, by where the camera was when it saw the place, by the scale, and by the
click. Places that were seen from the same poses err alike: what counts between two of them is how the errors of all
poses hang together, which the pose graph knows. ``report/measure_model.js`` does the same in pages; a test holds the
two together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import Matrix

_BESIDE = 3.0  # spacings of the spots, beyond which a point is not of this surface


@dataclass(frozen=True, eq=False)
class Spots:
    """What is known about a model's surface and its cameras, at places spread over it.

    Parameters
    ----------
    places : (S, 3) float64
        World less the origin, in the model's unit.
    sigmas : (S,) float64
        Of the surface there, along the view.
    cameras : (S, 3) float64
        Where the camera was that saw it best.
    anchors : (S,) float64
        Its number among the poses whose errors are known together; 1.25: a quarter of the way from the second to the
        third.
    centres : (K, 3) float64
        Positions of those poses.
    covariance : (6K, 6K) float64
        Of their positions and rotations about the world's axes, pose by pose.
    calibration : sequence of (range, fraction)
        Relative standard deviation of lengths by the calibration at a distance from the camera; empty: not known.
    spacing : float
        Between neighbouring places.
    """

    places: Matrix
    sigmas: Matrix
    cameras: Matrix
    anchors: Matrix
    centres: Matrix
    covariance: Matrix
    calibration: Sequence[tuple[float, float]]
    spacing: float


@dataclass(frozen=True)
class ModelMeasurement:
    """A result.

    Parameters
    ----------
    quantity : str
        ``length``, ``polyline`` or ``to_plane``.
    value, sigma : float
    sigma_surface, sigma_trajectory, sigma_calibration, sigma_click : float
        Its parts; NaN: not known, and not in `sigma`.
    distance : float
        Mean, between points and the camera that saw them.
    points : tuple of (x, y, z)
        World less the origin.
    clicks : tuple of float
        Standard deviation of each coordinate of a point by the click.
    """

    quantity: str
    value: float
    sigma: float
    sigma_surface: float
    sigma_trajectory: float
    sigma_calibration: float
    sigma_click: float
    distance: float
    points: tuple[tuple[float, ...], ...]
    clicks: tuple[float, ...]


def measure_way(spots: Spots, points: Matrix, clicks: Matrix) -> ModelMeasurement:
    """Length along points; two make a length.

    Parameters
    ----------
    spots : Spots
    points : (N, 3) float64
        World less the origin.
    clicks : (N,) float64
        Standard deviation of each coordinate.

    Raises
    ------
    EstimationError
        A point is not on the surface.
    ValueError
        There are fewer than two.
    """
    if len(points) < 2:
        raise ValueError(f"points: expected at least two, got {len(points)}")

    def length(at: Matrix) -> float:
        return float(np.linalg.norm(np.diff(at, axis=0), axis=1).sum())

    return _propagated("length" if len(points) == 2 else "polyline", length, spots, points, clicks)


def measure_off_plane(spots: Spots, point: Matrix, corners: Matrix, clicks: Matrix) -> ModelMeasurement:
    """Distance of a point from the plane that fits corners best, positive above it.

    Parameters
    ----------
    spots : Spots
    point : (3,) float64
        World less the origin.
    corners : (N, 3) float64
        At least three.
    clicks : (1 + N,) float64
        Of the point, then the corners.

    Raises
    ------
    EstimationError
        A point is not on the surface, or the corners lie in one line.
    ValueError
        There are fewer than three corners.
    """
    if len(corners) < 3:
        raise ValueError(f"plane: expected at least three corners, got {len(corners)}")
    spread = np.linalg.svd(corners - corners.mean(axis=0), compute_uv=False)
    if spread[1] < 0.02 * spread[0]:
        raise EstimationError("plane: expected corners that span one, got corners in one line", Code.MEASURE_NO_DEPTH)

    def distance(at: Matrix) -> float:
        middle = at[1:].mean(axis=0)
        aside = at[1:] - middle
        up = np.linalg.eigh(aside.T @ aside)[1][:, 0]
        return float((at[0] - middle) @ up * (1.0 if up[2] >= 0 else -1.0))

    return _propagated("to_plane", distance, spots, np.vstack([point, corners]), clicks)


def _propagated(
    quantity: str, value: Callable[[Matrix], float], spots: Spots, points: Matrix, clicks: Matrix
) -> ModelMeasurement:
    """First-order propagation; slopes by differences."""
    nearest = [_nearest_on(spots, point) for point in points]
    slopes, step = np.zeros_like(points), 1e-4 * spots.spacing
    for k in np.ndindex(*points.shape):
        moved = np.zeros_like(points)
        moved[k] = step
        slopes[k] = (value(points + moved) - value(points - moved)) / (2 * step)
    views = points - spots.cameras[nearest]
    distances = np.linalg.norm(views, axis=1)
    along = (slopes * views / np.maximum(distances, 1e-12)[:, None]).sum(axis=1)
    pull = sum((_pull(spots, *each) for each in zip(points, slopes, spots.anchors[nearest], strict=True)), np.zeros(1))
    found, distance = value(points), float(distances.mean())
    parts = (
        float(np.sqrt((along**2 * spots.sigmas[nearest] ** 2).sum())),
        float(np.sqrt(max(float(pull @ spots.covariance @ pull), 0.0))) if len(spots.centres) else float("nan"),
        abs(found) * _by_calibration(spots, distance),
        float(np.sqrt((slopes**2 * clicks[:, None] ** 2).sum())),
    )
    return ModelMeasurement(
        quantity, found, float(np.sqrt(np.nansum(np.square(parts)))), *parts, distance,
        tuple(tuple(map(float, point)) for point in points), tuple(map(float, clicks)),
    )  # fmt: skip


def on_surface(spots: Spots, point: Matrix) -> bool:
    """Whether a point, (3,) world less the origin, is near enough to the surface to be measured from."""
    return _nearest(spots, point)[1]


def _nearest(spots: Spots, point: Matrix) -> tuple[int, bool]:
    """Number of the nearest spot, and whether the point is near enough to be of this surface."""
    squares = ((spots.places - point) ** 2).sum(axis=1)
    best = int(squares.argmin())
    return best, bool(squares[best] <= (_BESIDE * spots.spacing) ** 2)


def _nearest_on(spots: Spots, point: Matrix) -> int:
    best, near = _nearest(spots, point)
    if not near:
        told = ", ".join(f"{x:g}" for x in point)
        raise EstimationError(f"({told}): expected a point on the model's surface, got none", Code.MEASURE_NO_DEPTH)
    return best


def _pull(spots: Spots, point: Matrix, slope: Matrix, anchor: float) -> Matrix:
    """(6K,) how a value changes as the poses err that a point hangs on: p moves by ``t + w x (p - c)``."""
    found = np.zeros((len(spots.centres), 6))
    if not len(found):
        return np.zeros(1)
    first = int(min(anchor, len(found) - 1))
    for k, share in ((first, 1 - (anchor - first)), (first + 1, anchor - first)):
        if share > 0:
            found[k] = share * np.r_[slope, np.cross(point - spots.centres[k], slope)]
    return found.ravel()


def _by_calibration(spots: Spots, distance: float) -> float:
    if not len(spots.calibration):
        return float("nan")
    ranges, fractions = zip(*spots.calibration, strict=True)
    return float(np.interp(np.log(max(distance, 1e-6)), np.log(ranges), fractions))
