"""Which of the pairs that come are worked on, by a clock that the test winds."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros.ros.rate_limiter import Pace


def taken(limit_hz: float, arrivals: np.ndarray) -> np.ndarray:
    """Arrivals that pass."""
    clock = iter(arrivals.tolist())
    pace = Pace(lambda: next(clock))
    pace.limit_hz = limit_hz
    return arrivals[[pace.lets_through() for _ in arrivals]]


@pytest.mark.parametrize("camera_hz", [5.0, 7.0, 10.0, 12.0, 15.0, 30.0, 60.0])
def test_faster_cameras_are_held_to_the_limit_evenly(camera_hz: float) -> None:
    random = np.random.default_rng(1)
    arrivals = np.arange(0.0, 60.0, 1 / camera_hz)
    arrivals += random.uniform(-0.005, 0.005, arrivals.shape)
    times = taken(5.0, arrivals)
    assert len(times) == pytest.approx(300, rel=0.02)
    assert np.diff(times).max() < 0.2 + 1 / camera_hz + 0.01  # what the cameras are late or early by


def test_slower_cameras_all_pass() -> None:
    arrivals = np.arange(0.0, 60.0, 0.25) + np.random.default_rng(2).uniform(-0.02, 0.02, 240)
    assert len(taken(5.0, arrivals)) == len(arrivals)


def test_no_limit() -> None:
    pace = Pace()
    assert all(pace.lets_through() for _ in range(100))


def test_a_pause_saves_up_for_one_and_no_more() -> None:
    arrivals = np.concatenate([[0.0], 100.0 + np.arange(0.0, 2.0, 0.01)])
    times = taken(5.0, arrivals)
    assert (times >= 100.0).sum() <= 2 * 5 + 2
