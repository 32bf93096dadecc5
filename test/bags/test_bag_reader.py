"""Bags of every form give the messages that were written, in the order of time."""

from __future__ import annotations

import tracemalloc
from pathlib import Path

import numpy as np
import pytest
import yaml
from helpers.bag_makers import IMAGE, MS, camera, recording, write_mcap, write_rosbags, write_split
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from uw_recon_ros.bags import (
    BagWriter,
    QosProfile,
    RawMessage,
    TopicInfo,
    find_stereo_topics,
    messages,
    open_bag,
)  # fmt: skip
from uw_recon_ros.bags.merge import merge_by_time
from uw_recon_ros.bags.model import parse_qos
from uw_recon_ros.errors import BagError
from uw_recon_ros.recordings.info import bag_info


def read_all(path: Path, topics: list[str] | None = None) -> list[RawMessage]:
    with open_bag(path) as bag:
        found = list(bag.raw_messages(topics))
        assert bag.damage == []
    return found


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize(
    "form", [{}, {"index": False}, {"chunked": False}, {"chunked": False, "index": False}, {"repeat": False}]
)
def test_bare_mcap_files_of_every_form(tmp_path: Path, compression: CompressionType, form: dict[str, bool]) -> None:
    recorded = recording()
    path = write_mcap(tmp_path / "a.mcap", recorded, compression, **form)
    assert read_all(path) == recorded
    with open_bag(path) as bag:
        assert [(t.name, t.type, t.count) for t in bag.topics] == [
            ("/left/image_raw", IMAGE, 40), ("/right/image_raw", IMAGE, 40),
        ]  # fmt: skip
        assert (bag.start_ns, bag.end_ns) == (2 * MS, 3903 * MS)


@pytest.mark.parametrize(
    ("plugin", "mode"),
    [
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
    ],
)
def test_folders_as_rosbags_writes_them(tmp_path: Path, plugin: StoragePlugin, mode: CompressionMode) -> None:
    recorded = recording()
    path = write_rosbags(tmp_path / "bag", recorded, plugin, mode)
    assert read_all(path) == recorded
    with AnyReader([path]) as oracle:
        assert [(c.topic, c.msgtype, t, bytes(d)) for c, t, d in oracle.messages()] == [
            (m.topic, m.type, m.log_ns, m.data) for m in recorded
        ]


def test_a_bare_database_is_a_bag(tmp_path: Path) -> None:
    recorded = recording(5)
    assert read_all(write_rosbags(tmp_path / "bag", recorded) / "bag.db3") == recorded


def test_split_bags_are_one(tmp_path: Path) -> None:
    recorded = recording()
    path = write_split(tmp_path / "split", [recorded[:30], recorded[30:50], recorded[50:]])
    assert read_all(path) == recorded
    with open_bag(path) as bag:
        assert [t.count for t in bag.topics] == [40, 40]


def test_topics_are_filtered(tmp_path: Path) -> None:
    recorded = recording()
    for path in (write_mcap(tmp_path / "a.mcap", recorded), write_rosbags(tmp_path / "bag", recorded)):
        assert read_all(path, ["/right/image_raw"]) == recorded[1::2]
        assert read_all(path, ["/none"]) == []


@pytest.mark.parametrize("index", [True, False])
@pytest.mark.parametrize("chunked", [True, False])
def test_messages_recorded_out_of_order_come_in_order(tmp_path: Path, index: bool, chunked: bool) -> None:
    recorded = recording()
    shuffled = [recorded[(i * 7) % len(recorded)] for i in range(len(recorded))]
    path = write_mcap(tmp_path / "a.mcap", shuffled, index=index, chunked=chunked)
    assert read_all(path) == recorded


def test_a_database_recorded_out_of_order_comes_in_order(tmp_path: Path) -> None:
    recorded = recording()
    shuffled = [recorded[(i * 7) % len(recorded)] for i in range(len(recorded))]
    assert read_all(write_rosbags(tmp_path / "bag", shuffled)) == recorded


def test_a_bag_can_be_read_twice_at_once(tmp_path: Path) -> None:
    recorded = recording()
    for path in (write_mcap(tmp_path / "a.mcap", recorded), write_rosbags(tmp_path / "bag", recorded)):
        with open_bag(path) as bag:
            pairs = list(zip(bag.raw_messages(), bag.raw_messages(), strict=True))
        assert all(a == b for a, b in pairs)


def test_memory_does_not_grow_with_the_bag(tmp_path: Path) -> None:
    recorded = recording(120, (60, 80, 3))
    total = sum(len(message.data) for message in recorded)
    path = write_mcap(tmp_path / "a.mcap", recorded, chunk_size=100_000)
    del recorded
    tracemalloc.start()
    with open_bag(path) as bag:
        assert sum(len(message.data) for message in bag.raw_messages()) == total
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < total / 4


def test_sources_wait_unopened_until_their_turn() -> None:
    opened: list[int] = []

    def source(start: int) -> tuple[int, object]:
        def read():  # type: ignore[no-untyped-def]
            opened.append(start)
            yield from (RawMessage("t", "x", start + i, b"") for i in range(3))

        return start, read

    merged = merge_by_time([source(0), source(2), source(100)])  # type: ignore[list-item]
    assert [next(merged).log_ns for _ in range(5)] == [0, 1, 2, 2, 3]
    assert opened == [0, 2]
    assert [message.log_ns for message in merged] == [4, 100, 101, 102]


def test_equal_times_keep_the_order_of_the_sources() -> None:
    def source(name: str, *stamps: int) -> tuple[int, object]:
        return stamps[0], lambda: iter([RawMessage(name, "x", stamp, b"") for stamp in stamps])

    merged = merge_by_time([source("c", 5, 6), source("a", 0, 5, 6), source("b", 5, 5, 6)])  # type: ignore[list-item]
    assert [(m.log_ns, m.topic) for m in merged] == [
        (0, "a"), (5, "c"), (5, "a"), (5, "b"), (5, "b"), (6, "c"), (6, "a"), (6, "b"),
    ]  # fmt: skip


def test_offered_qos_is_read_in_both_spellings() -> None:
    numbers = "- {history: 1, depth: 5, reliability: 2, durability: 1, deadline: {sec: 0, nsec: 0}}"
    names = [{"history": "keep_last", "depth": 5, "reliability": "best_effort", "durability": "transient_local"}]
    expected = (QosProfile("keep_last", 5, "best_effort", "transient_local"),)
    assert parse_qos(numbers) == expected
    assert parse_qos(names) == expected
    assert parse_qos("- {history: 0, depth: 0, reliability: 9}") == (QosProfile(),)
    assert parse_qos("{[") == parse_qos("") == parse_qos("just text") == ()


def test_offered_qos_survives_a_bag(tmp_path: Path) -> None:
    latched = QosProfile(depth=1, durability="transient_local")
    with BagWriter(tmp_path / "bag") as writer:
        writer.raw(recording(1)[0], [latched])
    with open_bag(tmp_path / "bag") as bag:
        assert bag.topics[0].qos == (latched,)


def test_pairs_are_decoded_with_their_calibration(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for message in recording(6):
            writer.raw(message)
        for side, tx in (("left", 0.0), ("right", -0.1)):  # recorded after the last image
            writer.camera_info(
                f"/{side}/camera_info", camera(tx=tx), time_ns=999 * MS, frame_id=f"{side}_optical_frame"
            )
    with open_bag(tmp_path / "bag") as bag:
        pairs = list(bag.stereo_pairs())
    assert [pair.stamp_ns for pair in pairs] == [100 * i * MS for i in range(6)]
    for pair in pairs:
        assert pair.left.shape == (12, 16, 3)
        assert (pair.left != pair.right).any()
        assert pair.frame_id == "left_optical_frame"
        assert pair.calibration is not None
        assert pair.calibration.right.p[0, 3] == pytest.approx(-2.0)


def test_only_equal_stamps_pair_unless_a_tolerance_is_given(tmp_path: Path) -> None:
    from helpers.bag_makers import image_bytes

    recorded = [RawMessage("/left/image_raw", IMAGE, 100 * i * MS, image_bytes(i, 100 * i * MS)) for i in range(5)]
    recorded += [
        RawMessage("/right/image_raw", IMAGE, (100 * i + 3) * MS, image_bytes(9, (100 * i + 3) * MS)) for i in range(5)
    ]
    path = write_mcap(tmp_path / "a.mcap", recorded)
    with open_bag(path) as bag:
        assert list(bag.stereo_pairs()) == []
        assert [p.stamp_ns for p in bag.stereo_pairs(tolerance_ns=3 * MS)] == [100 * i * MS for i in range(5)]


def test_a_calibration_that_changes_is_followed(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for index, message in enumerate(recording(4)):
            if index in (0, 4):
                for side, tx in (("left", 0.0), ("right", -0.1 - 0.05 * index)):
                    writer.camera_info(f"/{side}/camera_info", camera(tx=tx), time_ns=message.log_ns, frame_id="x")
            writer.raw(message)
    with open_bag(tmp_path / "bag") as bag:
        shifts = [pair.calibration.right.p[0, 3] for pair in bag.stereo_pairs() if pair.calibration]
    assert shifts == pytest.approx([-2.0, -2.0, -6.0, -6.0])
    assert "CameraInfo changes 1 times" in bag_info(tmp_path / "bag").warnings


def test_empty_and_derived_topics_are_not_the_cameras() -> None:
    def topics(*names: str, count: int = 5, kind: str = "Image") -> list[TopicInfo]:
        return [
            TopicInfo(f"/{side}/{name}", f"sensor_msgs/msg/{kind}", count)
            for name in names
            for side in ("left", "right")
        ]

    compressed = topics("image_raw/compressed", kind="CompressedImage")
    found = find_stereo_topics(topics("image_raw", count=0) + compressed)
    assert found.left == "/left/image_raw/compressed"
    assert find_stereo_topics(topics("image_raw") + compressed).left == "/left/image_raw"
    infos = [TopicInfo(f"/{side}/camera_info", "sensor_msgs/msg/CameraInfo", 5) for side in ("left", "right")]
    found = find_stereo_topics(compressed + infos)
    assert (found.left_info, found.right_info) == ("/left/camera_info", "/right/camera_info")
    assert find_stereo_topics(topics("image_rect") + topics("image_color")).left == "/left/image_color"
    assert find_stereo_topics(topics("image_rect_color")).left == "/left/image_rect_color"
    for name in ("depth/image", "matching/image", "disparity"):
        with pytest.raises(BagError, match="no stereo pair"):
            find_stereo_topics(topics(name))


@pytest.mark.parametrize(("dtype", "unit"), [("float32", 1.0), ("uint16", 0.001)])
def test_depth_in_metres_and_millimetres(tmp_path: Path, dtype: str, unit: float) -> None:
    values = np.array([[0.0, 1.5, 2.25]]) / unit
    message = messages.image_message(values.astype(dtype), time_ns=7, frame_id="x")
    message.encoding = "16UC1" if dtype == "uint16" else "32FC1"
    other = messages.image_message(np.zeros((2, 2), np.uint8), time_ns=8, frame_id="x")
    with BagWriter(tmp_path / "bag") as writer:
        writer.message("/truth/depth", message)
        writer.message("/truth/depth", other)
    with open_bag(tmp_path / "bag") as bag:
        ((stamp, depth),) = bag.depth_images()
        assert bag.damage == ["/truth/depth: depth: expected 32FC1 or 16UC1, got 'mono8'"]
    assert stamp == 7
    assert depth[0] == pytest.approx([np.nan, 1.5, 2.25], nan_ok=True)


@pytest.mark.parametrize(
    ("topics", "expected"),
    [
        (["/left/image_raw", "/right/image_raw"], ("/left/image_raw", "/right/image_raw")),
        (["/rig/right/image_raw", "/rig/left/image_raw"], ("/rig/left/image_raw", "/rig/right/image_raw")),
        (["/cam0/image_raw", "/cam1/image_raw"], ("/cam0/image_raw", "/cam1/image_raw")),
        (["/camera_left/image", "/camera_right/image"], ("/camera_left/image", "/camera_right/image")),
        (
            ["/left/image_rect", "/right/image_rect", "/left/image_mono", "/right/image_mono"],
            ("/left/image_mono", "/right/image_mono"),
        ),
        (
            ["/left/image_color", "/right/image_color", "/left/image_raw", "/right/image_raw"],
            ("/left/image_raw", "/right/image_raw"),
        ),
    ],
)
def test_the_cameras_are_found_by_name(tmp_path: Path, topics: list[str], expected: tuple[str, str]) -> None:
    path = write_mcap(tmp_path / "a.mcap", recording(2, topics=topics))
    with open_bag(path) as bag:
        found = bag.stereo_topics()
    assert (found.left, found.right) == expected


def test_the_cameras_can_be_named(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", recording(2, topics=["/bow/image_raw", "/stern/image_raw"]))
    with open_bag(path) as bag:
        with pytest.raises(BagError, match=r"no stereo pair: .*got /bow/image_raw \(2\), /stern/image_raw \(2\)"):
            bag.stereo_topics()
        assert len(list(bag.stereo_pairs("bow/image_raw", "/stern/image_raw"))) == 2
        with pytest.raises(BagError, match=r"topic /keel: expected an image topic of the bag, it has /bow/image_raw"):
            bag.stereo_pairs("/keel", "/stern")


def test_one_camera_missing_is_said(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", recording(2, topics=["/left/image_raw"]))
    with open_bag(path) as bag, pytest.raises(BagError, match=r"left and a right camera, got /left/image_raw \(2\)"):
        bag.stereo_pairs()


def test_the_path_of_a_file_in_the_metadata_never_leads_out(tmp_path: Path) -> None:
    write_mcap(tmp_path / "secret.mcap", recording(2))
    bag = write_split(tmp_path / "bag", [recording(3)])
    text = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").write_text(text.replace("bag_0.mcap", "../secret.mcap"))
    with pytest.raises(BagError, match="none of the 1 files named in metadata"):
        open_bag(bag)


def test_what_cannot_be_opened_says_why(tmp_path: Path) -> None:
    cases = {"empty.mcap": b"", "text.mcap": b"hello world, no bag", "old.bag": b"#ROSBAG V2.0\n123"}
    expected = {"empty.mcap": "got an empty file", "text.mcap": "got a text file", "old.bag": "a ROS 1 bag"}
    for name, data in cases.items():
        (tmp_path / name).write_bytes(data)
        with pytest.raises(BagError, match=expected[name]) as caught:
            open_bag(tmp_path / name)
        assert "\n" not in str(caught.value)
    (tmp_path / "folder").mkdir()
    with pytest.raises(BagError, match=r"got a folder without \.mcap or \.db3 files"):
        open_bag(tmp_path / "folder")
    with pytest.raises(BagError, match="there is no such file or folder"):
        open_bag(tmp_path / "nothing")


def test_foreign_serialisation_is_left_out_and_said(tmp_path: Path) -> None:
    from mcap.writer import Writer

    with (tmp_path / "a.mcap").open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        schema = writer.register_schema("foo.Bar", "protobuf", b"")
        channel = writer.register_channel("/proto", "protobuf", schema)
        writer.add_message(channel, 1, b"abc", 1)
        writer.finish()
    with open_bag(tmp_path / "a.mcap") as bag:
        assert bag.topics == []
        assert list(bag.raw_messages()) == []
        assert bag.damage == ["a.mcap: topic /proto is left out: protobuf is not CDR"]


def test_folder_metadata_is_plain_rosbag2_version_8(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as writer:
        for message in recording(2):
            writer.raw(message)
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    assert information["version"] == 8
    assert information["storage_identifier"] == "mcap"
    assert information["compression_mode"] == ""
    assert information["relative_file_paths"] == ["bag.mcap"]
    hashes = {t["topic_metadata"]["type_description_hash"] for t in information["topics_with_message_count"]}
    assert hashes == {"RIHS01_d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47"}
