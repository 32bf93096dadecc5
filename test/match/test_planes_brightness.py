"""A surface that is not as bright in both views: how much is found, and disparities are not pulled to one side."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from test_planes_matcher import Image, pair_of

from uw_recon_ros.match.planes.brightness import brightened, brightness_between
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.planes.semiglobal import Start

H, W = 160, 240
V, U = np.indices((H, W), dtype=np.float32)


def lit(image: Image, along: NDArray[np.float32]) -> Image:
    """Faint texture on what brightens along the row."""
    return np.asarray((0.1 * image + 60 + 0.5 * along[..., None]).round(), np.uint8)


def test_a_known_difference_is_found() -> None:
    left = np.asarray(np.random.default_rng(0).integers(60, 180, (40, 60, 3)), np.uint8)
    by = np.linspace(-20, 20, 60, dtype=np.float32)[None, :, None] + np.zeros((40, 60, 3), np.float32)
    right = np.asarray(np.roll(left, -5, axis=1) - by.round(), np.uint8)
    seen = np.where(np.arange(60) < 55, np.float32(5), np.float32(np.nan)) + np.zeros((40, 1), np.float32)
    start = Start(np.full((40, 60), 5, np.float32), np.asarray(seen, np.float32))
    found = brightness_between(left, right, start)
    assert np.abs(found - by)[:, 10:45].max() < 3
    planes = np.ascontiguousarray(right.transpose(2, 0, 1))
    mended = brightened(planes, found).transpose(1, 2, 0)
    error = np.abs(mended.astype(float) - np.roll(left, -5, axis=1))[:, 10:45].mean()
    assert error < 0.3 * np.abs(by[:, 10:45]).mean()


def test_where_nothing_matches_nothing_is_changed() -> None:
    views = np.random.default_rng(0).integers(0, 255, (2, 20, 30, 1)).astype(np.uint8)
    none = np.full((20, 30), np.nan, np.float32)
    assert not brightness_between(*views, Start(np.zeros((20, 30), np.float32), none)).any()


def test_brightness_does_not_pull_faint_texture_to_a_side() -> None:
    truth = (12 + 0.03 * U + 0.003 * V).astype(np.float32)
    left, right = pair_of(truth)
    views = lit(left, U), lit(right, U + truth)  # shaded, the same surface as bright in both

    def median_error(brighter: int) -> float:
        other = np.asarray((views[1] + float(brighter)).clip(0, 255), np.uint8)
        return float(np.nanmedian((graph_cut(views[0], other, 8, 26, effort="navigation").disparity - truth)[:, 30:]))

    assert abs(median_error(15) - median_error(-15)) < 0.03  # 0.05 if colours are compared as they come
