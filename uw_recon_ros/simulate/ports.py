"""Flat and dome ports, traced by Snell's law in vector form; knows nothing of how rectification does it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from scipy.optimize import least_squares

from uw_recon_ros.simulate.boards import Look
from uw_recon_ros.simulate.rig import Rig, undistort, unit_directions
from uw_recon_ros.types import CameraModel, Matrix

FRESH, SEA = 1.333, 1.342
ACRYLIC, GLASS = 1.49, 1.52


class Port(Protocol):
    """What stands before a camera."""

    def into_water(self, directions: Matrix) -> tuple[Matrix, Matrix]:
        """Where rays (N, 3) from the camera's centre leave the port, m, and where they go in the water."""


def refracted(directions: Matrix, normals: Matrix, before: float, after: float) -> Matrix:
    """Snell's law: unit directions behind a surface whose unit normals point along the rays; NaN: total reflection."""
    ratio = before / after
    cosine = np.sum(directions * normals, axis=1, keepdims=True)
    with np.errstate(invalid="ignore"):
        root = np.sqrt(1 - ratio**2 * (1 - cosine**2))
    bent: Matrix = ratio * directions + (root - ratio * cosine) * normals
    return bent


@dataclass(frozen=True, eq=False)
class FlatPane:
    """A flat port.

    Parameters
    ----------
    distance_m, thickness_m : float
        From the centre of projection to the inner face along the normal; of the pane.
    glass, water : float
        Refractive indices.
    normal : (3,) float64
        Unit, outwards, in the camera's frame.
    """

    distance_m: float
    thickness_m: float
    glass: float = ACRYLIC
    water: float = FRESH
    normal: Matrix = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    def into_water(self, directions: Matrix) -> tuple[Matrix, Matrix]:
        """See `Port`."""
        normals = np.broadcast_to(self.normal, directions.shape)
        inside = refracted(directions, normals, 1.0, self.glass)
        outside = refracted(inside, normals, self.glass, self.water)
        first = self.distance_m * directions / (directions @ self.normal)[:, None]
        return first + self.thickness_m * inside / (inside @ self.normal)[:, None], outside


@dataclass(frozen=True, eq=False)
class Dome:
    """A spherical port.

    Parameters
    ----------
    radius_m, thickness_m : float
        Of the inner face; of the shell.
    centre_m : (3,) float64
        Of the sphere, in the camera's frame: 0 where the camera is well placed.
    glass, water : float
    """

    radius_m: float
    thickness_m: float
    centre_m: Matrix = field(default_factory=lambda: np.zeros(3))
    glass: float = ACRYLIC
    water: float = FRESH

    def into_water(self, directions: Matrix) -> tuple[Matrix, Matrix]:
        """See `Port`."""
        inner = self._met(np.zeros(3), directions, self.radius_m)
        inside = refracted(directions, (inner - self.centre_m) / self.radius_m, 1.0, self.glass)
        outer_radius = self.radius_m + self.thickness_m
        outer = self._met(inner, inside, outer_radius)
        return outer, refracted(inside, (outer - self.centre_m) / outer_radius, self.glass, self.water)

    def _met(self, origins: Matrix, directions: Matrix, radius: float) -> Matrix:
        """Where rays from within leave a sphere."""
        start = np.broadcast_to(origins - self.centre_m, directions.shape)
        along = np.sum(start * directions, axis=1, keepdims=True)
        reach = -along + np.sqrt(along**2 - np.sum(start**2, axis=1, keepdims=True) + radius**2)
        met: Matrix = origins + reach * directions
        return met


def look_through(camera: CameraModel, port: Port) -> Look:
    """What `simulate.boards.photograph` needs of a camera behind a port; the camera's numbers are those in air."""

    def look(pixels: Matrix) -> tuple[Matrix, Matrix]:
        ideal = (pixels - camera.k[:2, 2]) / np.diag(camera.k)[:2]
        return port.into_water(unit_directions(undistort(ideal, camera.d)))

    return look


def pixel_of(point: Matrix, camera: CameraModel, port: Port, start: Matrix) -> Matrix:
    """The pixel (2,) that looks at a point (3,) m in the camera's frame, searched from a start (2,) px."""
    look = look_through(camera, port)

    def miss(pixel: Matrix) -> Matrix:
        origins, directions = look(pixel[None])
        aside = point - origins[0]
        gap: Matrix = (aside / aside[2] - directions[0] / directions[0, 2])[:2] * camera.k[0, 0]
        return gap

    return np.asarray(least_squares(miss, start, xtol=1e-14, ftol=1e-14, gtol=1e-14).x, np.float64)


def pixels_of(rig: Rig, points: Matrix, ports: tuple[Port, Port]) -> tuple[Matrix, Matrix]:
    """Pixels (N, 2) of points (N, 3) m in the left camera's frame, in the left and in the right camera."""
    right = (points - rig.right_center) @ rig.right_from_left.T
    found = []
    for places, camera, port in zip((points, right), (rig.calibration.left, rig.calibration.right), ports, strict=True):
        starts = (places / places[:, 2:]) @ camera.k.T
        found.append(np.array([pixel_of(p, camera, port, s[:2]) for p, s in zip(places, starts, strict=True)]))
    return found[0], found[1]
