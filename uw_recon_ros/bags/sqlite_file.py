"""An SQLite rosbag2 file (``.db3``), whole or damaged."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

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
from uw_recon_ros.errors import BagError

_ALWAYS = 0, LATEST_NS - 1
_SOUND = f"typeof(topic_id) = 'integer' AND typeof(data) = 'blob' AND timestamp BETWEEN 0 AND {LATEST_NS - 1}"
_PATIENCE = 1000  # unreadable rows in a row before the rest is given up


class SqliteFile:
    """One SQLite file. See `uw_recon_ros.bags.model.Storage`.

    Parameters
    ----------
    path : path
    name : str
        What damage reports call it.

    Attributes
    ----------
    damage : list of str
        What could not be read so far; grows while messages are read.
    """

    def __init__(self, path: Path, name: str) -> None:
        self.damage: list[str] = []
        self._name = name
        self._size = path.stat().st_size
        with path.open("rb") as stream:
            self._pages = int.from_bytes(stream.read(32)[28:], "big")
        self._database = _connect(path)
        try:
            self._channels = self._read_topics()
            self._summarise()
        except BaseException as error:
            self._database.close()
            if isinstance(error, sqlite3.Error):
                raise BagError(f"{name}: expected a rosbag2 database, got: {error}") from error
            raise

    def _note(self, sentence: str) -> None:
        add_note(self.damage, f"{self._name}: {sentence}")

    def _read_topics(self) -> dict[int, TopicInfo]:
        """Channels by their number, not counted yet."""
        self._expect_tables()
        names = [row[1] for row in self._database.execute("PRAGMA table_info(topics)")]
        qos = "offered_qos_profiles" if "offered_qos_profiles" in names else "''"
        channels = {}
        for number, name, kind, form, profiles in self._database.execute(
            f"SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id"
        ):
            if not (is_name(name) and is_name(kind)):
                self._note(f"topic {plain(name)} of type {plain(kind)} is left out: no name for a topic")
            elif form == "cdr":
                channels[number] = TopicInfo(name, kind, 0, parse_qos(profiles))
            else:
                self._note(f"topic {name} is left out: {plain(form)} is not CDR")
        return channels

    def _expect_tables(self) -> None:
        """Refuse views and virtual tables: they would make SQLite compute whatever the file says, for ever."""
        for name in ("topics", "messages"):
            query = "SELECT type, rootpage, sql FROM sqlite_master WHERE name = ?"
            for kind, page, text in self._database.execute(query, (name,)):
                plainly = "".join(str(text).split()).upper()
                if kind != "table" or not page or "GENERATED" in plainly or ")AS(" in plainly or "AS(" in plainly:
                    raise sqlite3.DatabaseError(f"{name} is no plain table")

    def _summarise(self) -> None:
        """Count messages; a damaged file is walked through."""
        self._counts = dict.fromkeys(self._channels, 0)
        self._span: tuple[int, int] | None = None
        self._rescued: list[tuple[int, int]] | None = None
        try:
            self._check_size()
            counted = f"SELECT topic_id, count(*) FROM messages WHERE {_SOUND} GROUP BY topic_id"
            self._counts.update(self._database.execute(counted))
            limits = f"SELECT min(timestamp), max(timestamp) FROM messages WHERE {_SOUND}"
            start, end = self._database.execute(limits).fetchone()
            self._span = None if start is None else (start, end)
        except sqlite3.Error as error:
            self._rescue(str(error))

    def _check_size(self) -> None:
        (page_size,) = self._database.execute("PRAGMA page_size").fetchone()
        if self._size < self._pages * page_size:
            raise sqlite3.DatabaseError(f"cut short: {self._size} of {self._pages * page_size} bytes")

    def _rescue(self, reason: str) -> None:
        """Try row after row, in the order they were written; note which can be read."""
        self._counts = dict.fromkeys(self._channels, 0)
        self._rescued = []
        number = misses = 0
        while misses < _PATIENCE:
            number += 1
            row = self._row(number)
            misses = 0 if row else misses + 1
            if row and row[0] in self._channels:
                self._counts[row[0]] += 1
                self._rescued.append((row[1], number))
        self._rescued.sort()
        self._span = (self._rescued[0][0], self._rescued[-1][0]) if self._rescued else None
        self._note(f"damaged ({reason}): {len(self._rescued)} messages can be read")

    def _row(self, number: int) -> tuple[int, int, bytes] | None:
        with suppress(sqlite3.Error):
            query = f"SELECT topic_id, timestamp, data FROM messages WHERE rowid = ? AND {_SOUND}"
            row: tuple[int, int, bytes] | None = self._database.execute(query, (number,)).fetchone()
            return row
        return None

    @property
    def topics(self) -> list[TopicInfo]:
        """Topics in ROS 2's own serialisation; others are reported as damage."""
        counted = [TopicInfo(t.name, t.type, self._counts[n], t.qos) for n, t in self._channels.items()]
        return merge_topics([counted])

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time, ns."""
        return self._span

    def messages(self, topics: frozenset[str] | None, between: tuple[int, int] | None = None) -> Iterator[RawMessage]:
        """Messages in log-time order; those in damaged places are left out and reported."""
        start, end = between or _ALWAYS
        wanted = {n: t for n, t in self._channels.items() if topics is None or t.name in topics}
        done: set[int] = set()
        if self._rescued is None:
            try:
                for number, channel, stamp, data in self._rows_in_order(wanted, start, end):
                    yield _message(wanted, channel, stamp, data)
                    done.add(number)
            except sqlite3.Error as error:
                self._rescue(str(error))
        for stamp, number in self._rescued or ():
            row_again = None if number in done or not start <= stamp <= end else self._row(number)
            if row_again and row_again[0] in wanted:
                yield _message(wanted, *row_again)

    def _rows_in_order(
        self, wanted: dict[int, TopicInfo], start: int, end: int
    ) -> Iterator[tuple[int, int, int, bytes]]:
        marks = ",".join("?" * len(wanted))
        return self._database.execute(
            f"SELECT id, topic_id, timestamp, data FROM messages WHERE topic_id IN ({marks}) "
            f"AND {_SOUND} AND timestamp BETWEEN ? AND ? ORDER BY timestamp, id",
            [*wanted, max(start, 0), min(end, LATEST_NS)],
        )

    def close(self) -> None:
        """Release the file."""
        self._database.close()


def _message(channels: dict[int, TopicInfo], number: int, stamp_ns: int, data: bytes) -> RawMessage:
    return RawMessage(channels[number].name, channels[number].type, stamp_ns, bytes(data))


def _connect(path: Path) -> sqlite3.Connection:
    """Open for reading; with the write-ahead log a crashed recorder left beside the file, if there is one."""
    log = path.with_name(path.name + "-wal")
    mode = "mode=ro" if log.exists() and log.stat().st_size else "immutable=1"
    database = sqlite3.connect(f"{path.absolute().as_uri()}?{mode}", uri=True, check_same_thread=False)
    database.execute("PRAGMA writable_schema=ON")  # else a file cut short is refused as a whole; nothing is written
    database.execute("PRAGMA trusted_schema=OFF")
    return database
