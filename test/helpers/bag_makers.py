"""Bags of every form, made by other programs' writers where there are any, and ways to damage them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml
from mcap.writer import CompressionType, IndexType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.model import RawMessage
from uw_recon_ros.types import CameraModel

IMAGE = "sensor_msgs/msg/Image"
MS = 1_000_000


def camera(width: int = 16, height: int = 12, tx: float = 0.0) -> CameraModel:
    k = np.array([[20.0, 0.0, 8.0], [0.0, 20.0, 6.0], [0.0, 0.0, 1.0]])
    p = np.hstack([k, [[20.0 * tx], [0.0], [0.0]]])
    return CameraModel(width, height, k, np.zeros(5), np.eye(3), p, "plumb_bob", "left_optical_frame")


def image_bytes(seed: int, stamp_ns: int, shape: tuple[int, ...] = (12, 16, 3)) -> bytes:
    image = np.random.default_rng(seed).integers(0, 256, shape, dtype=np.uint8)
    return messages.encode(messages.image_message(image, time_ns=stamp_ns, frame_id="left_optical_frame"))[1]


def recording(frames: int = 40, shape: tuple[int, ...] = (12, 16, 3), topics: Sequence[str] = ()) -> list[RawMessage]:
    """Left and right images at 10 Hz, recorded 2 and 3 ms after they were taken."""
    topics = topics or ("/left/image_raw", "/right/image_raw")
    return [
        RawMessage(topic, IMAGE, (100 * i + 2 + side) * MS, image_bytes(2 * i + side, 100 * i * MS, shape))
        for i in range(frames)
        for side, topic in enumerate(topics)
    ]


def write_mcap(
    path: Path,
    recorded: Sequence[RawMessage],
    compression: CompressionType = CompressionType.ZSTD,
    *,
    index: bool = True,
    chunked: bool = True,
    crc: bool = True,
    finish: bool = True,
    chunk_size: int = 4000,
    repeat: bool = True,
) -> Path:
    """Write with mcap's own writer; `finish` False leaves it as a crash does."""
    kinds = IndexType.ALL if index else IndexType.NONE
    with path.open("wb") as stream:
        writer = McapWriter(
            stream, chunk_size, compression, kinds, repeat, repeat, chunked, index, index, crc,
        )  # fmt: skip
        writer.start("ros2", "test")
        channels: dict[str, int] = {}
        for message in recorded:
            if message.topic not in channels:
                text = messages.typestore().generate_msgdef(message.type, ros_version=2)[0].encode()
                schema = writer.register_schema(message.type, "ros2msg", text)
                channels[message.topic] = writer.register_channel(message.topic, "cdr", schema)
            writer.add_message(channels[message.topic], message.log_ns, message.data, message.log_ns)
        if finish:
            writer.finish()
    return path


def write_rosbags(
    path: Path,
    recorded: Sequence[RawMessage],
    plugin: StoragePlugin = StoragePlugin.SQLITE3,
    mode: CompressionMode = CompressionMode.NONE,
) -> Path:
    writer = RosbagsWriter(path, version=8, storage_plugin=plugin)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        connections = {
            topic: writer.add_connection(topic, IMAGE, typestore=messages.typestore())
            for topic in dict.fromkeys(message.topic for message in recorded)
        }
        for message in recorded:
            writer.write(connections[message.topic], message.log_ns, message.data)
    return path


def write_split(path: Path, parts: Sequence[Sequence[RawMessage]]) -> Path:
    """A folder of several MCAP files, as ``ros2 bag record --max-bag-duration`` leaves."""
    path.mkdir()
    names = [write_mcap(path / f"{path.name}_{i}.mcap", part).name for i, part in enumerate(parts)]
    information = {"version": 8, "storage_identifier": "mcap", "relative_file_paths": names, "compression_mode": ""}
    (path / "metadata.yaml").write_text(yaml.safe_dump({"rosbag2_bagfile_information": information}))
    return path


def cut(path: Path, share: float) -> Path:
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    return path


def chunk_offsets(data: bytes) -> list[tuple[int, int]]:
    """Content offset and length of the chunks of an MCAP file: an oracle of twenty lines less than the reader."""
    offset, found = 8, []
    while offset + 9 <= len(data):
        opcode, length = struct.unpack_from("<BQ", data, offset)
        if opcode == 6:
            found.append((offset + 9, length))
        offset += 9 + length
    return found


def flip(path: Path, places: Sequence[int], mask: int = 0xFF) -> Path:
    data = bytearray(path.read_bytes())
    for place in places:
        data[place] ^= mask
    path.write_bytes(bytes(data))
    return path


def summary_records(data: bytes) -> list[tuple[int, int, int]]:
    """Opcode, content offset and length of the records after the end of the data section."""
    offset, found, summary = 8, [], False
    while offset + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, offset)
        if summary:
            found.append((opcode, offset + 9, length))
        summary |= opcode == 15
        offset += 9 + length
    return found
