"""Confidence: low where a result is wrong, by what can be seen of it; and what it must not depend on."""

from __future__ import annotations

import numpy as np
import pytest
from test_planes_matcher import pair_of

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes.confidence import DOUBTFUL_SIGMA, Signs, confidence_of, doubtful, signs_of_error
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import FloatImage, Mask, MatchingPair, Status

H, W = 120, 180
FLAT = np.full((H, W), 8.0, np.float32)
SIGMA = np.full((H, W), 0.1, np.float32)
AGREED = np.zeros((H, W), np.uint8)
CLEAN, HAZY = 0.05, 0.3  # noise over contrast


def far_off(signs: Signs, effort: str) -> Mask:
    """What may be far off."""
    return doubtful(signs, effort, confidence_of(signs, effort))


def seen(disparity: FloatImage, start: FloatImage, effort: str, grain: float = CLEAN) -> tuple[FloatImage, Mask]:
    """Confidence, and what may be far off."""
    signs = signs_of_error(disparity, SIGMA, start, AGREED, grain)
    return confidence_of(signs, effort), far_off(signs, effort)


@pytest.mark.parametrize("effort", EFFORTS)
def test_an_even_surface_is_beyond_doubt(effort: str) -> None:
    found, far = seen(FLAT, FLAT, effort)
    assert (found > 0.96).all()
    assert not far.any()


@pytest.mark.parametrize("effort", ["balanced", "quality"])
def test_a_plane_that_the_start_does_not_support_is_doubtful(effort: str) -> None:
    wrong = FLAT.copy()
    wrong[40:80, 60:120] += 13  # as the cuts invent them on blank areas
    found, far = seen(wrong, FLAT, effort)
    assert (found[52:68, 72:108] < 0.9).all()
    assert far[40:80, 60:120].mean() > 0.95
    assert not far[:20].any()


@pytest.mark.parametrize("effort", EFFORTS)
def test_a_start_that_the_views_disagree_about_makes_all_around_doubtful(effort: str) -> None:
    """Unlike what one camera alone sees, at a border or beside what stands in front."""
    for reason, expected in ((Status.INCONSISTENT, True), (Status.OCCLUDED, False), (Status.OUTSIDE, False)):
        status = AGREED.copy()
        status[::2, ::2] = reason
        signs = signs_of_error(FLAT, SIGMA, FLAT, status, CLEAN)
        assert signs.contradicted.max() > 0.2 if expected else signs.contradicted.max() == 0
    status[::2, ::2] = Status.INCONSISTENT
    assert far_off(signs_of_error(FLAT, SIGMA, FLAT, status, CLEAN), effort).all()


@pytest.mark.parametrize("effort", EFFORTS)
def test_the_nearer_noise_comes_to_the_contrast_the_more_is_doubtful(effort: str) -> None:
    status = AGREED.copy()
    status[:, ::24] = Status.INCONSISTENT
    stepped = FLAT.copy()
    stepped[:, 90:] += 4
    shares = [far_off(signs_of_error(stepped, SIGMA, stepped, status, g), effort).mean() for g in (CLEAN, HAZY, 1.0)]
    assert shares[0] <= shares[1] <= shares[2]
    assert shares[0] < shares[2]


@pytest.mark.parametrize("effort", EFFORTS)
def test_steps_and_holes_nearby_cost_confidence(effort: str) -> None:
    step, hollow = FLAT.copy(), FLAT.copy()
    step[:, 90:] += 10
    hollow[:, 90:] = np.nan
    even, by_step, by_hole = (seen(d, d, effort)[0][60, 88] for d in (FLAT, step, hollow))
    assert by_step < even - 0.02
    assert by_hole < even


@pytest.mark.parametrize("effort", EFFORTS)
def test_wrong_matches_are_less_sure_than_right_ones(effort: str) -> None:
    """A wall and, nearer, a box; what is wrong lies at its edges."""
    truth = np.full((H, W), 6.0)
    truth[30:90, 60:120] = 16.0
    result = graph_cut(*pair_of(truth), 0, 24, effort=effort)
    known = np.isfinite(result.disparity)
    wrong = known & (np.abs(result.disparity - truth) > 1)
    assert np.isfinite(result.confidence[known]).all()
    assert not np.isfinite(result.confidence[~known]).any()
    assert result.confidence[known].mean() > 0.95
    if wrong.sum() > 20:
        assert np.median(result.confidence[wrong]) < np.quantile(result.confidence[known], 0.3)
    far = known & (np.abs(result.disparity - truth) > 4)
    assert (far & (result.sigma < DOUBTFUL_SIGMA)).sum() <= 0.002 * known.sum()


@pytest.mark.parametrize("method", ["graph_cut", "kz2"])
@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_every_method_and_axis_has_it(method: str, axis: str) -> None:
    left, right = pair_of(FLAT.astype(float))
    if axis == "vertical":
        left, right = (np.ascontiguousarray(view.swapaxes(0, 1)) for view in (left, right))
    pair = MatchingPair(left, right, axis)  # type: ignore[arg-type]
    found, _ = Match(MatchParams(method=method, effort="navigation", max_disparity=16)).images(pair)
    assert found.confidence is not None
    assert np.array_equal(np.isfinite(found.confidence), np.isfinite(found.disparity))
    known = found.confidence[np.isfinite(found.confidence)]
    assert ((known > 0) & (known < 1)).all()


def test_threads_change_no_bit() -> None:
    pair = pair_of(FLAT.astype(float))
    one, three = (graph_cut(*pair, 0, 16, threads=threads).confidence for threads in (1, 3))
    assert one.tobytes() == three.tobytes()
