"""A drift that pieces of motion feigned is taken out by the rows; one that is there stays."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros.recordings.clock_offset import Clock, _straightened
from uw_recon_ros.recordings.row_lag import RowLag, _ratio

SECONDS = 60.0


def rows(shift_s: float, drift: float, seed: int, noise: float = 0.05) -> np.ndarray:
    """What rows say at 40 moments of a swell, where a clock is wrong by so much: `_ratio`'s columns."""
    dice = np.random.default_rng(seed)
    moments = np.linspace(0, SECONDS, 40)
    rate, lag = dice.normal(0, 8, 40), dice.uniform(-0.017, 0.017, 40)
    along = dice.normal(20, 3, 40)
    wrong = shift_s + drift * moments
    offset = 1.5 + 0.02 * along + rate * (wrong - lag) + dice.normal(0, noise, 40)
    rest = np.full(40, 0.3)
    return np.stack([offset, along, rest, 2 * rest, rate, dice.normal(0, 8, 40), lag, moments], axis=1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("drift", [0.0, 1.6e-3, -1e-3])
def test_rows_tell_offset_and_drift(seed: int, drift: float) -> None:
    found = _ratio(rows(0.03, drift, seed), drifts=True)
    assert found is not None
    assert abs(found.drift - drift) < 4 * found.drift_sigma < 5e-4
    in_the_middle = found.shift_s + found.drift * found.middle_s
    assert abs(in_the_middle - 0.03 - drift * SECONDS / 2) < 4 * found.sigma_s
    without = _ratio(rows(0.03, 0.0, seed), drifts=False)
    assert without is not None
    assert abs(without.shift_s - 0.03) < 4 * without.sigma_s


@pytest.mark.parametrize(("is_there", "found"), [(0.0, 0.0), (5e-5, 0.0), (1e-3, 1e-3)])
def test_a_drift_is_believed_where_the_rows_bear_it_out(is_there: float, found: float) -> None:
    """Motion said -1.57 ms/s (lags of seven pieces, each 40 ms off): 45 ms at either end of a minute."""
    feigned = Clock(round(5.44e9), -1.57e-3, 0.046)
    rest = RowLag(5.37 - 5.44, 0.002, 0.1, is_there + 1.57e-3, 4e-5, SECONDS / 2)
    clock, sigma = _straightened(feigned, rest, SECONDS)
    assert clock.drift == pytest.approx(found, abs=1e-9)
    assert (sigma > 0) == (found > 0)
    assert clock.right_of(round(30e9)) / 1e9 == pytest.approx(35.37 + 30 * is_there, abs=1e-6)
