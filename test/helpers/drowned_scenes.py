"""Pairs under water whose disparities are known."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np
import pytest
from drowned_pairs import STEREO, THIRDS, WATERS, drown, pairs
from numpy.typing import NDArray
from simulated_frames import rectified_frames

from uw_recon_ros.images import to_gray

Image = NDArray[np.uint8]


def middlebury_under_water(water: str) -> Iterator[tuple[str, Image, Image, NDArray[np.float32]]]:
    """Name, mono images, true disparity of the left one (NaN = unknown)."""
    for folder in (STEREO, THIRDS):
        if not folder.is_dir():
            pytest.skip(f"{folder} is not here")
    for truth in (*pairs(), *pairs(THIRDS)):
        left, right = (to_gray(view) for view in drown(truth, WATERS[water]))
        yield truth.name, left, right, np.where(truth.mask, truth.disparity, np.float32(np.nan))


@cache
def reef() -> tuple[Image, Image, NDArray[np.float32]]:
    """The first frame of a simulated dive, enhanced and rectified as the nodes do it."""
    frame = rectified_frames(1, width=320, height=240, seed=3)[0]
    return to_gray(frame.left), to_gray(frame.right), frame.disparity
