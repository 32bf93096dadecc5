"""A thousand spoiled bags: none makes the readers crash, hang, or take memory for what is not there."""

from __future__ import annotations

import contextlib
import io
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.bag_makers import cut, recording, write_mcap, write_rosbags
from helpers.bag_mutants import (
    CHANNEL,
    CHUNK,
    DATABASE_JOBS,
    SCHEMA,
    bomb,
    calibrated,
    chunk,
    database_mutant,
    joined,
    make_bases,
    mutant,
    split,
)
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from uw_recon_ros.bags import open_bag
from uw_recon_ros.cli import main
from uw_recon_ros.errors import BagError

MUTANTS = 1000
GROUPS = 8  # of the mutants, so that they spread over the workers
TIME_LIMIT_S = 30
MEMORY_LIMIT_MB = 160
RECORDED = calibrated(6)


@contextlib.contextmanager
def within(seconds: int) -> Iterator[None]:
    """A limit on hanging."""

    def late(*_: object) -> None:
        raise TimeoutError(f"not done within {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def memory_mb(name: str) -> float:
    """VmRSS, or VmHWM since it was last set back."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith(name)) / 1024


@contextlib.contextmanager
def bounded() -> Iterator[None]:
    """A limit on time and on memory."""
    Path("/proc/self/clear_refs").write_text("5")
    before = memory_mb("VmRSS")
    with within(TIME_LIMIT_S):
        yield
    assert memory_mb("VmHWM") - before < MEMORY_LIMIT_MB


def info(path: Path) -> tuple[int, str]:
    """Exit code and last words of ``uw_recon info``."""
    told, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(errors):
        code = main(["info", str(path)])
    assert all(line.isprintable() for line in (told.getvalue() + errors.getvalue()).splitlines())
    return code, errors.getvalue()


def read(path: Path) -> int:
    """Messages that every way of reading takes."""
    with open_bag(path) as bag:
        found = list(bag.raw_messages())
        assert all(0 <= message.log_ns < 2**31 * 10**9 for message in found)
        list(bag.messages())
        with contextlib.suppress(BagError):
            list(bag.stereo_pairs())
        assert all(sentence.isprintable() and len(sentence) < 600 for sentence in bag.damage)
        assert len(bag.damage) < 4000
        return len(found)


def survives(path: Path) -> int:
    """What can be read is read; what cannot is one `BagError`, or one line and exit code 1."""
    with bounded():
        code, words = info(path)
        assert code in (0, 1)
        try:
            number = read(path)
        except BagError:
            assert code == 1
            assert len(words.splitlines()) == 1
            return 0
    return number


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    return make_bases(tmp_path_factory.mktemp("bases"), RECORDED)


@pytest.mark.parametrize("group", range(GROUPS))
def test_spoiled_bags_are_survived(tmp_path: Path, bases: list[bytes], group: int) -> None:
    numbers = []
    for seed in range(group, MUTANTS, GROUPS):
        data, what = mutant(bases, seed)
        path = tmp_path / "spoiled.mcap"
        path.write_bytes(data)
        try:
            numbers.append(survives(path))
        except BaseException as error:
            error.add_note(what) if hasattr(error, "add_note") else None
            raise
    assert sum(number > 0 for number in numbers) > 0.5 * len(numbers), "most still hold something"
    assert sum(number < len(RECORDED) for number in numbers) > 0.3 * len(numbers), "and many not all"


def test_spoiled_databases_are_survived(tmp_path: Path) -> None:
    for seed in range(len(DATABASE_JOBS) + 40):
        path, what = database_mutant(tmp_path, RECORDED, seed)
        try:
            survives(path)
        except BaseException as error:
            error.add_note(what) if hasattr(error, "add_note") else None
            raise


LAUGHS = "".join(f"{c}: &{c} [{', '.join(['*' + b] * 10)}]\n" for b, c in zip("abcdefgh", "bcdefghi", strict=True))
METADATA = (
    f"a: &a [x, x, x]\n{LAUGHS}rosbag2_bagfile_information: {{relative_file_paths: [*i]}}",
    "[" * 100_000,
    "rosbag2_bagfile_information: {relative_file_paths: [../../etc/passwd, /etc/passwd, .., '']}",
    "rosbag2_bagfile_information: {relative_file_paths: 5}",
    "!!python/object/apply:os.system ['touch owned']",
    "x" * 5_000_000,
    "\x00\x1b[2J",
    "rosbag2_bagfile_information: 2001-99-99",
)  # fmt: skip


@pytest.mark.parametrize("rank", range(len(METADATA)))
def test_metadata_that_would_blow_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, rank: int) -> None:
    monkeypatch.chdir(tmp_path)
    folder = write_rosbags(tmp_path / "bag", recording(3), StoragePlugin.MCAP)
    (folder / "metadata.yaml").write_text(METADATA[rank])
    survives(folder)
    assert not (tmp_path / "owned").exists()


def test_a_packed_file_that_becomes_too_much(tmp_path: Path) -> None:
    import zstandard

    folder = write_rosbags(tmp_path / "bag", recording(3), StoragePlugin.MCAP, CompressionMode.FILE)
    packed = folder / "bag.mcap.zstd"
    sound = zstandard.ZstdDecompressor().decompressobj().decompress(packed.read_bytes())
    compressor = zstandard.ZstdCompressor().compressobj()
    with packed.open("wb") as stream:
        stream.write(compressor.compress(sound))
        for _ in range(300):
            stream.write(compressor.compress(bytes(2**20)))
        stream.write(compressor.flush())
    assert survives(packed) == 6
    with open_bag(packed) as bag:
        assert "larger than any recording, or than the disk" in bag.damage[0]


def test_packed_messages_that_become_too_much(tmp_path: Path) -> None:
    import zstandard

    from uw_recon_ros.bags.model import RawMessage

    zeros = zstandard.compress(bytes(2**29))
    recorded = recording(3)
    recorded[1] = RawMessage(recorded[1].topic, recorded[1].type, recorded[1].log_ns, zeros)
    for i in (0, 2, 3, 4, 5):
        recorded[i] = RawMessage(
            recorded[i].topic, recorded[i].type, recorded[i].log_ns, zstandard.compress(recorded[i].data)
        )
    folder = tmp_path / "bag"
    folder.mkdir()
    write_mcap(folder / "bag.mcap", recorded)
    (folder / "metadata.yaml").write_text(
        "rosbag2_bagfile_information: {relative_file_paths: [bag.mcap], compression_mode: MESSAGE}"
    )
    assert survives(folder) == 5


def test_one_moment_does_not_hold_the_whole_recording(tmp_path: Path) -> None:
    """Chunks that all claim the same time would all be held at once: at most 1 GiB of them is."""
    import uw_recon_ros.bags.mcap_file as mcap_file

    records = split(write_mcap(tmp_path / "a.mcap", RECORDED, index=False).read_bytes())
    head = [record for record in records if record[0] in (1, SCHEMA, CHANNEL)]
    first = next(content for opcode, content in records if opcode == CHUNK)
    many = [(CHUNK, first)] * 50
    path = tmp_path / "same.mcap"
    path.write_bytes(joined([*head, *many]))
    with open_bag(path) as bag:
        everything = len(list(bag.raw_messages()))
        assert everything >= 50
        assert not [said for said in bag.damage if "overlapping" in said]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(mcap_file, "_MOST_HELD", 10_000)
        with open_bag(path) as bag:
            assert 0 < len(list(bag.raw_messages())) < everything / 5
            assert "bytes of overlapping chunks" in bag.damage[1] + bag.damage[0]


def test_what_a_bag_says_of_itself_is_fit_for_a_terminal(tmp_path: Path) -> None:
    path = write_mcap(tmp_path / "a.mcap", recording(3, topics=("/left/image_raw\x1b[2J", "/right/image_raw")))
    assert info(path)[0] == 1  # one camera is left
    with open_bag(path) as bag:
        assert [topic.name for topic in bag.topics] == ["/right/image_raw"]
        assert "left out: no name for a topic" in bag.damage[0]


def test_the_mutants_can_find_something() -> None:
    """Bombs are what they say, and a cut is a cut."""
    assert len(bomb(2**24)) < 10_000
    assert chunk(5, b"12345", b"")[16:24] == (5).to_bytes(8, "little")
    assert cut is not None
