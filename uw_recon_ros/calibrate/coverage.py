"""How much of an image lies near points of the board, and how much of its corners, where a lens is least known."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.types import Mask

REACH = 0.05  #: of the image's diagonal: what is so near to a point is covered by it
_COLUMNS = 96  # of the grid that stands for an image
_CORNER = 0.2  # of its width and height
CORNERS = ("upper left", "upper right", "lower left", "lower right")


def near_points(sightings: Sequence[Sighting], size: tuple[int, int]) -> Mask:
    """Which places of an image lie within `REACH` of a point of the board.

    Parameters
    ----------
    sightings : sequence of Sighting
        In one camera's images.
    size : (width, height)
        px.

    Returns
    -------
    (rows, columns) bool
        A grid of square cells over the image, 96 of them across.
    """
    cell = size[0] / _COLUMNS
    rows = max(round(size[1] / cell), 1)
    empty = np.ones((rows, _COLUMNS), np.uint8)
    for sighting in sightings:
        u, v = (np.floor((sighting.pixels + 0.5) / cell).astype(int)).T
        empty[v.clip(0, rows - 1), u.clip(0, _COLUMNS - 1)] = 0
    if empty.all():
        return np.zeros((rows, _COLUMNS), np.bool_)
    away = cv2.distanceTransform(empty, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away <= REACH * float(np.hypot(*size)) / cell, np.bool_)


def covered(near: Mask) -> float:
    """Share of an image that is near a point, 0 to 1."""
    return float(near.mean())


def corners_covered(near: Mask) -> dict[str, float]:
    """The same of each corner, a fifth of the image wide and high, by its name."""
    down, across = (max(round(_CORNER * side), 1) for side in near.shape)
    parts = (near[:down, :across], near[:down, -across:], near[-down:, :across], near[-down:, -across:])
    return {name: covered(part) for name, part in zip(CORNERS, parts, strict=True)}


def emptiest(near: Mask) -> str:
    """The corner of which least is covered; of several the one in the emptiest quarter."""
    down, across = (side // 2 for side in near.shape)
    quarters = (near[:down, :across], near[:down, across:], near[down:, :across], near[down:, across:])
    told = zip(corners_covered(near).items(), quarters, strict=True)
    return min(((share, covered(quarter), name) for (name, share), quarter in told))[2]
