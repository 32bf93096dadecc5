"""Pictures of one camera that are mirrored or upside down are told as such."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, LARGE, rig_of, sightings

from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.fit import turned_over
from uw_recon_ros.calibrate_files import calibrate_seen
from uw_recon_ros.errors import CalibrationError

SIZE = (1280, 960)
NUMBERS = np.arange(54).reshape(6, 9)


def _turned(pair: SeenPair, way: str) -> SeenPair:
    """As a finder of checkerboards, which knows no markers, reports a picture that was turned over."""
    order, signs = {"mirrored": (NUMBERS[:, ::-1], [-1, 1]), "upside down": (NUMBERS[::-1, ::-1], [-1, -1])}[way]
    pixels = np.where(np.array(signs) < 0, np.array(SIZE) - 1.0 - pair.right.pixels, pair.right.pixels)
    return replace(pair, right=replace(pair.right, pixels=pixels[order.ravel()]))


@pytest.mark.parametrize("way", ["mirrored", "upside down"])
def test_one_camera_turned_over_is_one_clear_line(way: str) -> None:
    pairs = [_turned(pair, way) for pair in sightings(rig_of(2, **LARGE), 6, 2)]
    with pytest.raises(CalibrationError, match=way):
        calibrate_seen((pairs, [], SIZE), BOARD)


def test_sound_pairs_are_not_turned_over() -> None:
    assert turned_over(sightings(rig_of(2, **LARGE), 6, 2), BOARD, SIZE) is None
