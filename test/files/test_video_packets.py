"""Packets of video: what comes out is the packet's own image, or nothing, with the reason."""

from __future__ import annotations

import contextlib
import os
import sys

import numpy as np
import pytest
from helpers.videos import Image, packets, texture
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.video_packets import PacketDecoder, codec_named, is_key
from uw_recon_ros.findings import Code

CODECS = ("h264", "h265", "vp9", "av1")
GROUND = texture(5, (400, 600), 3.0)
MS = 1_000_000


def moving(count: int, shape: tuple[int, int] = (96, 128)) -> list[Image]:
    """A camera over the ground, 7 px an image."""
    return [np.ascontiguousarray(GROUND[3 * n : 3 * n + shape[0], 7 * n : 7 * n + shape[1]]) for n in range(count)]


def decoder(codec: str) -> PacketDecoder:
    return PacketDecoder(str(codec_named(codec)))


def shown(made: PacketDecoder, stream: list[bytes | None]) -> list[Image | ImageError | None]:
    """What comes of each packet; None for those that are lost."""
    found: list[Image | ImageError | None] = []
    for number, data in enumerate(stream):
        if data is None:
            found.append(None)
            continue
        try:
            found.append(made.decode(data, (10 + number) * 100 * MS))
        except ImageError as error:
            found.append(error)
    return found


def is_of(image: object, expected: Image) -> bool:
    return isinstance(image, np.ndarray) and np.abs(image.astype(float) - expected).mean() < 7


IMAGES = moving(12)


@pytest.mark.parametrize("codec", CODECS)
def test_each_packet_gives_its_own_image(codec: str) -> None:
    stream = packets(IMAGES, codec)
    assert [is_key(data, str(codec_named(codec))) for data in stream] == [n % 4 == 0 for n in range(12)]
    assert all(map(is_of, shown(decoder(codec), stream), IMAGES))


@pytest.mark.parametrize("codec", CODECS)
@pytest.mark.parametrize("lost", [1, 2, 3, 4, 5])
def test_after_a_lost_packet_nothing_comes_until_the_next_key_frame(codec: str, lost: int) -> None:
    if codec in ("vp9", "av1") and lost == 1:
        pytest.skip("how far apart its packets are is not known yet")
    stream: list[bytes | None] = [*packets(IMAGES, codec)]
    stream[lost] = None
    found = shown(decoder(codec), stream)
    until = lost if lost % 4 == 3 else 8 if lost >= 4 else 4
    for n, image in enumerate(found):
        if n == lost:
            continue
        if lost < n < until:
            assert isinstance(image, ImageError), n
            assert image.code in (Code.VIDEO_AWAITS_KEY_FRAME, Code.VIDEO_DECODE)
        else:
            assert is_of(image, IMAGES[n]), n


@pytest.mark.parametrize("codec", CODECS)
def test_joined_in_the_middle_it_waits_for_a_key_frame_and_says_so(codec: str) -> None:
    stream: list[bytes | None] = [None, None, *packets(IMAGES, codec)[2:]]
    found = shown(decoder(codec), stream)
    for image in found[2:4]:
        assert isinstance(image, ImageError)
        assert image.code == Code.VIDEO_AWAITS_KEY_FRAME
        assert "no image until the next key frame: no key frame has come yet" in str(image)
    assert all(map(is_of, found[4:], IMAGES[4:]))


@pytest.mark.parametrize("codec", ["h264", "av1"])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_a_packet_cut_short_spoils_nothing_after_the_next_key_frame(codec: str, share: float) -> None:
    stream: list[bytes | None] = [*packets(IMAGES, codec)]
    stream[1] = stream[1][: int(share * len(stream[1]))]  # type: ignore[index, arg-type]
    found = shown(decoder(codec), stream)
    assert is_of(found[0], IMAGES[0])
    assert all(isinstance(image, ImageError) for image in found[1:4])
    assert all(map(is_of, found[4:], IMAGES[4:]))


@pytest.mark.parametrize(
    "options",
    [
        {"preset": "medium", "profile": "high"},
        {"preset": "medium", "x264-params": "cqm=jvt:bframes=0:rc-lookahead=0"},
        {"preset": "medium", "slices": "3", "x264-params": "slices=3"},
        {"preset": "medium", "refs": "4"},
    ],
    ids=["high", "scaling lists", "slices", "references"],
)
def test_numbers_of_h264_are_read_whatever_the_encoder_was_told(options: dict[str, str]) -> None:
    images = moving(40)
    stream: list[bytes | None] = [*packets(images, "h264", every=40, **options)]
    assert all(map(is_of, shown(decoder("h264"), stream), images))
    stream[30] = None
    found = shown(decoder("h264"), stream)
    assert all(isinstance(image, ImageError) for image in found[31:])
    assert "a packet is missing" in str(found[31])


def test_frames_out_of_order_are_never_taken_for_others() -> None:
    stream: list[bytes | None] = [*packets(moving(24), "h264", every=24, preset="medium", tune="film", bf="2")]
    for n, image in enumerate(shown(decoder("h264"), stream)):
        assert isinstance(image, ImageError) or is_of(image, moving(24)[n]), n


@pytest.mark.parametrize("codec", CODECS)
def test_another_resolution_from_a_key_frame_on(codec: str) -> None:
    large = moving(4, (128, 192))
    stream: list[bytes | None] = [*packets(IMAGES[:4], codec), *packets(large, codec)]
    assert all(map(is_of, shown(decoder(codec), stream), [*IMAGES[:4], *large]))


@pytest.mark.parametrize("codec", CODECS)
def test_larger_images_than_allowed_are_not_decoded(codec: str) -> None:
    made = PacketDecoder(str(codec_named(codec)), 96 * 128 - 1)
    with pytest.raises(ImageError, match=r"expected at most 12287 px, got 128x96|damaged or missing"):
        made.decode(packets(IMAGES, codec)[0], 0)


@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data())
def test_damaged_packets_raise_image_errors_only(data: st.DataObject) -> None:
    codec = data.draw(st.sampled_from(CODECS))
    stream = _kept(codec)
    place = data.draw(st.integers(0, len(stream) - 1))
    damaged = bytearray(stream[place])
    for _ in range(data.draw(st.integers(1, 8))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    shown(decoder(codec), [*stream[:place], bytes(damaged), data.draw(st.binary(max_size=40)), *stream[place + 1 :]])


_STREAMS: dict[str, list[bytes]] = {}


def _kept(codec: str) -> list[bytes]:
    if codec not in _STREAMS:
        _STREAMS[codec] = packets(IMAGES[:5], codec)
    return _STREAMS[codec]


def test_what_a_stream_says_of_itself_costs_little() -> None:
    """Of strangers: millions of units in a packet, numbers of any size where a few bits are usual."""
    stream = packets(IMAGES, "h264")
    for data in (b"\0\0\1" * 2_000_000, b"\x0a\0" * 2_000_000):
        assert not any(is_key(data, codec) for codec in ("h264", "hevc", "vp9")) or data[0]
        is_key(data, "libdav1d")
    endless = b"\0\0\1\x67\x42\0\x1e\x80" + bytes([0, 0, 3] * 100) + b"\xff" * 150
    wide = b"\0\0\1\x67\x42\0\x1e\x80\x00\x00\x3f\xff" + b"\xff" * 60
    for header in (endless, wide):
        made = decoder("h264")
        for n, data in enumerate((header + stream[0], stream[1], stream[2])):
            with contextlib.suppress(ImageError):
                made.decode(data, n * 100 * MS)


def test_h264_without_start_codes_is_named() -> None:
    stream = packets(IMAGES, "h264")
    made = decoder("h264")
    made.decode(stream[0], 0)
    with pytest.raises(ImageError, match=r"expected start codes \(Annex B\), got none"):
        made.decode(len(stream[1]).to_bytes(4, "big") + stream[1][4:], 100 * MS)


def test_without_pyav_the_way_out_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "av", None)
    with pytest.raises(BagError, match=r"pip install '\.\[video\]'") as error:
        decoder("h264")
    assert error.value.code == Code.RECORDING_EXTRA


def test_making_packets_leaves_the_scheduler_alone() -> None:
    """An encoder had made all that later tests started real-time processes: a machine that stood still."""
    before = os.sched_getscheduler(0)
    packets([np.full((64, 64, 3), 90, np.uint8)], "av1")
    assert os.sched_getscheduler(0) == before
