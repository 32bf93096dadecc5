"""Pairs under water whose disparities are known."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from uw_recon_ros.images import to_gray

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmark"))

from drowned_pairs import STEREO, WATERS, drown, pairs
from simulated_frames import rectified_frames

Image = NDArray[np.uint8]


def middlebury_under_water(water: str) -> Iterator[tuple[str, Image, Image, NDArray[np.float32]]]:
    """Name, mono images, true disparity of the left one (NaN = unknown)."""
    if not STEREO.is_dir():
        pytest.skip(f"{STEREO} is not here")
    for truth in pairs():
        left, right = (to_gray(eye) for eye in drown(truth, WATERS[water]))
        yield truth.name, left, right, np.where(truth.mask, truth.disparity, np.float32(np.nan))


@cache
def reef() -> tuple[Image, Image, NDArray[np.float32]]:
    """The first frame of a simulated dive, enhanced and rectified as the nodes do it."""
    frame = rectified_frames(1, width=320, height=240, seed=3)[0]
    return to_gray(frame.left), to_gray(frame.right), frame.disparity
