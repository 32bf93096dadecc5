"""Shared memory of the dead is freed, of the living never."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from uw_recon_ros.ros.fastdds_segments import remove_orphans

LATER = 1e12


def make(folder: Path, name: str, size: int = 1000) -> tuple[Path, Path]:
    segment, lock = folder / name, folder / f"{name}_el"
    segment.write_bytes(bytes(size))
    lock.touch()
    return segment, lock


def test_an_orphan_goes_and_a_living_owners_stays(tmp_path: Path) -> None:
    dead, living = make(tmp_path, "fastrtps_" + "0a" * 8), make(tmp_path, "fastrtps_" + "1b" * 8)
    with living[1].open() as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert remove_orphans(tmp_path, LATER) == 1000
        assert not any(path.exists() for path in dead)
        assert all(path.exists() for path in living)
    assert remove_orphans(tmp_path, LATER) == 1000  # its owner is gone now
    assert list(tmp_path.iterdir()) == []


def test_one_just_made_is_not_an_orphan_yet(tmp_path: Path) -> None:
    """Its owner may be about to lock it."""
    paths = make(tmp_path, "fastdds_" + "0a" * 8)
    assert remove_orphans(tmp_path) == 0
    assert all(path.exists() for path in paths)


def test_other_files_are_left_alone(tmp_path: Path) -> None:
    others = {"sem.fastrtps_port7000_mutex", "fastrtps_port7000", "fastrtps_port7000_el", "psm_1234", "notes_el"}
    for name in others:
        (tmp_path / name).write_bytes(b"x")
    target = tmp_path / "elsewhere"
    target.mkdir()
    (target / "file").touch()
    os.symlink(target / "file", tmp_path / ("fastrtps_" + "2c" * 8 + "_el"))
    assert remove_orphans(tmp_path, LATER) == 0
    assert {path.name for path in tmp_path.iterdir()} >= others
    assert (target / "file").exists()


def test_a_folder_that_is_not_there(tmp_path: Path) -> None:
    assert remove_orphans(tmp_path / "nothing") == 0
