"""What holds for any scene: symmetries, limits, borders, energy.

Exactly: any number of threads; a vertical rig; `navigation` upside down. The efforts that cut propose planes at random
from tiles that begin at the top left, so their mirrored and overturned problems have the same optimum, not the same
bits: there the disparities agree to a few hundredths of a pixel and the energies to some percent.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from helpers.drowned_scenes import middlebury_under_water, reef
from numpy.typing import NDArray
from test_match_stage import GEOMETRY
from test_planes_matcher import pair_of, plane, step_pair

from uw_recon_ros.match.disparity_range import find_disparity_range
from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import refinement
from uw_recon_ros.match.planes.expansion import Labelling, energy
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair

CUTTING = [effort for effort in EFFORTS if effort != "navigation"]


@pytest.mark.parametrize("effort", EFFORTS)
def test_vertical_rig_is_the_transposed_horizontal_one(effort: str) -> None:
    lying, standing = [], []
    for image in step_pair()[:2]:
        lying.append(image)
        standing.append(np.ascontiguousarray(image.swapaxes(0, 1)))
    results = []
    for sides, axis in ((lying, "horizontal"), (standing, "vertical")):
        geometry = dataclasses.replace(GEOMETRY, axis=axis)
        pair = RectifiedPair(*sides, *sides, geometry, RectificationQuality("given"))
        results.append(Match(MatchParams(max_disparity=15, effort=effort))(pair))
    one, other = results
    for name in ("disparity", "sigma", "status"):
        assert np.array_equal(getattr(one, name), getattr(other, name).T, equal_nan=name != "status")


def test_upside_down_start_is_the_start_upside_down() -> None:
    left, right, _ = step_pair()
    upright = graph_cut(left, right, 0, 15, effort="navigation")
    flipped = graph_cut(left[::-1], right[::-1], 0, 15, effort="navigation")
    assert np.array_equal(upright.disparity, flipped.disparity[::-1], equal_nan=True)
    assert np.array_equal(upright.status, flipped.status[::-1])


@pytest.mark.parametrize("effort", CUTTING)
def test_upside_down_problem_has_the_same_optimum(effort: str) -> None:
    left, right, _ = step_pair()
    upright = graph_cut(left, right, 0, 15, effort=effort)
    flipped = graph_cut(left[::-1], right[::-1], 0, 15, effort=effort)
    apart = np.abs(upright.disparity - flipped.disparity[::-1])
    assert (upright.status == flipped.status[::-1]).mean() > 0.98
    assert np.nanmedian(apart) < 0.01
    assert (apart > 0.25).mean() < 0.01
    assert flipped.energy == pytest.approx(upright.energy, rel=0.05)


@pytest.mark.parametrize("effort", EFFORTS)
def test_mirrored_pair_gives_the_right_view(effort: str) -> None:
    left, right, _ = step_pair()
    straight = graph_cut(left, right, 0, 15, effort=effort)
    seen_by_right = graph_cut(right[:, ::-1], left[:, ::-1], 0, 15, effort=effort).disparity[:, ::-1]
    v, u = np.nonzero(np.isfinite(straight.disparity))
    disparity = straight.disparity[v, u]
    apart = np.abs(seen_by_right[v, np.round(u - disparity).astype(int)] - disparity)
    assert np.isfinite(apart).mean() > 0.98
    assert np.nanmedian(apart) < 0.05
    assert (apart > 0.5).mean() < 0.02


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("slopes", [(0.15, 0.0), (-0.2, 0.1)])
def test_slanted_plane_to_a_tenth_of_a_pixel(effort: str, slopes: tuple[float, float]) -> None:
    truth = plane(60, 90, *slopes, 8.0 if slopes[0] > 0 else 30.0)
    error = np.abs(graph_cut(*pair_of(truth), 0, 60, effort=effort).disparity - truth)
    assert np.nanmedian(error) < 0.1
    assert np.isfinite(error[:, 50:]).mean() > 0.97


@pytest.mark.parametrize("effort", EFFORTS)
def test_no_dead_band_at_any_border(effort: str) -> None:
    truth = plane(80, 120, 0.05, 0.1, 4.0)
    error = np.abs(graph_cut(*pair_of(truth), 0, 20, effort=effort).disparity - truth)
    v, u = np.indices(truth.shape)
    seen = u >= truth + 1  # the rest lies outside the right view
    inside = seen & (np.minimum(np.minimum(v, 79 - v), 119 - u) > 15) & (u - truth > 15)
    assert (error[inside] < 0.5).mean() > 0.99
    for depth in range(6):
        for border in (v == depth, v == 79 - depth, u == 119 - depth, np.floor(u - truth) == depth + 1):
            assert (error[border & seen] < 0.5).mean() > 0.95
            assert np.nanmedian(error[border & seen]) < np.nanmedian(error[inside]) + 0.2


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("limits", [(3, 9), (-7, -2), (5, 6), (4, 4)])
def test_no_disparity_outside_the_limits(effort: str, limits: tuple[int, int]) -> None:
    centre = sum(limits) / 2
    result = graph_cut(*pair_of(plane(50, 80, 0.2, 0.0, centre - 8)), *limits, effort=effort)
    found = result.disparity[np.isfinite(result.disparity)]
    assert found.size
    assert found.min() >= limits[0]
    assert found.max() <= limits[1]


@pytest.mark.parametrize("effort", CUTTING)
def test_no_pass_of_cuts_raises_the_energy(effort: str, monkeypatch: pytest.MonkeyPatch) -> None:
    real, seen = refinement.run_tiles, []

    def watched(tiles: NDArray[np.int64], way: int, planes: int, cut: bool, *others: object) -> None:
        state = next(other for other in others if isinstance(other, Labelling))
        before = sum(energy(state))
        real(tiles, way, planes, cut, *others)  # type: ignore[arg-type]
        if cut:
            seen.append(sum(energy(state)) - before)

    monkeypatch.setattr(refinement, "run_tiles", watched)
    random = np.random.RandomState(1)
    noisy = (np.clip(side + random.normal(0, 12, side.shape), 0, 255).astype(np.uint8) for side in step_pair()[:2])
    graph_cut(*noisy, 0, 15, effort=effort)
    assert len(seen) > 20
    assert max(seen) <= 0
    assert min(seen) < 0


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("at", [-300, 420])
def test_far_disparities_either_way(effort: str, at: int) -> None:
    """A range far from zero on images hardly wider than it."""
    truth = plane(40, 560, 0.0, 0.1, float(at))
    left, right = pair_of(truth, margin=450)
    result = graph_cut(left, right, at - 6, at + 12, effort=effort)
    u = np.indices(truth.shape)[1]
    seen = (u - truth >= 1) & (u - truth <= 558)
    assert np.nanmedian(np.abs(result.disparity - truth)[seen]) < 0.1
    assert np.isfinite(result.disparity[seen]).mean() > 0.9
    assert not np.isfinite(result.disparity[~seen & (np.abs(u - truth - 280) > 290)]).any()


@pytest.mark.parametrize("water", ["hazy", "noisy", "uneven"])
def test_range_is_found_in_water(water: str) -> None:
    for name, left, right, truth in middlebury_under_water(water):
        low, high = find_disparity_range(left, right)
        least, greatest = np.nanpercentile(truth, [0.5, 99.5])
        assert low <= least, name
        assert high >= greatest, name
        assert high - low <= 2 * (greatest - least) + 20, name


def test_range_is_found_on_a_simulated_dive() -> None:
    left, right, truth = reef()
    low, high = find_disparity_range(left, right)
    least, greatest = np.nanpercentile(truth, [1, 99])
    assert low <= least
    assert high >= greatest
    assert high - low <= 2 * (greatest - least) + 30
