"""Boards that a rig is calibrated with: their points, by number."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.board_kinds import APRILGRID, ASYMMETRIC, CHARUCO, KINDS
from uw_recon_ros.types import Matrix

_MARKER_SHARE = {CHARUCO: 0.75, APRILGRID: 1 / 1.3}  # of a square: usual prints


@dataclass(frozen=True)
class Board:
    """A flat board with points known to a fraction of a millimetre.

    Parameters
    ----------
    kind : {'checkerboard', 'charuco', 'aprilgrid', 'circles', 'asymmetric-circles'}
    columns, rows : int
        Inner corners of a checkerboard, squares of ChArUco, tags of an AprilGrid, circles.
    square_m : float
        Side of a square; from tag to tag; from circle to circle (asymmetric: from row to row), m.
    marker_m : float
        Side of a marker, m; 0: three quarters of a square, of an AprilGrid 1/1.3.
    dictionary : str
        OpenCV's name of the markers' dictionary, e.g. ``DICT_5X5_100``.

    Raises
    ------
    ValueError
    """

    kind: str
    columns: int
    rows: int
    square_m: float = 1.0
    marker_m: float = 0.0
    dictionary: str = ""

    def __post_init__(self) -> None:
        """Refuse boards that no one can print."""
        if self.kind not in KINDS:
            raise ValueError(f"board: expected one of {', '.join(KINDS)}, got {self.kind}")
        if not (2 <= self.columns <= 100 and 2 <= self.rows <= 100):
            raise ValueError(f"board: expected 2 to 100 columns and rows, got {self.columns}x{self.rows}")
        if not (0 < self.square_m < 100 and 0 <= self.marker_m < self.square_m):
            raise ValueError(
                f"board: expected a square > 0 and a marker smaller than it, got {self.square_m:g} and "
                f"{self.marker_m:g} m"
            )

    @property
    def marker_side_m(self) -> float:
        """Side of a marker, m."""
        return self.marker_m or self.square_m * _MARKER_SHARE.get(self.kind, 0.0)

    @property
    def grid(self) -> tuple[int, int]:
        """Columns and rows of the points of a checkerboard, ChArUco (inner corners) or circle grid."""
        less = 1 if self.kind == CHARUCO else 0
        return self.columns - less, self.rows - less

    def points(self) -> Matrix:
        """(N, 3) float64 points in the board's frame, m, z = 0; row after row, of an AprilGrid four corners a tag."""
        columns, rows = self.grid
        x, y = np.meshgrid(np.arange(columns, dtype=np.float64), np.arange(rows, dtype=np.float64))
        if self.kind == ASYMMETRIC:
            x = 2 * x + np.arange(rows)[:, None] % 2
        flat = self.square_m * np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
        if self.kind != APRILGRID:
            return flat
        corners = self.marker_side_m * np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
        return (flat[:, None, :] + corners).reshape(-1, 3)

    def __str__(self) -> str:
        """As people say it."""
        return f"{self.kind} {self.columns}x{self.rows}, {1000 * self.square_m:g} mm"
