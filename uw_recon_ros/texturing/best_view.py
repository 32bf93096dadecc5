"""The colour of each place from the picture that shows it best, and from the next one where the two are about as good.

A view is better the finer and the less oblique it sees the place, the farther from its own rim it does, and the sharper
the picture is. Views that see something else there, nearer or farther, do not count: what hides the place, or what has
moved on. Colours fade from one picture into the next where their scores are close, so that seams are no edges.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.frame import View
from uw_recon_ros.jit import kernel
from uw_recon_ros.texturing.gains import Balance
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_UNCONFIRMED = 0.3  # of the score, where the picture has no depth to confirm the place
_RIM_PX = 24.0
_FADE = 0.2  # of the score, over which the second best counts
_OBLIQUE = 0.1  # cosine below which nothing is seen
_SIGMAS = 4.0


@dataclass(frozen=True, eq=False)
class BestViews:
    """Places on the surface, and what the best pictures so far show of them.

    Parameters
    ----------
    points : (N, 3) float64
        World, m.
    normals : (N, 3) float32
        Outward, unit length.
    tolerance : float
        Between the place's depth and the picture's own, m, beside some sigmas.
    """

    points: Matrix
    normals: FloatImage
    tolerance: float

    def __post_init__(self) -> None:
        n = len(self.points)
        for name, value in (
            ("scores", np.zeros((n, 2), np.float32)), ("levels", np.zeros((n, 2, 3), np.float32)),
            ("frames", np.full(n, -1, np.int32)),
        ):  # fmt: skip
            object.__setattr__(self, name, value)

    def add(self, number: int, view: View, left: ByteImage, balance: Balance, sharpness: float = 1.0) -> None:
        """Let picture `number` (H, W, 3) be a candidate; `sharpness` is relative to its neighbours'."""
        if len(self.points):
            _consider(
                self.points, self.normals, view.lens, view.motion, view.depth, view.sigma, left,
                balance.gains[number], balance.field, self.tolerance, float(sharpness), number,
                self.scores, self.levels, self.frames,  # type: ignore[attr-defined]
            )  # fmt: skip

    @property
    def seen(self) -> NDArray[np.bool_]:
        """(N,) whether any picture shows the place."""
        frames: NDArray[np.int32] = self.frames  # type: ignore[attr-defined]
        return frames >= 0

    def colors(self) -> ByteImage:
        """(N, 3) RGB; black where no picture shows the place."""
        scores: FloatImage = self.scores  # type: ignore[attr-defined]
        levels: FloatImage = self.levels  # type: ignore[attr-defined]
        with np.errstate(divide="ignore", invalid="ignore"):
            close = np.where(scores[:, 0] > 0, scores[:, 1] / scores[:, 0], 0.0)
        share = (0.5 * (close - 1 + _FADE) / _FADE).clip(0.0, 0.5)[:, None]
        mixed = (1 - share) * levels[:, 0] + share * levels[:, 1]
        colors: ByteImage = np.rint(mixed.clip(0, 255)).astype(np.uint8)
        return colors


@kernel(allocates=False)
def _fineness(z: float, u: float, v: float, rows: int, columns: int, sharpness: float) -> float:
    """Of a view of a place that faces it."""
    rim = min(min(u, v), min(columns - 1 - u, rows - 1 - v))
    x, y = (2 * u - columns) / columns, (2 * v - rows) / columns
    inward = min((rim + 0.5) / _RIM_PX, 1.0) / (1.0 + x * x + y * y)
    found: float = sharpness / z * inward
    return found


@kernel(allocates=False)
def _sample(left: ByteImage, u: float, v: float, channel: int) -> float:
    i, j = min(int(u), left.shape[1] - 2), min(int(v), left.shape[0] - 2)
    x, y = u - i, v - j
    upper: float = (1 - x) * left[j, i, channel] + x * left[j, i + 1, channel]
    lower: float = (1 - x) * left[j + 1, i, channel] + x * left[j + 1, i + 1, channel]
    mixed: float = (1 - y) * upper + y * lower
    return mixed


@kernel(allocates=False)
def _consider(
    points: Matrix, normals: FloatImage, lens: Matrix, motion: Matrix, depth: FloatImage, sigma: FloatImage,
    left: ByteImage, gain: Matrix, field: Matrix, tolerance: float, sharpness: float, number: int,
    scores: FloatImage, levels: FloatImage, frames: NDArray[np.int32],
) -> None:  # fmt: skip
    rows, columns = depth.shape
    m = motion
    for n in range(len(points)):
        px, py, pz = points[n, 0], points[n, 1], points[n, 2]
        z = m[2, 0] * px + m[2, 1] * py + m[2, 2] * pz + m[2, 3]
        if not z > 0.0:
            continue
        x = m[0, 0] * px + m[0, 1] * py + m[0, 2] * pz + m[0, 3]
        u = lens[0] * x / z + lens[2]
        if not (u >= 0.0 and u <= columns - 1):
            continue
        y = m[1, 0] * px + m[1, 1] * py + m[1, 2] * pz + m[1, 3]
        v = lens[1] * y / z + lens[3]
        if not (v >= 0.0 and v <= rows - 1):
            continue
        fineness = _fineness(z, u, v, rows, columns, sharpness)
        if not fineness > scores[n, 1]:
            continue
        measured, spread = float(depth[int(v + 0.5), int(u + 0.5)]), float(sigma[int(v + 0.5), int(u + 0.5)])
        known = measured > 0.0
        if known and abs(measured - z) > tolerance + _SIGMAS * spread:
            continue
        nx, ny, nz = float(normals[n, 0]), float(normals[n, 1]), float(normals[n, 2])
        towards = -(
            x * (m[0, 0] * nx + m[0, 1] * ny + m[0, 2] * nz)
            + y * (m[1, 0] * nx + m[1, 1] * ny + m[1, 2] * nz)
            + z * (m[2, 0] * nx + m[2, 1] * ny + m[2, 2] * nz)
        )
        cosine = towards / math.sqrt(x * x + y * y + z * z)
        if not cosine > _OBLIQUE:
            continue
        score = fineness * cosine * (1.0 if known else _UNCONFIRMED)
        if not score > scores[n, 1]:
            continue
        slot = 1
        if score > scores[n, 0]:
            scores[n, 1], slot = scores[n, 0], 0
            for c in range(3):
                levels[n, 1, c] = levels[n, 0, c]
            frames[n] = number
        scores[n, slot] = score
        a, b = (2 * u - columns + 1) / columns, (2 * v - rows + 1) / columns
        for c in range(3):
            shade = (
                gain[c] + field[0, c] * a + field[1, c] * b + field[2, c] * a * a + field[3, c] * a * b
                + field[4, c] * b * b + field[5, c] * (a * a + b * b) * (a * a + b * b)
            )  # fmt: skip
            levels[n, slot, c] = _sample(left, u, v, c) * math.exp(-shade)


def sharpness_of(left: ByteImage) -> float:
    """How sharp a picture (H, W, 3) is: edges between neighbouring pixels relative to those a few pixels wide."""
    gray = cv2.cvtColor(left, cv2.COLOR_RGB2GRAY).astype(np.float32)
    fine = cv2.Laplacian(cv2.GaussianBlur(gray, (0, 0), 0.8), cv2.CV_32F)
    coarse = cv2.Laplacian(cv2.GaussianBlur(gray, (0, 0), 3.0), cv2.CV_32F)
    return float(np.std(fine) / max(float(np.std(coarse)), 1e-6))
