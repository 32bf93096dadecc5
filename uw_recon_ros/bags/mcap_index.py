"""Where everything is in an MCAP file: from its summary, or, without a sound one, by walking through it."""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from io import BytesIO
from itertools import pairwise
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Schema, Statistics

from uw_recon_ros.bags import mcap_chunk
from uw_recon_ros.bags.mcap_chunk import DAMAGE, RECORD_HEADER, Buffer
from uw_recon_ros.bags.model import LATEST_NS, LONGEST_QOS
from uw_recon_ros.bounds import Budget, OverBudgetError

MAGIC = b"\x89MCAP0\r\n"
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of summary and of its offsets, CRC
_LAST_OPCODE = max(Opcode)
_LONGEST_DESCRIPTION = 2**20  # bytes of a Schema or Channel record
_LONGEST_TEXT = 256  # characters: one more than a name may have
QOS = "offered_qos_profiles"


@dataclass(frozen=True)
class Block:
    """A chunk, or a message outside of any chunk.

    Parameters
    ----------
    start_ns, end_ns : int
        First and last log time.
    offset, length : int
        Of its content in the file, without the record's header.
    channels : frozenset of int
        What is in it; empty: not known.
    partial : bool
        Whether it is known that only its beginning can be read.
    """

    start_ns: int
    end_ns: int
    offset: int
    length: int
    channels: frozenset[int] = frozenset()
    partial: bool = False


@dataclass
class Index:
    """What is where in one MCAP file."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    counts: Counter[int] = field(default_factory=Counter)
    chunks: list[Block] = field(default_factory=list)
    loose: list[Block] = field(default_factory=list)
    span: tuple[int, int] | None = None

    def learn(self, opcode: int, content: Buffer) -> None:
        """Note a schema or channel, of its text only what is read; other records are passed over."""
        if opcode not in (Opcode.SCHEMA, Opcode.CHANNEL):
            return
        if len(content) > _LONGEST_DESCRIPTION:
            raise ValueError(f"a description of {len(content)} bytes")
        stream = ReadDataStream(BytesIO(bytes(content)))
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            self.schemas[schema.id] = replace(schema, data=b"", name=schema.name[:_LONGEST_TEXT])
        else:
            channel = Channel.read(stream)
            qos = str(channel.metadata.get(QOS, ""))[:LONGEST_QOS]
            self.channels[channel.id] = replace(
                channel, topic=channel.topic[:_LONGEST_TEXT], metadata={QOS: qos},
                message_encoding=channel.message_encoding[:_LONGEST_TEXT],
            )  # fmt: skip

    @property
    def names_all_topics(self) -> bool:
        """Whether no topic or type is left to be found inside the chunks."""
        types = {channel.schema_id for channel in self.channels.values()}
        return self.counts.keys() <= self.channels.keys() and types <= self.schemas.keys() | {0}

    def count(self, channel: int, log_time: int) -> None:
        """Note a message; one at an impossible time is never read."""
        if log_time >= LATEST_NS:
            return
        self.counts[channel] += 1
        start, end = self.span or (log_time, log_time)
        self.span = min(start, log_time), max(end, log_time)


def read_summary(stream: BinaryIO, size: int) -> Index | None:
    """Read the index at the file's end.

    Returns
    -------
    Index or None
        None when there is none, or it does not fit the file: then `scan` tells.
    """
    try:
        return _checked_summary(stream, size)
    except DAMAGE:
        return None


def _checked_summary(stream: BinaryIO, size: int) -> Index | None:
    stream.seek(size - len(MAGIC) - _FOOTER.size)
    footer = stream.read(_FOOTER.size)
    opcode, _, start, _, crc = _FOOTER.unpack(footer)
    if opcode != Opcode.FOOTER or stream.read() != MAGIC or not len(MAGIC) <= start < size:
        return None
    length = size - len(MAGIC) - _FOOTER.size - start
    if length > mcap_chunk.LARGEST:
        return None
    stream.seek(start)
    summary = stream.read(length)
    if crc and zlib.crc32(summary + footer[:-4]) != crc:
        return None
    index, statistics = _parse_summary(summary)
    if statistics is None or statistics.chunk_count != len(index.chunks):
        return None
    if not _apart(index.chunks):
        return None
    if index.span is not None and index.span[1] >= LATEST_NS:
        return None
    if (statistics.message_count and not index.chunks) or not index.names_all_topics:
        return None
    fits = all(_is_chunk(stream, block, start) for block in index.chunks)
    return index if fits else None


def _apart(chunks: list[Block]) -> bool:
    """Whether no chunk lies within another: else the same bytes would be read again and again."""
    ordered = sorted(chunks, key=lambda block: block.offset)
    return all(before.offset + before.length < after.offset for before, after in pairwise(ordered))


def _parse_summary(summary: bytes) -> tuple[Index, Statistics | None]:
    index, statistics = Index(), None
    for opcode, content in mcap_chunk.records(summary):
        if opcode == Opcode.STATISTICS:
            statistics = Statistics.read(ReadDataStream(BytesIO(bytes(content))))
            index.counts.update(statistics.channel_message_counts)
            if statistics.message_count:
                index.span = statistics.message_start_time, statistics.message_end_time
        elif opcode == Opcode.CHUNK_INDEX:
            index.chunks.append(_block(ChunkIndex.read(ReadDataStream(BytesIO(bytes(content))))))
        else:
            index.learn(opcode, content)
    return index, statistics


def _block(entry: ChunkIndex) -> Block:
    return Block(
        entry.message_start_time,
        entry.message_end_time,
        entry.chunk_start_offset + RECORD_HEADER,
        entry.chunk_length - RECORD_HEADER,
        frozenset(entry.message_index_offsets),
    )


def _is_chunk(stream: BinaryIO, block: Block, limit: int) -> bool:
    stream.seek(block.offset - RECORD_HEADER)
    header = stream.read(RECORD_HEADER)
    return mcap_chunk.record_header(header) == (Opcode.CHUNK, block.length) and block.offset + block.length <= limit


def scan(stream: BinaryIO, size: int, note: Callable[[str], None], budget: Budget) -> Index:
    """Walk through a file that has no sound index, decompressing every chunk once.

    Parameters
    ----------
    stream : binary file
    size : int
        Of the file, bytes.
    note : callable
        Told, in a sentence, what is lost.
    budget : Budget
        What the walk may cost.
    """
    index = Index()
    try:
        _walk(stream, size, index, note, budget)
    except OverBudgetError as error:
        note(str(error))
    return index


def _walk(stream: BinaryIO, size: int, index: Index, note: Callable[[str], None], budget: Budget) -> None:
    offset = len(MAGIC)
    while offset + RECORD_HEADER <= size:
        stream.seek(offset)
        opcode, length = mcap_chunk.record_header(stream.read(RECORD_HEADER))
        offset += RECORD_HEADER
        if not 0 < opcode <= _LAST_OPCODE and opcode < 0x80:
            note(f"no record where one must begin, at byte {offset - RECORD_HEADER} of {size}: what follows is lost")
            return
        block = Block(0, 0, offset, min(length, size - offset), partial=offset + length > size)
        budget.step()
        _take(stream, index, opcode, block, note, budget)
        if opcode in (Opcode.DATA_END, Opcode.FOOTER):
            return
        offset += length
    note(f"cut short at byte {size}: the end of the recording is missing")


def _take(
    stream: BinaryIO, index: Index, opcode: int, block: Block, note: Callable[[str], None], budget: Budget
) -> None:
    """Note one top-level record."""
    if opcode == Opcode.CHUNK and block.length <= mcap_chunk.LARGEST:
        found = _look_inside(_read(stream, block), block, index, note, budget)
        if found:
            index.chunks.append(found)
    elif opcode == Opcode.MESSAGE and not block.partial:
        channel, log_time = mcap_chunk.message_header(stream.read(mcap_chunk.MESSAGE_HEADER))
        index.count(channel, log_time)
        index.loose.append(Block(log_time, log_time, block.offset, block.length, frozenset((channel,))))
    elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and not block.partial:
        try:
            index.learn(opcode, _read(stream, replace(block, length=min(block.length, _LONGEST_DESCRIPTION + 1))))
        except DAMAGE as error:
            note(f"a topic's description at byte {block.offset} is lost ({mcap_chunk.reason_of(error)})")


def _read(stream: BinaryIO, block: Block) -> bytes:
    stream.seek(block.offset)
    return stream.read(block.length)


def _look_inside(
    content: bytes, block: Block, index: Index, note: Callable[[str], None], budget: Budget
) -> Block | None:
    """Learn topics and count messages of a chunk; None when nothing can be read."""
    times: list[int] = []
    channels: set[int] = set()
    partial = block.partial
    try:
        inside = mcap_chunk.inflate_rest(content) if partial else mcap_chunk.inflate(content)
        budget.unpack(len(inside))
        for opcode, record in mcap_chunk.records(inside):
            budget.step()
            index.learn(opcode, record)
            if opcode == Opcode.MESSAGE:
                channel, log_time = mcap_chunk.message_header(record)
                index.count(channel, log_time)
                times.append(log_time)
                channels.add(channel)
    except DAMAGE as error:
        if not partial:
            note(mcap_chunk.loss(block.offset, error))
        partial = True
    if not times:
        return None
    return Block(min(times), max(times), block.offset, block.length, frozenset(channels), partial)
