"""Cameras that did not see the same moments are told, with the shift where there is one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from helpers.calibration_scenes import BOARD, LARGE, rig_of, sightings

from uw_recon_ros import calibrate_live
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.fit import solve
from uw_recon_ros.calibrate.moments import alone_px, do_not_belong, find_shift
from uw_recon_ros.calibrate_files import BoardAsked, Seen, calibrate_seen
from uw_recon_ros.calibrate_live import LiveSession
from uw_recon_ros.errors import CalibrationError

SIZE = (1280, 960)


def _late_by(shift: int, pairs: list[SeenPair]) -> list[SeenPair]:
    """The right pictures of a recording, `shift` places later than they belong."""
    there = range(max(shift, 0), len(pairs) + min(shift, 0))
    return [replace(pairs[k], right=pairs[k - shift].right, place=k) for k in there]


@pytest.fixture(scope="module")
def sound() -> list[SeenPair]:
    return [replace(pair, place=k) for k, pair in enumerate(sightings(rig_of(2, **LARGE), 8, 2))]


@pytest.mark.parametrize(("shift", "words"), [(1, "1 pair late"), (-2, "2 pairs early")])
def test_a_shifted_camera_is_one_clear_line(sound: list[SeenPair], shift: int, words: str) -> None:
    with pytest.raises(CalibrationError, match=words) as told:
        calibrate_seen((_late_by(shift, sound), [], SIZE), BOARD)
    assert told.value.code.value == "calibrate.unsynchronised"
    left, right = (f"{k:03}" for k in ((1, 2) if shift == 1 else (2, 0)))
    assert f"left one of {left} belongs to the right one of {right}" in str(told.value)


def test_a_shift_is_found_live_where_only_some_pairs_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every second pair is not kept: it still holds the partner of the one before."""
    pairs, blank = _late_by(1, sightings(rig_of(2, **LARGE), 20, 2)), np.zeros(SIZE[::-1], np.uint8)
    session = LiveSession(BoardAsked(size=(BOARD.columns, BOARD.rows), square_m=BOARD.square_m))
    monkeypatch.setattr(calibrate_live, "seen_before", lambda pair, *_: pair.place % 2 == 0)
    at_hand = iter([sighting for pair in pairs for sighting in (pair.left, pair.right)])
    monkeypatch.setattr(calibrate_live, "find_board", lambda *_: next(at_hand))
    for k in range(len(pairs)):
        session.add(Seen(f"{k:03}", blank, blank))
    assert len(session.pairs) < len(pairs)
    with pytest.raises(CalibrationError, match="1 pair late"):
        session.solve()


def test_a_shift_over_a_gap_is_counted_in_pairs_of_the_recording() -> None:
    pairs = [pair for pair in _late_by(2, sightings(rig_of(2, **LARGE), 12, 2)) if pair.place != 5]
    found = find_shift(pairs, BOARD, SIZE)
    assert found is not None
    assert found.pairs == 2


def test_moments_that_no_shift_brings_together(sound: list[SeenPair]) -> None:
    other = sightings(rig_of(2, **LARGE), 6, 7)
    mixed = [replace(one, right=two.right) for one, two in zip(sound, other, strict=False)]
    with pytest.raises(CalibrationError) as told:
        calibrate_seen((mixed, [], SIZE), BOARD)
    assert told.value.code.value in ("calibrate.unsynchronised", "calibrate.too_few")
    assert "one moment" in str(told.value) or "do not belong together" in str(told.value)


def test_sound_pairs_are_not_suspected(sound: list[SeenPair]) -> None:
    assert not do_not_belong(solve(sound, BOARD, SIZE), sound, BOARD, SIZE)
    assert alone_px(sound, BOARD, SIZE) == pytest.approx(0.3, abs=0.05)
    assert find_shift(sound, BOARD, SIZE) is None
