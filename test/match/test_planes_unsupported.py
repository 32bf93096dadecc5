"""Pieces of a disparity map that nothing carries are left out, others are not."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from uw_recon_ros.match.planes.open_water import OpenWater
from uw_recon_ros.match.planes.unsupported import unfounded
from uw_recon_ros.types import FloatImage, Mask

SHAPE = 120, 160
LIMITS = 0.0, 64.0
PIECE = np.s_[50:64, 70:90]  # 280 px: 1.5 % of the image


def _nothing() -> tuple[FloatImage, FloatImage]:
    return np.full(SHAPE, np.nan, np.float32), np.full(SHAPE, np.nan, np.float32)


def _water(shown: bool = False, faint: bool = False) -> OpenWater:
    return OpenWater(np.full(SHAPE, shown), np.full(SHAPE, faint))


def _lost(trust: float, water: OpenWater, *, at: float = 20.0, around: float = np.nan, least: float = 0.0) -> Mask:
    """What is lost of `PIECE`, of this confidence, before surroundings of a disparity `around`."""
    disparity, confidence = _nothing()
    disparity[:], confidence[:] = around, np.float32(0.99) if np.isfinite(around) else np.nan
    disparity[PIECE], confidence[PIECE] = at, trust
    water.shown[PIECE] = False
    return unfounded(disparity, confidence, water, (least, 64.0))


def test_a_piece_hardly_a_pixel_of_which_is_likely_right_goes_whole() -> None:
    """And nothing else; one that is likely right stays."""
    lost = _lost(0.5, _water(), around=5.0)
    assert lost[PIECE].all()
    assert lost.sum() == lost[PIECE].size
    assert not _lost(0.7, _water(), around=5.0).any()


def test_amid_water_a_small_piece_must_be_surer() -> None:
    """The same piece stays amid surfaces, and goes amid water."""
    assert not _lost(0.75, _water(), around=5.0).any()
    assert _lost(0.75, _water(shown=True))[PIECE].all()
    assert not _lost(0.95, _water(shown=True)).any()


def test_amid_water_a_large_piece_need_not_be_surer() -> None:
    """A wreck before open water stays."""
    disparity, confidence = _nothing()
    water = _water(shown=True)
    half = np.s_[:, 80:]
    disparity[half], confidence[half], water.shown[half] = 20.0, 0.75, False
    assert not unfounded(disparity, confidence, water, LIMITS).any()


def test_an_island_of_faint_texture_in_water_is_water() -> None:
    """However sure it looks; a fish is not faint."""
    assert _lost(0.99, _water(shown=True, faint=True))[PIECE].all()
    assert not _lost(0.99, _water(shown=True)).any()
    assert not _lost(0.99, _water(faint=True), around=5.0).any()


def test_what_would_rather_lie_further_away_than_is_searched_is_water() -> None:
    """A faint piece at the least disparity goes, a textured one there stays, a faint one elsewhere too."""
    assert _lost(0.99, _water(faint=True), at=12.4, around=30.0, least=12.0)[PIECE].all()
    assert not _lost(0.99, _water(), at=12.4, around=30.0, least=12.0).any()
    assert not _lost(0.99, _water(faint=True), at=14.0, around=30.0, least=12.0).any()


def test_a_faint_piece_at_the_greatest_disparity_is_no_near_obstacle() -> None:
    """However large; a textured one there stays, and so does a floor that reaches there."""
    disparity, confidence = _nothing()
    disparity[:, :80], confidence[:] = 63.6, 0.99
    disparity[:, 80:] = 20.0
    lost = unfounded(disparity, confidence, _water(faint=True), LIMITS)
    assert lost[:, :80].all()
    assert not lost[:, 80:].any()
    assert not unfounded(disparity, confidence, _water(), LIMITS).any()
    floor = np.broadcast_to(np.linspace(30, 64, SHAPE[0], dtype=np.float32)[:, None], SHAPE)
    assert not unfounded(floor, np.full(SHAPE, 0.99, np.float32), _water(faint=True), LIMITS).any()


@given(st.integers(0, 2**32 - 1))
def test_pieces_go_whole_and_only_where_there_is_something(seed: int) -> None:
    """Whatever the map: pixels without a disparity are not named, neighbours of one value go together."""
    rng = np.random.default_rng(seed)
    values = np.kron(rng.integers(0, 4, (6, 8)), np.ones((5, 5))).astype(np.float32) * 3
    disparity = np.where(values == 0, np.float32(np.nan), values)
    confidence = np.where(values == 0, np.float32(np.nan), rng.random(values.shape, np.float32))
    lost = unfounded(
        disparity, confidence, OpenWater(rng.random(values.shape) < 0.5, rng.random(values.shape) < 0.5), LIMITS
    )
    assert not lost[np.isnan(disparity)].any()
    same = disparity[:, 1:] == disparity[:, :-1]
    assert (lost[:, 1:] == lost[:, :-1])[same].all()
    sure = np.where(np.isfinite(disparity), np.float32(1), disparity)
    nothing = np.zeros(values.shape, np.bool_)
    assert not unfounded(disparity, sure, OpenWater(nothing, nothing), LIMITS).any()
