"""Bags that no recorder writes: sound ones, and a seeded way to spoil each.

A mutant is named by its seed alone, so that a failure is repeated by `mutant(path, seed)`.
"""

from __future__ import annotations

import random
import sqlite3
import struct
from collections.abc import Callable, Sequence
from contextlib import closing
from pathlib import Path

import lz4.frame
import zstandard
from mcap.writer import CompressionType

from helpers.bag_makers import MS, camera, recording, write_mcap, write_rosbags
from uw_recon_ros.bags import RawMessage, messages

CHUNK, MESSAGE, SCHEMA, CHANNEL, CHUNK_INDEX, STATISTICS = 6, 5, 3, 4, 8, 11
HUGE = (2**16, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**63 - 1, 2**64 - 1)
NAMES = (b"../../etc/passwd", b"/left/image_raw\n\x1b[2J", b"", b"<script>", b"\xff\xfe", b"x" * 100_000, b"//", b"a b")
TYPES = (b"std_msgs/msg/String", b"antigravity/msg/X", b"../msg/Image", b"sensor_msgs/msg/PointCloud2", b"", b"\xff")
Record = tuple[int, bytes]


def calibrated(frames: int) -> list[RawMessage]:
    """Images of both cameras and their CameraInfo."""
    found = recording(frames)
    for side, tx in (("left", 0.0), ("right", -0.1)):
        for i in range(frames):
            info = messages.camera_info_message(camera(tx=tx), time_ns=100 * i * MS, frame_id="left_optical_frame")
            kind, data = messages.encode(info)
            found.append(RawMessage(f"/{side}/camera_info", kind, (100 * i + 4) * MS, data))
    return sorted(found, key=lambda message: message.log_ns)


def make_bases(folder: Path, recorded: Sequence[RawMessage]) -> list[bytes]:
    """MCAP files of all forms."""
    forms: tuple[dict[str, object], ...] = (
        {}, {"crc": False}, {"compression": CompressionType.LZ4, "crc": False},
        {"compression": CompressionType.NONE, "crc": False}, {"chunked": False}, {"index": False, "crc": False},
        {"compression": CompressionType.NONE, "crc": False, "index": False, "repeat": False},
    )  # fmt: skip
    return [write_mcap(folder / f"{i}.mcap", recorded, **form).read_bytes() for i, form in enumerate(forms)]  # type: ignore[arg-type]


def split(data: bytes) -> list[Record]:
    """The records between the two magics."""
    offset, found = 8, []
    while offset + 9 <= len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, offset)
        found.append((opcode, data[offset + 9 : offset + 9 + length]))
        offset += 9 + length
    return found


def joined(records: Sequence[Record]) -> bytes:
    magic = b"\x89MCAP0\r\n"
    return magic + b"".join(struct.pack("<BQ", opcode, len(content)) + content for opcode, content in records) + magic


def string(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def chunk(size: int, data: bytes, compression: bytes = b"zstd", start: int = 0, end: int = 2**62) -> bytes:
    """A Chunk record that claims what it likes."""
    return struct.pack("<QQQI", start, end, size, 0) + string(compression) + struct.pack("<Q", len(data)) + data


def bomb(size: int, compression: bytes = b"zstd") -> bytes:
    """A few KiB that become `size` zeros."""
    zeros = bytes(size)
    packed = zstandard.compress(zeros) if compression == b"zstd" else lz4.frame.compress(zeros)
    return chunk(size, packed, compression)


# spoiling bytes


def flips(data: bytes, dice: random.Random) -> bytes:
    spoiled = bytearray(data)
    for _ in range(dice.choice([1, 1, 2, 5, 20, 100])):
        spoiled[dice.randrange(len(data))] = dice.randrange(256)
    return bytes(spoiled)


def cuts(data: bytes, dice: random.Random) -> bytes:
    return data[: dice.randrange(len(data))]


def holes(data: bytes, dice: random.Random) -> bytes:
    place, length = dice.randrange(len(data)), dice.randrange(1, 2000)
    return data[:place] + dice.choice([b"", bytes(length), dice.randbytes(length)]) + data[place + length :]


def lengths(data: bytes, dice: random.Random) -> bytes:
    """The length of one record overwritten."""
    spoiled, offset, places = bytearray(data), 8, []
    while offset + 9 <= len(data) - 8:
        places.append(offset + 1)
        offset += 9 + int(struct.unpack_from("<Q", data, offset + 1)[0])
    struct.pack_into("<Q", spoiled, dice.choice(places), dice.choice([0, 1, dice.randrange(2000), *HUGE]))
    return bytes(spoiled)


def fields(data: bytes, dice: random.Random) -> bytes:
    """Eight bytes within one record overwritten: times, sizes, offsets, counts."""
    records = split(data)
    rank = dice.choice([i for i, (_, content) in enumerate(records) if len(content) >= 8])
    opcode, content = records[rank]
    place = dice.choice(
        [p for p in (0, 2, 8, 16, 24, 28, 32, 40, dice.randrange(len(content))) if p + 8 <= len(content)]
    )
    value = dice.choice([0, 1, dice.randrange(2**32), *HUGE])
    records[rank] = opcode, content[:place] + struct.pack("<Q", value) + content[place + 8 :]
    return joined(records)


# spoiling records


def shuffles(data: bytes, dice: random.Random) -> bytes:
    """Records twice, not at all, or elsewhere."""
    records = split(data)
    for _ in range(dice.randrange(1, 4)):
        rank = dice.randrange(len(records))
        action = dice.randrange(4)
        if action == 0:
            records[rank:rank] = [records[rank]] * dice.choice([1, 2, 300])
        elif action == 1 and len(records) > 1:
            del records[rank]
        elif action == 2:
            dice.shuffle(records)
        else:
            records.insert(dice.randrange(len(records)), records[rank])
    return joined(records)


def strangers(data: bytes, dice: random.Random) -> bytes:
    """Records of unknown kinds, or known ones full of rubbish."""
    records = split(data)
    for _ in range(dice.randrange(1, 5)):
        records.insert(dice.randrange(len(records)), (dice.randrange(256), dice.randbytes(dice.randrange(200))))
    return joined(records)


def descriptions(data: bytes, dice: random.Random) -> bytes:
    """Topics and types by other names; encodings; quality of service that makes no sense."""
    schema = struct.pack("<H", 1) + string(dice.choice(TYPES)) + string(b"ros2msg") + string(dice.randbytes(40))
    qos = dice.choice([b"[" * 30_000, b"- depth: 9999999999999", b"&a [*a]", b"- {history: [[]]}", b"2001-99-99", b"5"])
    metadata = string(b"offered_qos_profiles") + string(qos)
    channel = struct.pack("<HH", dice.randrange(4), dice.randrange(3)) + string(dice.choice(NAMES))
    channel += string(dice.choice([b"cdr", b"json", b"\n"])) + struct.pack("<I", len(metadata)) + metadata
    records = split(data)
    for kind, content in ((SCHEMA, schema), (CHANNEL, channel)):
        places = [i for i, (opcode, _) in enumerate(records) if opcode == kind] or [1]
        if dice.random() < 0.7:
            records[dice.choice(places)] = kind, content
        else:
            records.insert(dice.choice(places), (kind, content))
    return joined(records)


def contents(data: bytes, dice: random.Random) -> bytes:
    """CDR that is none: rubbish, or counts that cannot be. Of a file that is neither packed nor indexed."""
    records: list[Record] = []
    for opcode, content in split(data):
        if opcode == CHUNK:
            offset = 32 + struct.unpack_from("<I", content, 28)[0] + 8
            inside = split(bytes(8) + content[offset:] + bytes(8))
            spoiled = b"".join(
                struct.pack("<BQ", kind, len(body)) + body for kind, body in (_cdr(k, b, dice) for k, b in inside)
            )
            times = struct.unpack_from("<QQ", content)
            records.append((CHUNK, chunk(len(spoiled), spoiled, b"", *times)))
        elif opcode < CHUNK:
            records.append(_cdr(opcode, content, dice))
    return joined(records)


def _cdr(opcode: int, content: bytes, dice: random.Random) -> Record:
    if opcode != MESSAGE or dice.random() < 0.5:
        return opcode, content
    spoiled = bytearray(content)
    action = dice.randrange(5)
    if action == 0:
        del spoiled[dice.randrange(22, len(spoiled)) :]
    elif action == 1:
        struct.pack_into("<I", spoiled, 22 + 4 * dice.randrange(12), dice.choice([0, 2**31, 2**32 - 1, 2**30]))
    elif action == 2:
        struct.pack_into("<Q", spoiled, 6, dice.choice(HUGE))  # log time
    elif action == 3:
        spoiled[22:26] = dice.choice([b"\0\0\0\0", b"\xff\xff\xff\xff", b"\0\x03\0\0", b"\0\x0a\0\0"])
    else:
        for _ in range(8):
            spoiled[dice.randrange(22, min(len(spoiled), 120))] = dice.randrange(256)
    return opcode, bytes(spoiled)


_BOMBS: list[bytes] = []


def bombs(data: bytes, dice: random.Random) -> bytes:
    """Chunks that become much, or claim to."""
    if not _BOMBS:
        _BOMBS.extend([bomb(2**29), bomb(2**29, b"lz4"), bomb(2**24), bomb(2**24, b"lz4")])
    packed = zstandard.compress(bytes(1000))
    lies = [chunk(size, packed, kind) for size in HUGE for kind in (b"zstd", b"lz4", b"")]
    records = split(data)
    records.insert(dice.randrange(1, len(records)), (CHUNK, dice.choice([*_BOMBS, *lies])))
    return joined(records)


SPOILERS: tuple[Callable[[bytes, random.Random], bytes], ...] = (
    flips, flips, cuts, holes, lengths, fields, fields, shuffles, strangers, descriptions, contents, bombs,
)  # fmt: skip


def mutant(bases: Sequence[bytes], seed: int) -> tuple[bytes, str]:
    """The bytes of a bag spoiled once or twice, and how."""
    dice = random.Random(seed)
    rank = dice.randrange(len(bases))
    spoilers = dice.sample(SPOILERS, dice.choice([1, 1, 1, 2]))
    if contents in spoilers:
        rank, spoilers = len(bases) - 1, [contents, *(s for s in spoilers if s is not contents)]
    data = bases[rank]
    for spoil in spoilers:
        try:
            data = spoil(data, dice)
        except (struct.error, IndexError, ValueError):  # spoiled too much already for this way of it
            continue
    return data, f"seed {seed}: form {rank}, " + ", ".join(spoil.__name__ for spoil in spoilers)


# databases

DATABASE_JOBS = (
    "UPDATE topics SET name = x'fffe'", "UPDATE topics SET name = 5",
    "UPDATE topics SET type = '../msg/Image'", "UPDATE topics SET name = '/a' || char(10) || 'b'",
    "UPDATE topics SET serialization_format = 'json'", "UPDATE topics SET offered_qos_profiles = '- depth: 9999999'",
    "UPDATE topics SET id = 9223372036854775807 WHERE id = 1", "DELETE FROM topics", "DELETE FROM messages",
    "UPDATE messages SET timestamp = 'noon'", "UPDATE messages SET timestamp = 9223372036854775807 WHERE id % 3 = 0",
    "UPDATE messages SET timestamp = -1 WHERE id % 2 = 0", "UPDATE messages SET data = 2147483648",
    "UPDATE messages SET data = 'text' WHERE id % 2 = 0", "UPDATE messages SET topic_id = 'left'",
    "UPDATE messages SET data = zeroblob(1000000) WHERE id = 2", "UPDATE messages SET data = x''",
    "UPDATE messages SET topic_id = 77", "DROP TABLE messages", "DROP TABLE topics",
    "DROP TABLE messages; CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i AS id, 1 AS topic_id, i AS timestamp, zeroblob(1000) AS data FROM n",
    "DROP TABLE topics; CREATE VIEW topics AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) "
    "SELECT i AS id, 'x' AS name, 'y' AS type, 'cdr' AS serialization_format, '' AS offered_qos_profiles FROM n",
)  # fmt: skip


def database_mutant(folder: Path, recorded: Sequence[RawMessage], seed: int) -> tuple[Path, str]:
    """A spoiled database; the first seeds do one job each, later ones spoil bytes."""
    dice = random.Random(seed)
    images = [message for message in recorded if "image" in message.topic]
    path = write_rosbags(folder / f"db{seed}", images) / f"db{seed}.db3"
    if seed < len(DATABASE_JOBS):
        with closing(sqlite3.connect(path)) as database, database:
            database.executescript(DATABASE_JOBS[seed])
        database.close()
        return path, f"database seed {seed}: {DATABASE_JOBS[seed]}"
    spoil = dice.choice([flips, cuts, holes])
    path.write_bytes(spoil(path.read_bytes(), dice))
    return path, f"database seed {seed}: {spoil.__name__}"
