"""Every subcommand given what nobody means: one line that says what, got and expected, and never a library's words."""

from __future__ import annotations

import errno
import os
import re
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from helpers.process_watch import unmeasured

from uw_recon_ros import cli, system_errors
from uw_recon_ros.cli import main
from uw_recon_ros.errors import ReconError
from uw_recon_ros.files.bounded import read_bounded
from uw_recon_ros.files.images import write_image
from uw_recon_ros.system_errors import explain

#: Words that only a machine or a library says.
FOREIGN = re.compile(
    r"Errno|errno|Traceback|broadcast|object has no attribute|NoneType|zstd\.|ZstdError|McapError|yaml\.|cv2\.|OpenCV\("
    r"|while (scanning|parsing)|unpack(_from| requires)|codec can|expected str|Invalid argument|No such|Not a directory"
    r"|Is a directory"
)
TINY = 48, 64


def make_wrong(folder: Path) -> dict[str, Path]:
    """Files and folders of the wrong kind, by name."""
    folder.mkdir()
    contents = {
        "video.mp4": b"\0\0\0\x20ftypisom\0\0\2\0isomiso2avc1mp41" + bytes(4000),
        "ros1.bag": b"#ROSBAG V2.0\n" + bytes(4096),
        "archive.zip": b"PK\3\4" + bytes(200),
        "notes.txt": b"left: right\n[and so on\n",
        "empty": b"",
        "noise": bytes(np.random.default_rng(1).integers(0, 256, 5000, np.uint8)),
        "cut.mcap": b"\x89MCAP0\r\n",
        "cut.db3": b"SQLite format 3\0" + bytes(100),
        "cut.png": b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR",
        "nul\\.yaml": b"a: \0",
    }
    for name, content in contents.items():
        (folder / name).write_bytes(content)
    (folder / "folder").mkdir()
    os.mkfifo(folder / "pipe")
    (folder / "loop").symlink_to(folder / "loop")
    names = [*contents, "folder", "pipe", "loop", "missing", "notes.txt/inside", "x" * 300]
    return {name: folder / name for name in names}


WRONG = (
    "video.mp4", "ros1.bag", "archive.zip", "notes.txt", "empty", "noise", "cut.mcap", "cut.db3", "cut.png",
    "nul\\.yaml", "folder", "pipe", "loop", "missing", "notes.txt/inside", "x" * 300,
)  # fmt: skip


@pytest.fixture(scope="module")
def wrong(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return make_wrong(tmp_path_factory.mktemp("doors") / "wrong")


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("doors") / "good.png"
    write_image(path, np.random.default_rng(0).integers(0, 256, TINY, np.uint8))
    return path


Door = Callable[[str, str, str], list[str]]
DOORS: dict[str, Door] = {
    "pair": lambda wrong, good, out: ["pair", wrong, good, "-o", out],
    "pair, calibration": lambda wrong, good, out: ["pair", good, good, "-o", out, "--calibration", wrong],
    "pair, parameters": lambda wrong, good, out: ["pair", good, good, "-o", out, "--params", wrong],
    "disparity": lambda wrong, good, out: ["disparity", good, wrong, "-o", f"{out}.pfm"],
    "pack": lambda wrong, good, out: ["pack", "--left", wrong, "--right", good, "-o", out],
    "pack, calibration": lambda wrong, good, out: ["pack", "--left", good, "--right", good, "-o", out,
                                                   "--calibration", wrong],
    "info": lambda wrong, good, out: ["info", wrong],
    "survey": lambda wrong, good, out: ["survey", wrong, "-o", out],
    "evaluate": lambda wrong, good, out: ["evaluate", wrong, good],
    "evaluate, mask": lambda wrong, good, out: ["evaluate", good, good, "--mask", wrong],
}  # fmt: skip


def told_in_one_line(capfd: pytest.CaptureFixture[str]) -> str:
    text = capfd.readouterr().err
    lines = [line for line in text.splitlines() if not line.startswith("compiling")]
    assert len(lines) == 1, text
    assert lines[0].startswith("uw_recon: ")
    assert not FOREIGN.search(lines[0]), lines[0]
    assert "internal error" not in lines[0], lines[0]
    assert len(lines[0]) < 1200
    return lines[0]


@pytest.mark.parametrize("kind", WRONG)
@pytest.mark.parametrize("door", DOORS)
def test_wrong_inputs(
    door: str, kind: str, wrong: dict[str, Path], good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    if (door, kind) == ("pair, parameters", "empty"):
        pytest.skip("an empty parameter file is one without wishes")
    code = main(DOORS[door](str(wrong[kind]), str(good), str(tmp_path / "out")))
    assert code in (1, 2)
    told = told_in_one_line(capfd)
    assert "expected" in told or ": there is no" in told


@pytest.mark.parametrize("door", ["pair", "disparity", "pack", "survey", "simulate"])
@pytest.mark.parametrize("place", ["notes.txt/out", "x" * 300 + "/out", "loop/out"])
def test_places_where_nothing_can_be_written(
    door: str, place: str, wrong: dict[str, Path], good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    other = tmp_path / "right" / "a.png"
    other.parent.mkdir()
    (tmp_path / "left").mkdir()
    for target in (other, tmp_path / "left" / "a.png"):
        shutil.copy(good, target)
    out = str(wrong["empty"].parent / place)
    arguments = {
        "pair": ["pair", str(good), str(other), "-o", out],
        "disparity": ["disparity", str(good), str(other), "-o", f"{out}.pfm", "--max-disparity", "4"],
        "pack": ["pack", "--left", str(good), "--right", str(other), "-o", out],
        "survey": ["survey", str(tmp_path), "-o", out],
        "simulate": ["simulate", "-o", out, "--frames", "1", "--width", "64", "--height", "48"],
    }
    assert main(arguments[door]) in (1, 2)
    told = [line for line in capfd.readouterr().err.splitlines() if line.startswith("uw_recon: ")]
    assert len(told) == 1
    assert not FOREIGN.search(told[0]), told[0]
    assert "internal error" not in told[0], told[0]


def test_a_full_disk(good: Path, tmp_path: Path) -> None:
    """A limit on the size of files stands for it: writing fails in the middle, and nothing half is left."""
    code = "import sys; from uw_recon_ros.cli import main; sys.exit(main(sys.argv[1:]))"
    folder = tmp_path / "pictures"
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
        picture = np.random.default_rng(len(side)).integers(0, 256, (300, 400), np.uint8)
        write_image(folder / side / "1.png", picture)
    out = tmp_path / "out"
    done = subprocess.run(
        [sys.executable, "-c", code, "pack", "--left", str(folder / "left"), "--right", str(folder / "right"), "-o",
         str(out)],
        capture_output=True, text=True, check=False, timeout=120,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (2**16, 2**16)),
        env=unmeasured(),
    )  # fmt: skip
    assert done.returncode == 1
    assert "larger than this file system or a limit on this process allows" in done.stderr
    assert not FOREIGN.search(done.stderr)
    assert not out.exists()
    assert {p.name for p in tmp_path.iterdir()} == {"pictures"}


@pytest.mark.skipif(os.geteuid() == 0, reason="root may read everything")
def test_no_permission(good: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    locked = tmp_path / "locked.png"
    shutil.copy(good, locked)
    locked.chmod(0)
    assert main(["pair", str(locked), str(good), "-o", str(tmp_path / "out")]) == 1
    assert "no permission" in told_in_one_line(capfd)


@pytest.mark.parametrize("number", [errno.EACCES, errno.ENOSPC, errno.EROFS, errno.EMFILE, errno.EIO, 9999])
def test_each_refusal_of_the_system_is_a_sentence_with_advice(
    number: int, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def refuse(_: object) -> int:
        raise OSError(number, os.strerror(number), "/some/where")

    monkeypatch.setattr(cli.info, "run", refuse)
    assert main(["info", "x"]) == 1
    told = told_in_one_line(capfd)
    assert told.startswith("uw_recon: /some/where: ")
    assert told.count(":") >= 3 or number == errno.EROFS
    assert explain(OSError("what a library says")) == "the system refused it (OSError): check the disk and the name"


def test_an_error_nobody_foresaw_is_called_ours(
    monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(_: object) -> int:
        np.zeros((0, 4))[:] = np.zeros((1, 5))
        return 0

    monkeypatch.setattr(cli.info, "run", fail)
    for trace in (False, True):
        monkeypatch.setenv(system_errors.TRACEBACK, "1" if trace else "")
        assert main(["info", "x"]) == cli.OUR_FAULT == 70
        told = capfd.readouterr().err
        assert "internal error, not a fault of your data (ValueError at test_doors.py:" in told
        assert "please report it" in told
        assert ("Traceback" in told) == trace


def test_files_are_read_whole_up_to_a_bound(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(bytes(10))
    assert read_bounded(tmp_path / "a", 10) == bytes(10)
    with pytest.raises(ReconError, match="expected at most 9 bytes, got 10"):
        read_bounded(tmp_path / "a", 9)
    with pytest.raises(ReconError, match="a name that no file can have"):
        read_bounded("a\0b", 9)
    with pytest.raises(ReconError, match="got a pipe or a device"):
        read_bounded("/dev/zero", 9)


def test_a_pair_without_any_depth(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """It was "could not broadcast input array from shape (0,5) into shape (0,4)"."""
    from uw_recon_ros.files.calibrations import write_calibration
    from uw_recon_ros.simulate import Dive, SimulateParams

    dive = Dive(SimulateParams(width=128, height=96, frames=1))
    write_calibration(dive.calibration, tmp_path / "rig.yaml")
    names = []
    for number, name in enumerate(("left", "right")):
        image = np.full((96, 128), 90 + number, np.uint8)
        write_image(tmp_path / f"{name}.png", image)
        names.append(str(tmp_path / f"{name}.png"))
    out = tmp_path / "out"
    assert main(["pair", *names, "-o", str(out), "--calibration", str(tmp_path / "rig.yaml")]) == 1
    told = [line for line in capfd.readouterr().err.splitlines() if line.startswith("uw_recon: ")]
    assert len(told) == 1
    assert not FOREIGN.search(told[0]), told[0]
    assert "internal error" not in told[0]
    assert (out / "report.json").exists()


def test_a_long_thin_image_takes_no_more_than_a_few_times_its_pixels() -> None:
    """65536 x 1 px asked for 17 GB; the address space here has room for half of one."""
    code = """
import resource
import numpy as np
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import StereoPair
thin = np.random.default_rng(0).integers(0, 256, (1, 65536), np.uint8)
room = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize() + 2**29
resource.setrlimit(resource.RLIMIT_AS, (room, room))
assert Preprocess(PreprocessParams())(StereoPair(thin, thin)).left.shape == (1, 65536, 3)
"""
    done = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env={**os.environ, "MALLOC_ARENA_MAX": "1"},  # each thread's arena reserves address space that it does not use
    )
    assert done.returncode == 0, done.stderr[-1500:]
