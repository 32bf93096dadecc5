"""`depth/sigma` on simulated dives holds 68 % of the errors; and what the depth filter leaves of it."""

from __future__ import annotations

from functools import cache
from typing import Any

import cv2
import numpy as np
import pytest

from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.reconstruct.depth_filter import sigma_after_smoothing
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import RectifiedPair, StereoPair

DIVES: dict[str, dict[str, Any]] = {
    "reef in coastal water": {"scene": "reef", "water": "3C"},
    "reef in murk": {"scene": "reef", "water": "7C"},
    "pipe, rig on its side": {"scene": "pipe", "water": "5C", "axis": "vertical"},
}
LOW, HIGH = 60.0, 76.0


@cache
def rectified(name: str) -> tuple[RectifiedPair, np.ndarray]:
    """A pair at half size, and the true depth of its rectified left view."""
    dive = Dive(SimulateParams(seed=3, width=400, height=300, **DIVES[name]))
    frame = dive.frame(0)
    enhanced = Preprocess()(StereoPair(frame.left, frame.right, frame.stamp_ns, "left", dive.calibration))
    pair = Rectify(RectifyParams())(enhanced, RigTracker(RectifyParams()).update(enhanced))
    height, width = pair.left.shape[:2]
    return pair, dive.true_depth(0, pair.geometry, width, height)


def share_within(name: str, effort: str) -> float:
    """Of the depths' errors, %."""
    pair, truth = rectified(name)
    depth = Reconstruct().depth(Match(MatchParams(effort=effort))(pair))
    known = np.isfinite(depth.depth) & np.isfinite(truth)
    assert known.mean() > 0.7
    return 100 * float((np.abs(depth.depth - truth) <= depth.sigma)[known].mean())


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
@pytest.mark.parametrize("name", DIVES)
def test_68_percent_of_the_errors_lie_within_sigma(name: str, effort: str) -> None:
    assert LOW <= share_within(name, effort) <= HIGH


def plane(noise: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    v, u = np.indices((120, 160), dtype=np.float32)
    truth = 20 + 0.02 * u - 0.03 * v
    return truth, (truth + np.random.default_rng(seed).normal(0, noise, truth.shape)).astype(np.float32)


def test_what_an_average_of_independent_errors_leaves() -> None:
    truth, noisy = plane(0.2)
    averaged = np.asarray(cv2.blur(noisy, (3, 3)), np.float32)
    left = sigma_after_smoothing(np.full(truth.shape, 0.2, np.float32), noisy, averaged)
    assert np.median(left[8:-8, 8:-8]) == pytest.approx(0.2 / 3, rel=0.25)
    spread = (averaged - truth)[8:-8, 8:-8].std()
    assert np.median(left[8:-8, 8:-8]) == pytest.approx(spread, rel=0.3)


def test_an_error_that_the_filter_adds_is_added() -> None:
    truth, noisy = plane(0.1)
    moved = noisy + np.float32(0.3)
    left = sigma_after_smoothing(np.full(truth.shape, 0.1, np.float32), noisy, moved)
    np.testing.assert_allclose(left[10:-10, 10:-10], np.hypot(0.1, 0.3), rtol=0.01)


def test_no_move_leaves_sigma_alone_and_nan_stays() -> None:
    _, values = plane(0.1)
    values[40:60, 50:70] = np.nan
    sigma = np.where(np.isfinite(values), np.float32(0.17), np.float32(np.nan))
    np.testing.assert_allclose(sigma_after_smoothing(sigma, values, values), sigma, rtol=1e-6)


def test_never_less_than_a_part_of_sigma() -> None:
    truth, noisy = plane(0.5)
    sigma = np.full(truth.shape, 0.1, np.float32)
    assert (sigma_after_smoothing(sigma, noisy, truth) >= 0.0199).all()
