"""What looking at a hostile bag costs: records and memory in proportion to the file; what was not read is said."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import pytest
import zstandard
from helpers.bag_makers import recording, write_mcap
from helpers.bag_mutants import CHANNEL, CHUNK, CHUNK_INDEX, MESSAGE, SCHEMA, STATISTICS, chunk, joined, string

from uw_recon_ros.bags import mcap_index, open_bag
from uw_recon_ros.bounds import BYTES_PER_STEP, MOST_QOS_TEXT, MOST_UNPACKED, SPARE_BYTES, SPARE_STEPS, Budget

CHILD = """
import json, resource, sys
from uw_recon_ros.files import strict_yaml
from uw_recon_ros.bags import mcap_chunk
from uw_recon_ros.recordings.info import bag_info
from uw_recon_ros.errors import BagError
count, parsed = [0], [0]
records, load = mcap_chunk.records, strict_yaml.load
def counted(data):
    for record in records(data):
        count[0] += 1
        yield record
def parsing(text):
    parsed[0] += len(text)
    return load(text)
mcap_chunk.records, strict_yaml.load = counted, parsing
bag_info(sys.argv[1])
count[0] = parsed[0] = 0
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    told = list(bag_info(sys.argv[2]).damage)
except BagError as error:
    told = [str(error)]
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(json.dumps(dict(told=told, records=count[0], parsed=parsed[0], grown=1024 * grown)))
"""
IMAGES = (b"/left/image_raw", b"/right/image_raw")


def record(opcode: int, content: bytes = b"") -> bytes:
    return struct.pack("<BQ", opcode, len(content)) + content


def message(channel: int, time_ns: int, size: int = 0) -> bytes:
    return record(MESSAGE, struct.pack("<HIQQ", channel, 0, time_ns, time_ns) + bytes(size))


def channel(number: int, topic: bytes, qos: bytes = b"") -> tuple[int, bytes]:
    metadata = string(b"offered_qos_profiles") + string(qos)
    content = struct.pack("<HH", number, 1) + string(topic) + string(b"cdr")
    return CHANNEL, content + struct.pack("<I", len(metadata)) + metadata


def described() -> list[tuple[int, bytes]]:
    schema = struct.pack("<H", 1) + string(b"sensor_msgs/msg/Image") + string(b"ros2msg") + string(b"")
    return [(1, string(b"ros2") + string(b"")), (SCHEMA, schema), *(channel(i, name) for i, name in enumerate(IMAGES))]


def packed(inside: bytes, start: int = 0, end: int = 2**60) -> tuple[int, bytes]:
    return CHUNK, chunk(len(inside), zstandard.compress(inside, 19), b"zstd", start, end)


def empty_records() -> bytes:
    """Chunks that unpack to millions of records without content."""
    inside = record(0x80) * (2**26 // 9)
    return joined([*described(), *[packed(inside)] * 8])


def tiny_messages() -> bytes:
    """Chunks of one moment, each of two million messages of 31 bytes."""
    inside = message(0, 5) * (2**26 // 31)
    return joined([*described(), *[packed(inside, 5, 5)] * 8])


def large_messages() -> bytes:
    """Chunks of one moment, each of a few messages of many megabytes."""
    inside = b"".join(message(i % 2, 5, 2**24 - 31) for i in range(3))
    return joined([*described(), *[packed(inside, 5, 5)] * 24])


def long_descriptions() -> bytes:
    """Channels that say many megabytes about themselves, each another."""
    chunks = []
    for i in range(20):
        inside = b"".join(record(*channel(100 * i + j, b"/t", bytes([97 + j]) * 2**20)) for j in range(20))
        chunks.append(packed(inside))
    return joined([*described(), *chunks, packed(message(0, 1))])


def long_qualities() -> bytes:
    """160 topics of one name, each with 16 kB of YAML about its publishers, all different."""
    topics = []
    for i in range(160):
        lines = b"".join(b"- {depth: %d}\n" % (1 + (700 * i + j) % 1000) for j in range(1000))
        topics.append(channel(10 + i, b"/many", lines[:16_000]))
    return joined([*described(), *topics, packed(message(0, 1))])


def nested_chunks() -> bytes:
    """An index of chunks that lie within each other, each to the end of the file: read once each, that is n squared."""
    head = joined(described())[:-8]
    starts, body = [], b""
    each = 3000
    total = 200 * each
    for i in range(200):
        starts.append(len(head) + i * each)
        rest = total - i * each - 9
        inside = rest - 40
        opening = record(CHUNK)[:1] + struct.pack("<Q", rest) + struct.pack("<QQQI", 0, 9, inside, 0)
        opening += string(b"") + struct.pack("<Q", inside)
        filler = record(0x80, bytes(each - len(opening) - 9))
        body += opening + filler
    summary = b"".join(record(*each) for each in described()[1:])
    for i, start in enumerate(starts):
        entry = struct.pack("<QQQQI", 0, 9, start, total - i * each, 0) + struct.pack("<Q", 0) + string(b"")
        summary += record(CHUNK_INDEX, entry + struct.pack("<QQ", total, total))
    counts = struct.pack("<HQ", 0, 5)
    statistics = struct.pack("<QHIIIIQQ", 5, 1, 2, 0, 0, 200, 0, 9) + struct.pack("<I", len(counts)) + counts
    summary += record(STATISTICS, statistics)
    start = len(head) + len(body) + len(record(15, bytes(4)))
    footer = record(2, struct.pack("<QQI", start, 0, 0))
    return head + body + record(15, bytes(4)) + summary + footer + head[:8]


def packed_file() -> bytes:
    """A whole file of millions of messages, packed to a few kilobytes."""
    inside = joined([*described(), (0x80, b"")])[:-8] + message(0, 5) * (2**26 // 31)
    return zstandard.compress(inside, 19)


SAID = "not read", "are read", "lost", "ROS's default", "overlap"
HOSTILE: dict[str, Callable[[], bytes]] = {
    "empty records": empty_records, "tiny messages": tiny_messages, "large messages": large_messages,
    "long descriptions": long_descriptions, "long qualities": long_qualities, "nested chunks": nested_chunks,
    "packed file": packed_file,
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_the_cost_is_bounded_by_the_size_of_the_file(tmp_path: Path, name: str) -> None:
    data = HOSTILE[name]()
    file, sound = tmp_path / "hostile.mcap", write_mcap(tmp_path / "sound.mcap", recording(4))
    file.write_bytes(data)
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(sound), str(file)], capture_output=True, text=True, timeout=500, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    cost = json.loads(done.stdout.splitlines()[-1])
    walks = 4  # the index, the first CameraInfo of either camera, the messages
    assert cost["records"] <= walks * (SPARE_STEPS + len(data) // BYTES_PER_STEP + 10)
    assert cost["parsed"] <= MOST_QOS_TEXT
    assert cost["grown"] < 6 * SPARE_BYTES + 40 * len(data)
    if name != "nested chunks":
        assert any(word in " ".join(cost["told"]) for word in SAID)


def test_an_index_of_chunks_within_each_other_is_not_believed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    data = nested_chunks()
    assert mcap_index.read_summary(BytesIO(data), len(data)) is None
    monkeypatch.setattr(mcap_index, "_apart", lambda chunks: True)
    believed = mcap_index.read_summary(BytesIO(data), len(data))
    assert believed is not None, "nothing else is wrong with it"
    assert sum(block.length for block in believed.chunks) > 50 * len(data)


def test_a_budget_counts_down_to_a_refusal() -> None:
    budget = Budget.of(4 * 10)
    for _ in range(SPARE_STEPS + 10):
        budget.step()
    with pytest.raises(ValueError, match="the rest is not read"):
        budget.step()
    budget.unpack(16 * SPARE_BYTES + MOST_UNPACKED * 40)
    with pytest.raises(ValueError, match="far more than a recording of this size"):
        budget.unpack(1)


def test_what_cameras_record_is_within_it(tmp_path: Path) -> None:
    """Black images, which compress a thousandfold and more, are read whole."""
    black = bytes(960 * 1280 * 3)
    recorded = [replace(message, data=message.data[:100] + black) for message in recording(30)]
    path = write_mcap(tmp_path / "a.mcap", recorded, index=False)
    assert path.stat().st_size * 1000 < sum(len(message.data) for message in recorded)
    with open_bag(path) as bag:
        assert list(bag.raw_messages()) == recorded
        assert not bag.damage
