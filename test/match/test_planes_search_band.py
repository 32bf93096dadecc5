"""Bands of disparities about a guide, and the start that large images get from images of half their size."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from uw_recon_ros.match.planes import initial_disparity
from uw_recon_ros.match.planes.initial_disparity import View, begin
from uw_recon_ros.match.planes.search_band import NEAR, SPARE, WIDTH, Band
from uw_recon_ros.match.planes.semiglobal import semiglobal_start
from uw_recon_ros.types import ByteImage, FloatImage

LABELS = 96


def slanted_pair(height: int = 90, width: int = 260) -> tuple[ByteImage, ByteImage, FloatImage]:
    """A floor whose disparity rises from 20 to 80 px, and a box on it, 70 px; the truth about the left view."""
    random = np.random.default_rng(4)
    texture = cv2.GaussianBlur(random.integers(0, 256, (height, 2 * width)).astype(np.float32), (0, 0), 0.8)
    truth = np.repeat(np.linspace(20, 80, height, dtype=np.float32)[:, None], width, axis=1)
    truth[30:60, 130:190] = 70
    v, u = np.indices(truth.shape).astype(np.float32)
    left = cv2.remap(texture, u + width / 2 - truth, v, cv2.INTER_LINEAR)
    right = np.clip(np.round(texture[:, width // 2 : width // 2 + width]), 0, 255).astype(np.uint8)
    return np.clip(np.round(left), 0, 255).astype(np.uint8), right, truth


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(WIDTH + 1, 300), st.floats(0, 60))
def test_a_band_holds_its_guide_and_all_that_is_near(seed: int, labels: int, rise: float) -> None:
    """The guide of a pixel always; those around it where one band can hold them. Nothing outside the labels."""
    random = np.random.default_rng(seed)
    guide = (
        (random.uniform(0, labels - 1) + random.uniform(-rise, rise, (12, 15))).clip(0, labels - 1).astype(np.float32)
    )
    band = Band.around(guide, labels)
    end = band.first + band.labels
    assert band.first.min() >= 0
    assert end.max() <= labels
    assert ((band.first <= guide) & (guide <= end - 1)).all()
    window = np.ones((NEAR, NEAR), np.uint8)
    least, most = cv2.erode(guide, window), cv2.dilate(guide, window)
    near = most - least <= WIDTH - 2 * SPARE
    assert (band.first <= least)[near].all()
    assert (end - 1 >= most)[near].all()
    assert (band.lowest <= band.first).all()
    assert (band.end >= end).all()


def _start(pair: tuple[ByteImage, ByteImage], guide: FloatImage | None, low: int = 0) -> NDArray[np.float32]:
    left, right = View.pair(*pair, 1)
    high = low + LABELS - 1
    views = left.planes, right.planes, left.gray, right.gray
    return semiglobal_start(*views, left.noise, low, high, 1, guide).disparity


@pytest.mark.parametrize("low", [0, -7, 12])
def test_guided_by_the_truth_the_surface_is_found(low: int) -> None:
    *pair, truth = slanted_pair()
    inside = np.s_[:, 90:]
    found, all_searched = (_start(tuple(pair), guide, low)[inside] for guide in (truth, None))
    error = np.abs(found - truth[inside])
    assert (error > 1).mean() <= (np.abs(all_searched - truth[inside]) > 1).mean() + 0.002
    assert np.median(error) < 0.25


def test_a_guide_that_is_wrong_is_followed_no_further_than_its_band() -> None:
    *pair, truth = slanted_pair()
    guide = np.full_like(truth, 30)
    found = _start(tuple(pair), guide)
    assert np.abs(found - guide).max() <= WIDTH / 2


def test_large_images_are_guided_by_those_of_half_the_size(monkeypatch: pytest.MonkeyPatch) -> None:
    *pair, truth = slanted_pair()
    alone = begin(*pair, 0, LABELS - 1, 1)
    assert alone.half is None
    monkeypatch.setattr(initial_disparity, "GUIDED", 1e5)
    for threads in (1, 2):
        guided = begin(*pair, 0, LABELS - 1, threads)
        assert guided.half is not None
        assert guided.half.disparity.shape == (45, 130)
        seen = np.s_[:, 90:]
        right = [(s.usable & (np.abs(s.disparity - truth) < 1))[seen].mean() for s in (guided, alone)]
        assert right[0] > right[1] - 0.01
        assert right[0] > 0.9
