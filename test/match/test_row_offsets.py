"""Rows that are off: a field known beforehand is found and taken out; rows that agree are left alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_match_stage import GEOMETRY
from test_planes_matcher import Image, pair_of

from uw_recon_ros.match.row_correction import mend_rows
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import DisparityMap, RectificationQuality, RectifiedPair

H, W = 200, 280
LIMITS = 0, 24
V, U = np.indices((H, W), dtype=np.float32)
TRUTH = (8 + 4 * np.sin(U / 60) + V / 40).astype(np.float32)
Field = Callable[[NDArray[np.float32], NDArray[np.float32]], NDArray[np.float32]]
FIELDS: dict[str, Field] = {
    "shifted": lambda x, y: 1 + 0 * x,
    "far": lambda x, y: 2 + 0 * x,
    "up": lambda x, y: -0.7 + 0 * x,
    "turned": lambda x, y: 1.5 * x,
    "bent": lambda x, y: 0.8 * x * y + 0.7 * y**2,
}


def lowered(right: Image, field: Field) -> Image:
    """The right view with what was at (u, v) at ``v + field``, x and y from -1 to 1."""
    below = field(2 * U / (W - 1) - 1, 2 * V / (H - 1) - 1)
    rows = (V - below).astype(np.float32)
    return np.asarray(cv2.remap(right, U, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def bad(result: DisparityMap) -> float:
    error = np.abs(result.disparity - TRUTH)[8:-8, 40:]
    return float(1 - (error < 1).mean())


def matched(left: Image, right: Image, **choice: object) -> DisparityMap:
    pair = RectifiedPair(left, right, left, right, GEOMETRY, RectificationQuality("given"))
    params = MatchParams(min_disparity=LIMITS[0], max_disparity=LIMITS[1], **choice)  # type: ignore[arg-type]
    return Match(params)(pair)


@pytest.mark.parametrize("name", FIELDS)
def test_a_known_field_is_found_and_taken_out(name: str) -> None:
    left, right = pair_of(TRUTH)
    low = lowered(right, FIELDS[name])
    mended, offset, _ = mend_rows(left, low, *LIMITS, 1)
    assert offset.mended
    truth = np.abs(FIELDS[name](2 * U / (W - 1) - 1, 2 * V / (H - 1) - 1))
    assert offset.median_px == pytest.approx(np.median(truth), abs=0.15)
    inner = np.s_[12:-12, 12:-12]
    before, after = (np.abs(x.astype(float) - right)[inner].mean() for x in (low, mended))
    assert after < 0.45 * before


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
def test_matching_hardly_suffers(effort: str) -> None:
    left, right = pair_of(TRUTH)
    clean = bad(matched(left, right, effort=effort))
    low = lowered(right, FIELDS["far"])
    assert bad(matched(left, low, effort=effort)) < clean + 0.02
    assert bad(matched(left, low, effort=effort, mend_rows=False)) > clean + 0.1


def test_rows_that_agree_are_left_as_they_are() -> None:
    left, right = pair_of(TRUTH)
    mended, offset, _ = mend_rows(left, right, *LIMITS, 1)
    assert mended is right
    assert not offset.mended
    assert offset.median_px < 0.1
    assert offset.points > 100


def test_what_shows_too_little_is_not_judged() -> None:
    blank = np.full((H, W, 3), 90, np.uint8)
    mended, offset, _ = mend_rows(blank, blank, *LIMITS, 1)
    assert mended is blank
    assert np.isnan(offset.median_px)
    assert "not measured" in str(offset)


def test_unrelated_images_are_not_bent() -> None:
    noise = np.random.default_rng(0).integers(0, 255, (2, H, W, 3)).astype(np.uint8)
    assert not mend_rows(noise[0], noise[1], *LIMITS, 1)[1].mended


def test_the_number_of_threads_changes_no_bit() -> None:
    left, right = pair_of(TRUTH)
    low = lowered(right, FIELDS["bent"])
    one, three = (mend_rows(left, low, *LIMITS, threads) for threads in (1, 3))
    assert one.right.tobytes() == three.right.tobytes()
    assert one.offset == three.offset


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_the_stage_reports_it_for_either_axis(axis: str) -> None:
    left, right = pair_of(TRUTH)
    views = [left, lowered(right, FIELDS["shifted"])]
    if axis == "vertical":
        views = [np.ascontiguousarray(view.swapaxes(0, 1)) for view in views]
    geometry = dataclasses.replace(GEOMETRY, axis=axis)
    pair = RectifiedPair(*views, *views, geometry, RectificationQuality("given"))
    result = Match(MatchParams(max_disparity=LIMITS[1], effort="navigation"))(pair)
    assert result.rows.mended
    assert result.rows.median_px == pytest.approx(1.0, abs=0.1)
