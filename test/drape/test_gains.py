"""Gains that are known, on a bottom that is known."""

from __future__ import annotations

import numpy as np
from helpers.fuse_scenes import looking_down, plane_view

from uw_recon_ros.drape.gains import gains_of
from uw_recon_ros.fuse.blocks import View


def painted(x: float, gain: np.ndarray) -> View:
    view = plane_view(looking_down(x))
    v, u = np.mgrid[: view.depth.shape[0], : view.depth.shape[1]]
    fx, fy, cx, cy = view.intrinsics
    east, north = x + (u - cx) / fx * view.depth, -(v - cy) / fy * view.depth
    bottom = 90 + 30 * np.sin(7 * east) * np.cos(5 * north)
    view.color[:] = np.rint(bottom[..., None] * gain).clip(0, 255)
    return view


def places() -> np.ndarray:
    rng = np.random.default_rng(1)
    return np.column_stack([rng.uniform(-1, 3, 4000), rng.uniform(-0.4, 0.4, 4000), np.zeros(4000)])


def test_gains_along_a_chain_of_views_are_found() -> None:
    true = np.exp(np.random.default_rng(2).uniform(-0.3, 0.3, (6, 3)))
    views = [painted(0.4 * k, true[k]) for k in range(6)]
    found = gains_of(lambda k: views[k], 6, places(), 0.05)
    ratio = found / true
    np.testing.assert_allclose(ratio / ratio.mean(axis=0), 1, atol=0.01)
    np.testing.assert_allclose(np.log(found).mean(axis=0), 0, atol=0.02)


def test_views_that_share_nothing_keep_their_brightness() -> None:
    views = [painted(0.0, np.full(3, 1.4)), painted(50.0, np.full(3, 0.7))]
    np.testing.assert_allclose(gains_of(lambda k: views[k], 2, places(), 0.05), 1, atol=1e-9)


def test_what_is_hidden_or_cut_off_says_nothing() -> None:
    dark, bright = painted(0.0, np.ones(3)), painted(0.1, np.full(3, 9.0))
    np.testing.assert_allclose(gains_of(lambda k: (dark, bright)[k], 2, places(), 0.05), 1, atol=1e-9)
    lifted = places() + np.array([0.0, 0.0, 0.2])
    views = [painted(0.0, np.ones(3)), painted(0.1, np.full(3, 1.5))]
    np.testing.assert_allclose(gains_of(lambda k: views[k], 2, lifted, 0.05), 1, atol=1e-9)
