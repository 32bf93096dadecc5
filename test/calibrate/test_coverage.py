"""What of an image is near points of the board, and which corners are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, LARGE, rig_of, sightings
from hypothesis import given
from hypothesis import strategies as st

from uw_recon_ros.calibrate.advice import lacking
from uw_recon_ros.calibrate.coverage import CORNERS, REACH, corners_covered, covered, emptiest, near_points
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate_files import calibrate_seen

SIZE = (1280, 960)
DIAGONAL = 1600.0


def sighting(*pixels: tuple[float, float]) -> Sighting:
    return Sighting(np.arange(len(pixels)), np.array(pixels, np.float64), 1.5, 40.0)


def test_one_point_covers_a_disc() -> None:
    share = covered(near_points([sighting((640.0, 480.0))], SIZE))
    assert share == pytest.approx(np.pi * (REACH * DIAGONAL) ** 2 / (SIZE[0] * SIZE[1]), rel=0.1)


def test_nothing_covers_nothing() -> None:
    assert covered(near_points([], SIZE)) == 0


@pytest.mark.parametrize(("at", "name"), list(zip([(0, 0), (1279, 0), (0, 959), (1279, 959)], CORNERS, strict=True)))
def test_the_corner_without_points_is_named(at: tuple[int, int], name: str) -> None:
    u, v = (part.ravel() for part in np.meshgrid(np.arange(0, 1280, 40.0), np.arange(0, 960, 40.0)))
    far = np.hypot(u - at[0], v - at[1]) > 450
    near = near_points([sighting(*zip(u[far], v[far], strict=True))], SIZE)
    assert corners_covered(near)[name] < 0.1
    assert all(share == 1 for corner, share in corners_covered(near).items() if corner != name)
    assert lacking(near) == emptiest(near) == name


@given(st.lists(st.tuples(st.floats(-0.5, 1279.4), st.floats(-0.5, 959.4)), min_size=1, max_size=20))
def test_more_points_never_cover_less(points: list[tuple[float, float]]) -> None:
    some, all_of_them = (near_points([sighting(*part)], SIZE) for part in (points[:1], points))
    assert not (some & ~all_of_them).any()


def test_a_session_in_the_middle_is_told_its_corners() -> None:
    """Where boards in coarse cells would look as if they had covered most of the view."""
    pairs = sightings(rig_of(2, **LARGE), 10, 2)
    aside = [np.abs(side.pixels - np.array(SIZE) / 2) / SIZE for p in pairs for side in (p.left, p.right)]
    assert max(part.max() for part in aside) < 0.5
    told = calibrate_seen(([replace(pair, place=k) for k, pair in enumerate(pairs)], [], SIZE), BOARD).findings
    texts = [f"{f.text} {f.advice}" for f in told if f.code.value == "calibrate.coverage"]
    assert any("lower left 0%" in text and "towards the" in text for text in texts), texts
