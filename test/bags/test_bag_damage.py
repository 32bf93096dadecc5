"""Damaged bags: what can be read is read, what cannot is named, nothing is invented."""

from __future__ import annotations

import random
from contextlib import closing
from pathlib import Path

import pytest
from helpers.bag_makers import (
    IMAGE,
    chunk_offsets,
    cut,
    flip,
    image_bytes,
    recording,
    summary_records,
    write_mcap,
    write_rosbags,
    write_split,
)
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from uw_recon_ros.bags import RawMessage, open_bag
from uw_recon_ros.errors import BagError

RECORDED = recording(40)


def read(path: Path) -> tuple[list[RawMessage], list[str]]:
    with open_bag(path) as bag:
        found = list(bag.raw_messages())
        again = list(bag.raw_messages())
        damage = bag.damage
    assert found == again
    assert all("\n" not in sentence for sentence in damage)
    return found, damage


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_a_file_cut_short_gives_what_is_before_the_cut(
    tmp_path: Path, compression: CompressionType, chunked: bool
) -> None:
    path = cut(write_mcap(tmp_path / "a.mcap", RECORDED, compression, chunked=chunked), 0.6)
    found, damage = read(path)
    assert found == RECORDED[: len(found)]
    assert len(found) >= 0.55 * len(RECORDED)
    assert damage == [f"a.mcap: cut short at byte {path.stat().st_size}: the end of the recording is missing"]


@pytest.mark.parametrize("compression", list(CompressionType))
def test_the_chunk_that_is_cut_gives_its_beginning(tmp_path: Path, compression: CompressionType) -> None:
    many = recording(60, (24, 32, 3))
    path = write_mcap(tmp_path / "a.mcap", many, compression, chunk_size=400_000)
    offset, length = chunk_offsets(path.read_bytes())[0]
    path.write_bytes(path.read_bytes()[: offset + length * 3 // 4])
    found, damage = read(path)
    assert found == many[: len(found)]
    assert len(found) >= 0.3 * len(many), "blocks of 128 KiB at most are lost"
    assert len(damage) == 1


def test_a_crashed_recorder_loses_its_last_chunk_only(tmp_path: Path) -> None:
    found, damage = read(write_mcap(tmp_path / "a.mcap", RECORDED, finish=False))
    assert found == RECORDED[: len(found)]
    assert len(found) >= len(RECORDED) - 8
    assert "the end of the recording is missing" in damage[0]


@pytest.mark.parametrize("index", [True, False])
@pytest.mark.parametrize("compression", list(CompressionType))
def test_flipped_bytes_cost_their_chunk_only(tmp_path: Path, index: bool, compression: CompressionType) -> None:
    path = write_mcap(tmp_path / "a.mcap", RECORDED, compression, index=index)
    chunks = chunk_offsets(path.read_bytes())
    bad = chunks[3::4]
    flip(path, [offset + length // 2 for offset, length in bad])
    found, damage = read(path)
    per_chunk = len(RECORDED) / len(chunks)
    assert len(found) == pytest.approx(len(RECORDED) - per_chunk * len(bad), abs=per_chunk)
    assert {m.data for m in found} <= {m.data for m in RECORDED}
    assert [m.log_ns for m in found] == sorted(m.log_ns for m in found)
    assert [f"chunk at byte {offset} is damaged" in said for (offset, _), said in zip(bad, damage, strict=True)] == [
        True
    ] * len(bad)


def test_a_damaged_index_is_done_without(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", RECORDED)
    size = path.stat().st_size
    last = chunk_offsets(path.read_bytes())[-1]
    for place in range(last[0] + last[1] + 40, size, 97):
        damaged = path.with_name(f"{place}.mcap")
        damaged.write_bytes(path.read_bytes())
        assert read(flip(damaged, [place]))[0] == RECORDED


@pytest.mark.parametrize("place", [16, 17, 24])  # a chunk's offset and length
def test_an_index_that_points_elsewhere_is_done_without(tmp_path: Path, place: int) -> None:
    path = write_mcap(tmp_path / "a.mcap", RECORDED, crc=False)
    entry = next(offset for opcode, offset, _ in summary_records(path.read_bytes()) if opcode == 8)
    found, damage = read(flip(path, [entry + place]))
    assert found == RECORDED
    assert damage == []


def test_a_misspelt_topic_in_the_index_is_not_believed(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", RECORDED)
    channel = next(offset for opcode, offset, _ in summary_records(path.read_bytes()) if opcode == 4)
    assert read(flip(path, [channel + 2 + 2 + 4 + 1], 0x01))[0] == RECORDED


def test_a_lying_length_without_an_index_is_survived(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", RECORDED, index=False)
    offset, _ = chunk_offsets(path.read_bytes())[5]
    found, damage = read(flip(path, [offset - 3]))
    assert found == RECORDED[: len(found)]
    assert len(found) >= 10
    assert damage


def test_a_chunk_that_claims_terabytes_is_refused(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", RECORDED, CompressionType.LZ4, crc=False)
    offset, _ = chunk_offsets(path.read_bytes())[2]
    found, damage = read(flip(path, [offset + 16 + 5]))
    assert 0 < len(found) < len(RECORDED)
    assert "bytes claimed" in damage[0]


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 10_000), kind=st.sampled_from(["zstd", "none", "plain", "noindex"]))
def test_no_damage_makes_it_crash_or_invent(tmp_path: Path, seed: int, kind: str) -> None:
    chosen = random.Random(seed)
    forms = {"none": {"compression": CompressionType.NONE}, "plain": {"chunked": False}, "noindex": {"index": False}}
    form = forms.get(kind, {})
    path = write_mcap(tmp_path / "a.mcap", RECORDED[:30], **form)  # type: ignore[arg-type]
    flip(path, [chosen.randrange(8, path.stat().st_size) for _ in range(chosen.randrange(1, 6))])
    cut(path, chosen.choice([1.0, 0.97, 0.5]))
    with open_bag(path) as bag:
        found = list(bag.raw_messages())
        list(bag.messages())
    assert [m.log_ns for m in found] == sorted(m.log_ns for m in found) or kind != "zstd"
    if kind in ("zstd", "noindex"):  # chunks have checksums
        assert {m.data for m in found} <= {m.data for m in RECORDED}


@pytest.mark.parametrize("share", [0.9, 0.6, 0.3])
def test_a_database_cut_short(tmp_path: Path, share: float) -> None:
    in_order = recording(60, (24, 32, 3))
    many = [in_order[(i * 7) % len(in_order)] for i in range(len(in_order))]
    path = cut(write_rosbags(tmp_path / "bag", many) / "bag.db3", share)
    found, damage = read(path)
    assert len(found) >= (share - 0.1) * len(many)
    assert {m.data for m in found} <= {m.data for m in many}
    assert [m.log_ns for m in found] == sorted(m.log_ns for m in found)
    assert damage[0].startswith("bag.db3: damaged (cut short: ")


def test_a_database_with_ruined_pages(tmp_path: Path) -> None:
    many = recording(60, (24, 32, 3))
    path = write_rosbags(tmp_path / "bag", many) / "bag.db3"
    data = bytearray(path.read_bytes())
    for page in range(20, len(data) // 4096, 25):
        data[4096 * page : 4096 * page + 64] = b"\xff" * 64
    path.write_bytes(bytes(data))
    found, _ = read(path)
    intact = {m.data for m in many}
    assert sum(m.data in intact for m in found) >= 0.5 * len(many)


def test_a_file_that_is_no_rosbag2_database(tmp_path: Path) -> None:
    import sqlite3

    with closing(sqlite3.connect(tmp_path / "other.db3")) as database, database:
        database.execute("CREATE TABLE poems (title TEXT)")
    with pytest.raises(BagError, match=r"other\.db3: expected a rosbag2 database, got: no such table: topics"):
        open_bag(tmp_path / "other.db3")


def test_a_compressed_file_cut_short(tmp_path: Path) -> None:
    path = write_rosbags(tmp_path / "bag", recording(60, (24, 32, 3)), StoragePlugin.MCAP, CompressionMode.FILE)
    cut(path / "bag.mcap.zstd", 0.5)
    found, damage = read(path)
    assert found
    assert damage


def test_a_compressed_message_that_is_damaged(tmp_path: Path) -> None:
    path = write_rosbags(tmp_path / "bag", RECORDED, StoragePlugin.MCAP, CompressionMode.MESSAGE)
    data = (path / "bag.mcap").read_bytes()
    place = data.index(b"\x28\xb5\x2f\xfd", len(data) // 2)
    found, damage = read(flip(path / "bag.mcap", [place]).parent)
    assert len(found) == len(RECORDED) - 1
    assert len(damage) == 1
    assert "a compressed message at" in damage[0]


def test_split_bag_with_a_missing_and_a_ruined_file(tmp_path: Path) -> None:
    path = write_split(tmp_path / "s", [RECORDED[:20], RECORDED[20:40], RECORDED[40:60], RECORDED[60:]])
    (path / "s_1.mcap").unlink()
    (path / "s_2.mcap").write_bytes(b"rubbish")
    found, damage = read(path)
    assert found == RECORDED[:20] + RECORDED[60:]
    assert damage[0] == "s_1.mcap: named in metadata.yaml, not there"
    assert "s_2.mcap: expected a ROS 2 bag (MCAP or SQLite), got a text file" in damage[1]


@pytest.mark.parametrize("text", [None, "rosbag2_bagfile_information: {version", "[1, 2]", "a: b", "\x00\x01"])
def test_a_folder_without_sound_metadata(tmp_path: Path, text: str | None) -> None:
    path = write_split(tmp_path / "s", [RECORDED[:30], RECORDED[30:]])
    (path / "metadata.yaml").unlink()
    if text is not None:
        (path / "metadata.yaml").write_text(text)
    found, damage = read(path)
    assert found == RECORDED
    assert damage[0].startswith("metadata.yaml: ")


def test_files_without_metadata_are_taken_in_natural_order(tmp_path: Path) -> None:
    path = write_split(tmp_path / "s", [RECORDED[i : i + 6] for i in range(0, 72, 6)])
    (path / "metadata.yaml").unlink()
    assert read(path)[0] == RECORDED[:72]


def test_pairs_with_a_broken_image_are_left_out_and_named(tmp_path: Path) -> None:
    recorded = list(RECORDED[:8])
    short = image_bytes(9, 100_000_000)[:-300]
    recorded[2] = RawMessage("/left/image_raw", IMAGE, recorded[2].log_ns, short)
    small = image_bytes(9, 200_000_000, (6, 8, 3))
    recorded[5] = RawMessage("/right/image_raw", IMAGE, recorded[5].log_ns, small)
    with open_bag(write_mcap(tmp_path / "a.mcap", recorded)) as bag:
        assert [pair.stamp_ns for pair in bag.stereo_pairs()] == [0, 300_000_000]
        damage = bag.damage
    assert damage[0].startswith("/left/image_raw: ")
    assert damage[1] == (
        "pair at 200000000 ns left out: pair: expected two images of one size, "
        "got left 16x12 px colour 8 bits and right 8x6 px colour 8 bits: are both of one camera mode?"
    )
