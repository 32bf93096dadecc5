"""The stage: axes, windows, status, limits, parameters."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from test_kz2_matcher import two_planes

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.match.stage import WHOLE_PIXEL_SIGMA, Match, MatchParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair, Status, StereoGeometry, Window

GEOMETRY = StereoGeometry(focal_px=500.0, cx_left=50.0, cx_right=50.0, cy=30.0)


def make_pair(axis: str = "horizontal", color: bool = True) -> RectifiedPair:
    left, right, _ = two_planes()
    if axis == "vertical":
        left, right = np.swapaxes(left, 0, 1), np.swapaxes(right, 0, 1)
    sides = (left, right) if color else (left[:, :, 1], right[:, :, 1])
    geometry = dataclasses.replace(GEOMETRY, axis=axis)
    return RectifiedPair(left, right, *sides, geometry, RectificationQuality("given"), stamp_ns=7, frame_id="camera")


def test_map_is_consistent_and_carries_the_head() -> None:
    result = Match(MatchParams(method="kz2", min_disparity=0, max_disparity=12))(make_pair())
    valid = np.isfinite(result.disparity)
    assert result.disparity.dtype == result.sigma.dtype == np.float32
    assert result.status.dtype == np.uint8
    assert np.array_equal(valid, result.status == Status.VALID)
    assert np.array_equal(valid, np.isfinite(result.sigma))
    assert np.allclose(result.sigma[valid], WHOLE_PIXEL_SIGMA)
    assert (result.stamp_ns, result.frame_id, result.method) == (7, "camera", "kz2")
    assert (result.min_disparity, result.max_disparity) == (0, 12)
    assert result.energy == int(result.energy) < 0


def test_status_tells_hidden_from_out_of_view() -> None:
    result = Match(MatchParams(method="kz2", max_disparity=12))(make_pair())
    assert (result.status[:, :3] == Status.OUTSIDE).mean() > 0.9
    hidden = result.status[17:43, 36:39]
    assert (hidden == Status.OCCLUDED).mean() > 0.8
    assert set(np.unique(result.status)) <= {Status.VALID, Status.OCCLUDED, Status.OUTSIDE}


@pytest.mark.parametrize("color", [False, True])
def test_vertical_rig_is_the_transposed_horizontal_one(color: bool) -> None:
    match = Match(MatchParams(method="kz2", max_disparity=12))
    lying, standing = match(make_pair(color=color)), match(make_pair("vertical", color))
    assert standing.disparity.shape == (100, 60)
    assert np.array_equal(standing.disparity.T, lying.disparity, equal_nan=True)
    assert np.array_equal(standing.status.T, lying.status)
    assert standing.energy == lying.energy


def test_range_is_found_when_none_is_given() -> None:
    result = Match(MatchParams(method="kz2"))(make_pair(color=False))
    assert -8 <= result.min_disparity <= 4
    assert 9 <= result.max_disparity <= 20


def test_nothing_to_see() -> None:
    flat = np.full((40, 60, 3), 50, np.uint8)
    blank = RectifiedPair(flat, flat, flat[:, :, 0], flat[:, :, 0], GEOMETRY, RectificationQuality("given"))
    with pytest.raises(EstimationError, match="disparity range: expected at least"):
        Match()(blank)


def test_windows_mask_what_shows_nothing() -> None:
    pair = dataclasses.replace(make_pair(), valid_left=Window(5, 2, 90, 50), valid_right=Window(20, 0, 80, 60))
    result = Match(MatchParams(method="kz2", max_disparity=12))(pair)
    unseen = np.ones(result.status.shape, bool)
    unseen[2:52, 5:95] = False
    assert (result.status[unseen] == Status.UNSEEN).all()
    assert not (result.status[~unseen] == Status.UNSEEN).any()
    assert (result.status[2:52, 5:20] == Status.OUTSIDE).all()
    assert (result.status[2:14, 25:] == Status.VALID).mean() > 0.9


def test_same_input_same_bits() -> None:
    results = [
        Match(MatchParams(method="kz2", max_disparity=12, match_threads=threads))(make_pair()) for threads in (1, 2)
    ]
    assert results[0].disparity.tobytes() == results[1].disparity.tobytes()
    other = Match(MatchParams(method="kz2", max_disparity=12, match_seed=5))(make_pair())
    assert other.energy == pytest.approx(results[0].energy, rel=0.01)


def test_costs_given_by_the_caller_are_used() -> None:
    pair = make_pair(color=False)
    noise = np.random.RandomState(2).normal(0, 20, pair.right_matching.shape)
    noisy = dataclasses.replace(pair, right_matching=np.clip(pair.right_matching + noise, 0, 255).astype(np.uint8))
    cheap, dear = (
        Match(MatchParams(method="kz2", max_disparity=12, occlusion_cost=cost))(noisy) for cost in (10.0, 400.0)
    )
    assert cheap.density < dear.density - 0.05
    rough, even = (
        Match(MatchParams(method="kz2", max_disparity=12, occlusion_cost=60.0, smoothness=smoothness))(noisy)
        for smoothness in (1.0, 12.0)
    )
    steps = [np.nansum(np.abs(np.diff(result.disparity, axis=0)) > 0) for result in (rough, even)]
    assert steps[0] > 2 * steps[1] > 0


def test_parameters_are_checked() -> None:
    with pytest.raises(ValueError, match="max_disparity: expected at least min_disparity = 9 px, got 3"):
        MatchParams(min_disparity=9, max_disparity=3)
    with pytest.raises(ValueError, match="method: expected one of graph_cut, kz2"):
        MatchParams(method="magic")


def test_warm_up_leaves_nothing_to_compile() -> None:
    from uw_recon_ros.match.kz2.expansion import _solve

    match = Match(MatchParams(method="kz2"))
    match.warm_up()
    compiled = len(_solve.signatures)
    match(make_pair())
    match(make_pair(color=False))
    assert len(_solve.signatures) == compiled == 1
