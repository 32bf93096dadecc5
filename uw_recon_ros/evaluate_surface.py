"""How far a surface is from the true one, and how much of the true one is there."""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import Matrix

_SAMPLES = 200_000
_NEAR = 6  # samples whose triangles are tried
_CHUNK = 50_000


@dataclass(frozen=True)
class SurfaceErrors:
    """Result of `surface_errors`.

    Parameters
    ----------
    median_m, p95_m, mean_m : float
        Of the distance from points of the estimate to the true surface.
    bias_m : float
        Median of the distance with its sign: positive on the outer side of the truth.
    completeness : float
        Share of the true surface, 0 to 1, that has some of the estimate within `within_m`.
    within_m : float
    samples, truth_samples : int
        Points that were measured at.
    """

    median_m: float
    p95_m: float
    mean_m: float
    bias_m: float
    completeness: float
    within_m: float
    samples: int
    truth_samples: int

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return asdict(self)


@dataclass(frozen=True, eq=False)
class TriangleSearch:
    """Nearest points on a surface: those of the triangles that the nearest of dense samples lie on.

    Parameters
    ----------
    corners : (M, 3, 3) float64
        Of the triangles, m.
    samples : int
        Points drawn on them, evenly by area.
    """

    corners: Matrix
    samples: int = 4 * _SAMPLES

    def __post_init__(self) -> None:
        points, owners = sample_triangles(self.corners, self.samples)
        centres = self.corners.mean(axis=1)
        object.__setattr__(self, "_tree", cKDTree(np.concatenate([points, centres])))
        object.__setattr__(self, "_owners", np.r_[owners, np.arange(len(centres))])

    def nearest(self, points: Matrix) -> tuple[Matrix, NDArray[np.intp]]:
        """(N, 3) nearest places to points (N, 3), and (N,) the triangles they are on."""
        parts = [self._nearest(points[k : k + _CHUNK]) for k in range(0, len(points), _CHUNK)]
        return np.concatenate([p[0] for p in parts]), np.concatenate([p[1] for p in parts])

    def distances(self, points: Matrix) -> tuple[Matrix, Matrix]:
        """Distance of points (N, 3) and the same with the sign of the side, m."""
        places, triangles = self.nearest(points)
        apart = points - places
        a, b, c = np.moveaxis(self.corners[triangles], 1, 0)
        length: Matrix = np.linalg.norm(apart, axis=1)
        return length, length * np.sign(np.einsum("ij,ij->i", apart, np.cross(b - a, c - a)))

    def _nearest(self, points: Matrix) -> tuple[Matrix, NDArray[np.intp]]:
        tree: cKDTree = self._tree  # type: ignore[attr-defined]
        owners: NDArray[np.intp] = self._owners  # type: ignore[attr-defined]
        triangles = owners[tree.query(points, k=min(_NEAR, len(owners)))[1].reshape(len(points), -1)]
        count = triangles.shape[1]
        places = nearest_on_triangles(np.repeat(points, count, axis=0), self.corners[triangles.ravel()])
        places = places.reshape(len(points), count, 3)
        row, best = np.arange(len(points)), np.linalg.norm(places - points[:, None], axis=2).argmin(axis=1)
        return places[row, best], triangles[row, best]


def sample_triangles(corners: Matrix, count: int, seed: int = 0) -> tuple[Matrix, NDArray[np.intp]]:
    """Points (`count`, 3) drawn evenly by area on triangles (M, 3, 3), and the triangle of each."""
    rng = np.random.default_rng(seed)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    total = np.cumsum(area)
    drawn = (np.arange(count) + rng.uniform(size=count)) / count * total[-1]
    owners = np.searchsorted(total, drawn, side="right").clip(0, len(corners) - 1)
    first, second = np.sqrt(rng.uniform(size=count)), rng.uniform(size=count)
    shares = np.stack([1 - first, first * (1 - second), first * second], axis=1)
    return np.einsum("ij,ijk->ik", shares, corners[owners]), owners.astype(np.intp)


def nearest_on_triangles(points: Matrix, corners: Matrix) -> Matrix:
    """(N, 3) nearest point of triangle n (N, 3, 3) to point n (N, 3) (Ericson, Real-Time Collision Detection, 5.1.5).

    The nearest of the foot on the plane, where it is inside, and of the three sides.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    normal = np.cross(b - a, c - a)
    square = np.einsum("ij,ij->i", normal, normal)
    safe = np.where(square > 0, square, 1.0)
    foot = points - (np.einsum("ij,ij->i", points - a, normal) / safe)[:, None] * normal
    inside = square > 0
    for start, end in ((a, b), (b, c), (c, a)):
        inside &= np.einsum("ij,ij->i", np.cross(end - start, foot - start), normal) >= 0
    sides = np.stack([_nearest_on_side(points, *side) for side in ((a, b), (b, c), (c, a))])
    best = np.linalg.norm(sides - points, axis=2).argmin(axis=0)
    found: Matrix = np.where(inside[:, None], foot, sides[best, np.arange(len(points))])
    return found


def _nearest_on_side(points: Matrix, start: Matrix, end: Matrix) -> Matrix:
    along = end - start
    square = np.einsum("ij,ij->i", along, along)
    share = np.einsum("ij,ij->i", points - start, along) / np.where(square > 0, square, 1.0)
    return np.asarray(start + share.clip(0.0, 1.0)[:, None] * along, np.float64)


def surface_errors(
    vertices: Matrix, faces: NDArray[np.integer], truth_vertices: Matrix, truth_faces: NDArray[np.integer], *,
    within_m: float = 0.01, truth_points: Matrix | None = None, samples: int = _SAMPLES,
) -> SurfaceErrors:  # fmt: skip
    """Compare a mesh with the true one; both in one frame, which is the caller's to see to.

    Parameters
    ----------
    vertices, faces : (N, 3) float64 and (M, 3) int
        The estimate, m.
    truth_vertices, truth_faces : likewise
    within_m : float
        Distance up to which the truth counts as found.
    truth_points : (K, 3) float64, optional
        Where the true surface was in view, for the completeness; None: drawn evenly on all of it.
    samples : int
        Points drawn on either.

    Raises
    ------
    ModelError
        Either has no triangle.
    """
    for name, triangles in (("estimate", faces), ("truth", truth_faces)):
        if not len(triangles):
            raise ModelError(f"{name}: expected a surface of at least one triangle, got none", Code.MODEL_NOTHING)
    ours, theirs = np.asarray(vertices, np.float64)[faces], np.asarray(truth_vertices, np.float64)[truth_faces]
    apart, signed = TriangleSearch(theirs, 4 * samples).distances(sample_triangles(ours, samples)[0])
    sought = sample_triangles(theirs, samples)[0] if truth_points is None else truth_points
    found = TriangleSearch(ours, 4 * samples).distances(sought)[0] <= within_m
    return SurfaceErrors(
        float(np.median(apart)), float(np.quantile(apart, 0.95)), float(apart.mean()), float(np.median(signed)),
        float(found.mean()), within_m, len(apart), len(sought),
    )  # fmt: skip
