"""Cameras that send video, live: H.264 and H.265 in CompressedImage through real ROS; other types as bags have them."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pytest
from helpers.ros_bench import FRAME, Bench, color
from helpers.videos import Image as Picture
from helpers.videos import packets, texture
from sensor_msgs.msg import CompressedImage, Image

from uw_recon_ros.bags import messages as bag_messages
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.video_packets import PacketDecoder, codec_named
from uw_recon_ros.messages.headers import received_stamp_ns
from uw_recon_ros.nodes.preprocess_node import CAMERAS, PreprocessNode
from uw_recon_ros.preprocess.sequence import PreprocessSequence
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.video import VideoStream
from uw_recon_ros.topics import FFMPEG_PACKET, FOXGLOVE_VIDEO, SIDES
from uw_recon_ros.types import StereoPair

MS = 1_000_000
GROUND = [texture(seed, (300, 400), 3.0) for seed in (1, 2)]
PICTURES = [[np.ascontiguousarray(g[3 * n : 3 * n + 96, 5 * n : 5 * n + 128]) for n in range(12)] for g in GROUND]


def stamp(number: int) -> int:
    return (50 + number) * 100 * MS


def packed(data: bytes, number: int, codec: str) -> CompressedImage:
    message = CompressedImage(header=messages.header(stamp(number), FRAME), format=codec)
    message.data.frombytes(data)
    return message


class Rig:
    """Two cameras that send video to a preprocessing node."""

    def __init__(self, bench: Bench, codec: str = "h264", pictures: list[list[Picture]] = PICTURES) -> None:
        self.codec, self.streams = codec, [packets(one, codec) for one in pictures]
        self.node = bench.start(PreprocessNode)
        self.heard = bench.listen(Image, "left/image_matching")
        self._cameras = [bench.talk(CompressedImage, f"{side}/image_raw/compressed") for side in SIDES]
        self._bench = bench
        bench.connected(*self._cameras)

    def send(self, number: int) -> None:
        """One pair, waited for until it has come out or been dropped."""
        before = len(self.heard) + sum(self.node.diagnostics.drops.values())
        for camera, stream in zip(self._cameras, self.streams, strict=True):
            camera.publish(packed(stream[number], number, self.codec))
        self._bench.spin_until(lambda: len(self.heard) + sum(self.node.diagnostics.drops.values()) > before)

    @property
    def stamps(self) -> list[int]:
        return [messages.stamp_ns(message) for message in self.heard]


@pytest.mark.parametrize("codec", ["h264", "h265"])
def test_video_gives_what_its_images_give_under_their_stamps(bench: Bench, codec: str) -> None:
    rig = Rig(bench, codec)
    for number in range(6):
        rig.send(number)
    assert rig.stamps == [stamp(number) for number in range(6)]
    stage, decoders = PreprocessSequence(PreprocessParams()), [PacketDecoder(str(codec_named(codec))) for _ in SIDES]
    for number, message in enumerate(rig.heard):
        left, right = (d.decode(s[number], stamp(number)) for d, s in zip(decoders, rig.streams, strict=True))
        assert np.abs(left.astype(float) - PICTURES[0][number]).mean() < 7
        expected = stage(StereoPair(left, right), shown=())
        np.testing.assert_array_equal(messages.image_from_message(message), expected.left_matching)


def test_it_waits_for_a_key_frame_and_says_so(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    rig = Rig(bench)
    for number in range(2, 6):
        rig.send(number)
    assert rig.stamps == [stamp(4), stamp(5)]
    assert rig.node.diagnostics.drops == {"ImageError": 2}
    values = {pair.key: pair.value for pair in rig.node.diagnostics.tick("x").values}
    assert values["last drop code"] == "video.awaits_key_frame"
    assert "left image: video (h264): no image until the next key frame" in capfd.readouterr().err


def test_a_lost_packet_costs_the_images_up_to_the_next_key_frame(bench: Bench) -> None:
    rig = Rig(bench)
    for number in (0, 1, 3, 4, 5):
        rig.send(number)
    assert rig.stamps == [stamp(number) for number in (0, 1, 4, 5)]


def test_images_passed_over_are_decoded_where_later_ones_need_them() -> None:
    stream, taken = VideoStream(), []
    for number, data in enumerate(packets(PICTURES[0], "h264")):
        taken.append(stream.take(packed(data, number, "h264"), stamp(number)))
        if number in (2, 3, 7, 10):  # a slow node takes the newest only
            image = taken[number].decode(2**24)
            assert np.abs(image.astype(float) - PICTURES[0][number]).mean() < 7
            assert taken[number].decode(2**24) is image


def test_another_resolution_from_a_key_frame_on(bench: Bench) -> None:
    rig = Rig(bench)
    rig.streams = [[*stream[:4], *packets([np.ascontiguousarray(g[:128, :192])] * 4, "h264")]
                   for stream, g in zip(rig.streams, GROUND, strict=True)]  # fmt: skip
    for number in range(8):
        rig.send(number)
    assert [(m.width, m.height) for m in rig.heard] == [(128, 96)] * 4 + [(192, 128)] * 4


def test_without_pyav_each_pair_is_refused_with_the_way_out(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    rig = Rig(bench)
    monkeypatch.setitem(sys.modules, "av", None)
    rig.send(0)
    assert rig.heard == []
    assert "pip install '.[video]' in the sources' folder" in capfd.readouterr().err


def test_messages_that_are_not_installed_are_named_with_the_way_out(
    bench: Bench, capfd: pytest.CaptureFixture[str]
) -> None:
    topics = {topic.name: topic.type for topic in CAMERAS[0].alternatives}
    if topics["left/image_raw/ffmpeg"] is not None:
        pytest.skip("ffmpeg_image_transport_msgs is installed here")
    bench.start(PreprocessNode, stall_warning_s=0.2)
    bench.listen(Image, "left/image_matching")
    cameras = [bench.talk(CompressedImage, f"{side}/image_raw/ffmpeg") for side in SIDES]
    bench.spin_for(1.0)
    assert not any(camera.get_subscription_count() for camera in cameras)
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "waiting for" in line]
    assert "ffmpeg_image_transport_msgs is not installed: apt install ros-" in line
    assert "-ffmpeg-image-transport-msgs" in line


def test_video_of_one_camera_and_raw_images_of_the_other(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_matching")
    left, right = bench.talk(CompressedImage, "left/image_raw/compressed"), bench.talk(Image, "right/image_raw")
    bench.connected(left, right)
    left.publish(packed(packets(PICTURES[0], "h264")[0], 0, "h264"))
    right.publish(color(PICTURES[1][0], stamp(0)))
    bench.spin_until(lambda: heard or node.diagnostics.drops)
    assert node.diagnostics.drops == {}


# ---- types that are not installed where tests run: as bags have them ------------------------------------------------


def made(kind: str, data: bytes, number: int, codec: str) -> Any:
    head = bag_messages.MAKE("std_msgs/msg/Header", stamp=_time(stamp(number)), frame_id=FRAME)
    content = np.frombuffer(data, np.uint8)
    if kind == FOXGLOVE_VIDEO:
        return bag_messages.MAKE(kind, timestamp=head.stamp, frame_id=FRAME, data=content, format=codec)
    return bag_messages.MAKE(kind, header=head, width=128, height=96, encoding=codec, pts=number, data=content)


def _time(time_ns: int) -> Any:
    return bag_messages.MAKE("builtin_interfaces/msg/Time", sec=time_ns // 10**9, nanosec=time_ns % 10**9)


@pytest.mark.parametrize("kind", [FOXGLOVE_VIDEO, FFMPEG_PACKET])
@pytest.mark.parametrize("told", ["h264", "h265", "hevc;yuv420p;bgr8;bgr8"])
def test_packets_of_other_types(kind: str, told: str) -> None:
    codec = "h264" if told == "h264" else "h265"
    stream = VideoStream()
    for number, data in enumerate(packets(PICTURES[0], codec)):
        message = made(kind, data, number, told)
        taken = stream.take(message, received_stamp_ns(message))
        assert (messages.stamp_ns(taken), taken.header.frame_id) == (stamp(number), FRAME)
        assert np.abs(taken.decode(2**24).astype(float) - PICTURES[0][number]).mean() < 7


@pytest.mark.parametrize("kind", [FOXGLOVE_VIDEO, FFMPEG_PACKET])
@pytest.mark.parametrize("told", ["mjpeg", "", "png"])
def test_codecs_that_are_not_known_are_named(kind: str, told: str) -> None:
    with pytest.raises(ImageError, match=f"expected h264, h265, vp9 or av1, got '{told}'"):
        VideoStream().take(made(kind, b"\0", 0, told), 0)


def test_a_stream_without_another_key_frame_is_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("uw_recon_ros.ros.video._MOST_PACKETS", 6)
    stream = VideoStream()
    taken = [stream.take(packed(d, n, "h264"), stamp(n)) for n, d in enumerate(packets(PICTURES[0], "h264", every=99))]
    with pytest.raises(ImageError, match="given up, too many came"):
        taken[2].decode(2**24)
    with pytest.raises(ImageError, match="no image until the next key frame"):
        taken[-1].decode(2**24)


def test_what_came_before_the_last_key_frames_is_forgotten() -> None:
    stream = VideoStream()
    taken = [stream.take(packed(d, n, "h264"), stamp(n)) for n, d in enumerate(packets(PICTURES[0], "h264"))]
    assert np.abs(taken[6].decode(2**24).astype(float) - PICTURES[0][6]).mean() < 7  # waits for its partner
    with pytest.raises(ImageError, match="given up"):
        taken[2].decode(2**24)
