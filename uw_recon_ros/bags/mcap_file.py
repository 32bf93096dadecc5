"""An MCAP file, indexed or not, whole or damaged, read in log-time order with bounded memory."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property, partial
from pathlib import Path

from mcap.opcode import Opcode

from uw_recon_ros.bags import mcap_chunk, mcap_index
from uw_recon_ros.bags.mcap_chunk import DAMAGE
from uw_recon_ros.bags.mcap_index import MAGIC, Block, Index
from uw_recon_ros.bags.merge import merge_by_time
from uw_recon_ros.bags.model import (
    LATEST_NS,
    RawMessage,
    TopicInfo,
    add_note,
    is_name,
    merge_topics,
    parse_qos,
    plain,
)
from uw_recon_ros.bounds import MOST_QOS_TEXT, MOST_UNPACKED, SPARE_BYTES, Budget
from uw_recon_ros.errors import BagError

_FOREVER = 2**64
_MOST_HELD = 2**30  # bytes of chunks that overlap in time; a whole recording in one moment must not fill the memory


class McapFile:
    """One MCAP file. See `uw_recon_ros.bags.model.Storage`.

    Parameters
    ----------
    path : path
    name : str
        What damage reports call it.
    given_size : int or None
        Of the file that was given, bytes: before it was unpacked to `path`. It bounds what reading may cost.

    Attributes
    ----------
    damage : list of str
        What could not be read so far; grows while messages are read.
    """

    def __init__(self, path: Path, name: str, given_size: int | None = None) -> None:
        self.damage: list[str] = []
        self._given_size = path.stat().st_size if given_size is None else given_size
        self._most_held = min(_MOST_HELD, 4 * SPARE_BYTES + MOST_UNPACKED * self._given_size)
        self._name, self._held = name, 0
        self._stream = path.open("rb")
        try:
            self._index = self._find_index(path.stat().st_size)
        except BaseException:
            self._stream.close()
            raise

    def _find_index(self, size: int) -> Index:
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise BagError(f"{self._name}: expected an MCAP file, its first bytes are others")
        return mcap_index.read_summary(self._stream, size) or mcap_index.scan(
            self._stream, size, self._note, Budget.of(self._given_size)
        )

    def _note(self, sentence: str) -> None:
        add_note(self.damage, f"{self._name}: {sentence}")

    @cached_property
    def topics(self) -> list[TopicInfo]:
        """Topics in ROS 2's own serialisation; others are reported as damage."""
        topics, qos_left = [], MOST_QOS_TEXT
        for number, channel in self._index.channels.items():
            schema = self._index.schemas.get(channel.schema_id)
            if channel.message_encoding != "cdr" or schema is None:
                form = plain(channel.message_encoding) or "unknown"
                self._note(f"topic {plain(channel.topic)} is left out: {form} is not CDR")
                continue
            if not (is_name(channel.topic) and is_name(schema.name)):
                self._note(
                    f"topic {plain(channel.topic)} of type {plain(schema.name)} is left out: no name for a topic"
                )
                continue
            recorded = channel.metadata.get(mcap_index.QOS, "")
            qos_left -= len(recorded)
            if qos_left < 0:
                self._note("more is said about quality of service than is read: the rest is taken as ROS's default")
                recorded = ""
            qos = parse_qos(recorded)
            topics.append(TopicInfo(channel.topic, _type_name(schema.name), self._index.counts[number], qos))
        return merge_topics([topics])

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time, ns."""
        return self._index.span

    def messages(self, topics: frozenset[str] | None, between: tuple[int, int] | None = None) -> Iterator[RawMessage]:
        """Messages in log-time order; those in damaged places are left out and reported.

        Chunks without a message in the time `between` are not touched.
        """
        wanted, budget = self._wanted(topics), Budget.of(self._given_size)
        start, end = between or (0, _FOREVER)
        chunks = [
            (block.start_ns, partial(self._chunk, block, wanted, budget))
            for block in self._index.chunks
            if (not block.channels or block.channels & wanted.keys())
            and block.start_ns <= end
            and block.end_ns >= start
        ]
        loose = [b for b in self._index.loose if b.channels & wanted.keys() and start <= b.start_ns <= end]
        loose.sort(key=lambda block: block.start_ns)
        if loose:
            chunks.append((loose[0].start_ns, partial(self._loose, loose, wanted)))
        merged = merge_by_time(chunks)
        return merged if between is None else (message for message in merged if start <= message.log_ns <= end)

    def _wanted(self, topics: frozenset[str] | None) -> dict[int, tuple[str, str]]:
        """Topic and type of the channels to be read."""
        known = {topic.name for topic in self.topics}
        return {
            number: (channel.topic, _type_name(self._index.schemas[channel.schema_id].name))
            for number, channel in self._index.channels.items()
            if is_name(channel.topic) and channel.topic in known and (topics is None or channel.topic in topics)
            and channel.message_encoding == "cdr" and channel.schema_id in self._index.schemas
        }  # fmt: skip

    def _content(self, block: Block) -> bytes:
        if block.length > mcap_chunk.LARGEST:
            raise ValueError(f"{block.length} bytes claimed")
        self._stream.seek(block.offset)
        return self._stream.read(block.length)

    def _chunk(self, block: Block, wanted: dict[int, tuple[str, str]], budget: Budget) -> Iterator[RawMessage]:
        """Messages of a chunk in order, in memory from the first to the last."""
        size = 0
        try:
            content = self._content(block)
            size = mcap_chunk.claimed_size(content)
            if self._held + size > self._most_held:
                raise ValueError(f"{self._held + size} bytes of overlapping chunks")
            self._held += size
            budget.unpack(size)
            yield from self._sorted(block, content, wanted, budget)
        except DAMAGE as error:
            size = 0
            if not block.partial:
                self._note(mcap_chunk.loss(block.offset, error))
        finally:
            self._held -= size

    def _sorted(
        self, block: Block, content: bytes, wanted: dict[int, tuple[str, str]], budget: Budget
    ) -> list[RawMessage]:
        found: list[RawMessage] = []
        try:
            inside = mcap_chunk.inflate_rest(content) if block.partial else mcap_chunk.inflate(content)
            for opcode, record in mcap_chunk.records(inside):
                budget.step()
                if opcode == Opcode.MESSAGE:
                    found += self._message(record, wanted)
        except DAMAGE as error:
            if not block.partial:
                self._note(mcap_chunk.loss(block.offset, error))
        found.sort(key=lambda message: message.log_ns)
        return found

    def _loose(self, blocks: list[Block], wanted: dict[int, tuple[str, str]]) -> Iterator[RawMessage]:
        for block in blocks:
            try:
                found = self._message(memoryview(self._content(block)), wanted)
            except DAMAGE as error:
                self._note(f"message at byte {block.offset} is damaged ({mcap_chunk.reason_of(error)})")
            else:
                yield from found

    def _message(self, record: memoryview, wanted: dict[int, tuple[str, str]]) -> list[RawMessage]:
        channel, log_time = mcap_chunk.message_header(record)
        if channel not in wanted:
            return []
        if log_time >= LATEST_NS:
            self._note("messages recorded after the year 2038 are left out")
            return []
        topic, type_name = wanted[channel]
        return [RawMessage(topic, type_name, log_time, bytes(record[mcap_chunk.MESSAGE_HEADER :]))]

    def close(self) -> None:
        """Release the file."""
        self._stream.close()


def _type_name(schema_name: str) -> str:
    """``sensor_msgs/Image`` is what some writers call ``sensor_msgs/msg/Image``."""
    package, _, name = schema_name.partition("/")
    return schema_name if "/" in name or not name else f"{package}/msg/{name}"
