"""Which disparities are searched at each pixel: all, or a band about what smaller images said."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.types import FloatImage

WIDTH = 32  #: labels of a band: as many as are worked on at once
NEAR = 9  #: side of the window whose disparities shall all be searched, px ...
SPARE = 2  #: ... and as many labels beyond them, where the band is wide enough for that

Labels = NDArray[np.int16]


class Band(NamedTuple):
    """Labels, counted from the least disparity.

    Parameters
    ----------
    labels : int
        Searched at each pixel.
    first : (H, W) int16
        The first of them.
    lowest, end : (H, W) int16
        The first label of a pixel and its eight neighbours, and one past the last.
    """

    labels: int
    first: Labels
    lowest: Labels
    end: Labels

    @classmethod
    def whole(cls, shape: tuple[int, int], labels: int) -> Band:
        """All labels everywhere."""
        none = np.zeros(shape, np.int16)
        return cls(labels, none, none, np.full(shape, labels, np.int16))

    @classmethod
    def around(cls, guide: FloatImage, labels: int) -> Band:
        """About expected labels, (H, W) float32, of `labels` that there are, more than `WIDTH`.

        Where those nearby lie too far apart for one band, a pixel's own is the middle of its band.
        """
        window = np.ones((NEAR, NEAR), np.uint8)
        least, most = cv2.erode(guide, window), cv2.dilate(guide, window)
        middle = np.where(most - least <= WIDTH - 2 * SPARE, (least + most) / 2, guide)
        first = np.asarray(np.rint(middle - np.float32((WIDTH - 1) / 2)).clip(0, labels - WIDTH), np.int16)
        beside = np.ones((3, 3), np.uint8)
        end = np.asarray(cv2.dilate(first, beside) + np.int16(WIDTH), np.int16)
        return cls(WIDTH, first, np.asarray(cv2.erode(first, beside), np.int16), end)
