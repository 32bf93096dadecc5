"""A camera upside down is told by name; turned with its calibration, or otherwise, it is not."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.rectify.upright import check_upright

_POINTS = np.random.default_rng(1).uniform([0, 0], [640, 480], (60, 2))


def turned(degrees: float) -> np.ndarray:
    angle = np.deg2rad(degrees)
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return (_POINTS - 300) @ turn.T + 290


@pytest.mark.parametrize("degrees", [180, 178, -176])
def test_upside_down_is_told(degrees: float) -> None:
    with pytest.raises(EstimationError, match="upside down") as told:
        check_upright(_POINTS, turned(degrees))
    assert told.value.code == Code.RECTIFY_UPSIDE_DOWN


@pytest.mark.parametrize("degrees", [0, 10, -30, 90, -90])
def test_another_turn_is_not(degrees: float) -> None:
    check_upright(_POINTS, turned(degrees))


def test_a_few_points_or_none_tell_nothing() -> None:
    check_upright(_POINTS[:3], turned(180)[:3])
    check_upright(_POINTS, np.full_like(_POINTS, np.nan))
