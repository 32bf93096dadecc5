"""The clocks of two cameras by what both heard; the sound is made, the encoder is a real one."""

from __future__ import annotations

from collections.abc import Iterable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from helpers.videos import swaying, texture
from numpy.typing import NDArray

from uw_recon_ros.recordings.clock_offset import find_clock
from uw_recon_ros.recordings.clock_sound import find_sound_lag, has_sound
from uw_recon_ros.recordings.video import Video

RATE = 16000


def sound(begin: float, seconds: float, events: Iterable[float], seed: int, drift: float = 0.0) -> NDArray[np.float32]:
    """Knocks at moments of the dive, as a camera hears them that began at `begin`, with a noise of its own."""
    dice = np.random.default_rng(seed)
    found = dice.normal(0, 0.01, int(seconds * RATE)).astype(np.float32)
    ring = np.exp(-np.arange(1600) / 200) * np.sin(np.arange(1600) * dice.uniform(0.5, 0.8))
    for moment in events:
        at = int((moment - begin) * (1 + drift) * RATE)
        if 0 <= at < len(found) - len(ring):
            found[at : at + len(ring)] += 0.4 * ring.astype(np.float32)
    return found


def write_filmed(path: Path, images: Iterable[NDArray[np.uint8]], rate: float, heard: NDArray[np.float32]) -> Path:
    av = pytest.importorskip("av", reason="videos need the extra 'video'")
    with av.open(str(path), "w") as out:
        picture = out.add_stream("libx264", rate=Fraction(rate).limit_denominator(1001))
        track = out.add_stream("aac", rate=RATE, layout="mono")
        picture.width, picture.height, picture.pix_fmt = 240, 180, "yuv420p"
        picture.options = {"preset": "ultrafast", "g": "12"}
        for image in images:
            out.mux(picture.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="rgb24")))
        out.mux(picture.encode())
        for begin in range(0, len(heard), 1024):
            frame = av.AudioFrame.from_ndarray(heard[None, begin : begin + 1024], format="fltp", layout="mono")
            frame.sample_rate, frame.pts, frame.time_base = RATE, begin, Fraction(1, RATE)
            out.mux(track.encode(frame))
        out.mux(track.encode())
    return path


def still(seconds: float, seed: int = 5) -> Iterable[NDArray[np.uint8]]:
    return (texture(seed) for _ in range(int(seconds * 2)))


def knocks(seconds: float, seed: int = 1) -> NDArray[np.float64]:
    return np.cumsum(np.random.default_rng(seed).uniform(0.7, 3.0, int(seconds)))


@pytest.mark.parametrize("offset", [0.01, -3.37, 39.8])
def test_both_heard_the_same(tmp_path: Path, offset: float) -> None:
    """The right camera began `offset` earlier; its clock is ahead by so much."""
    begin = 45.0
    left = write_filmed(tmp_path / "l.mp4", still(20), 2, sound(begin, 20, knocks(100), 1))
    right = write_filmed(tmp_path / "r.mp4", still(20 + max(offset, 0)), 2,
                         sound(begin - offset, 20 + max(offset, 0), knocks(100), 2))  # fmt: skip
    found = find_sound_lag(left, right, 60.0)
    assert found is not None
    assert abs(found.offset_s - offset) < max(0.005, 3 * found.sigma_s)
    assert abs(found.offset_s - offset) < 0.01


def test_a_clock_that_drifts(tmp_path: Path) -> None:
    """30 against 29.97 Hz told wrong: a thousandth."""
    left = write_filmed(tmp_path / "l.mp4", still(120), 2, sound(30, 120, knocks(200), 1))
    right = write_filmed(tmp_path / "r.mp4", still(125), 2, sound(28.5, 125, knocks(200), 2, drift=1e-3))
    found = find_sound_lag(left, right, 60.0)
    assert found is not None
    assert found.drift == pytest.approx(1e-3, abs=1e-4)
    assert found.offset_s == pytest.approx(1.5, abs=0.02)


def test_other_sounds_tell_nothing(tmp_path: Path) -> None:
    left = write_filmed(tmp_path / "l.mp4", still(20), 2, sound(0, 20, knocks(30), 1))
    for seed, events in ((2, knocks(30, 7)), (3, knocks(30, 8)), (4, [9.0]), (5, [])):
        right = write_filmed(tmp_path / "r.mp4", still(20), 2, sound(0, 20, events, seed))
        assert find_sound_lag(left, right, 60.0) is None


def test_one_event_is_not_enough(tmp_path: Path) -> None:
    """A loud knock in each, of which nobody knows that it is the same."""
    left = write_filmed(tmp_path / "l.mp4", still(20), 2, sound(0, 20, [4.0], 1))
    right = write_filmed(tmp_path / "r.mp4", still(20), 2, sound(0, 20, [12.0], 2))
    assert find_sound_lag(left, right, 60.0) is None


def clock_of(folder: Path, left: Path, right: Path) -> tuple[float, str]:
    with Video(left) as one, Video(right) as other:
        clock = find_clock(one, other, one.times(), other.times(), None)
    return clock.offset_ns / 1e9, "; ".join(clock.told)


def test_where_the_images_do_not_tell_the_sound_does(tmp_path: Path) -> None:
    left = write_filmed(tmp_path / "l.mp4", still(12), 2, sound(10, 12, knocks(40), 1))
    right = write_filmed(tmp_path / "r.mp4", still(14), 2, sound(8.6, 14, knocks(40), 2))
    offset, told = clock_of(tmp_path, left, right)
    assert offset == pytest.approx(1.4, abs=0.02)
    assert "sound alone" in told


@pytest.mark.slow
@pytest.mark.parametrize(("heard_at", "events", "said"), [
    (8.6, 1, "the sound agrees"), (5.0, 1, "the sound CONTRADICTS"), (8.6, 9, "the sound does not tell"),
])  # fmt: skip
def test_images_are_believed_and_the_sound_is_told(tmp_path: Path, heard_at: float, events: int, said: str) -> None:
    left = write_filmed(tmp_path / "l.mp4", swaying(10, 10, 14), 10, sound(10, 14, knocks(60), 1))
    right = write_filmed(tmp_path / "r.mp4", swaying(8.6, 10, 16), 10, sound(heard_at, 16, knocks(60, events), 2))
    assert has_sound(left)
    offset, told = clock_of(tmp_path, left, right)
    assert offset == pytest.approx(1.4, abs=0.05)
    assert said in told
