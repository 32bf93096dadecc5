"""From the path a user gives to the files of a bag: folder or bare file, split, compressed, incomplete."""

from __future__ import annotations

import re
import shutil
import tempfile
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

import zstandard

from uw_recon_ros.bags.mcap_chunk import reason_of
from uw_recon_ros.bags.mcap_file import McapFile
from uw_recon_ros.bags.mcap_index import MAGIC as MCAP_MAGIC
from uw_recon_ros.bags.model import Storage
from uw_recon_ros.bags.ros1_file import MAGIC as ROS1_MAGIC
from uw_recon_ros.bags.ros1_file import Ros1File
from uw_recon_ros.bags.sqlite_file import SqliteFile
from uw_recon_ros.bounds import SPARE_BYTES, unpacked_limit
from uw_recon_ros.errors import BagError
from uw_recon_ros.files import strict_yaml
from uw_recon_ros.files.bounded import expect_file
from uw_recon_ros.files.kinds import HEAD, describe
from uw_recon_ros.system_errors import reason

_SQLITE_MAGIC = b"SQLite format 3\0"
_ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"

_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")


@dataclass
class BagFiles:
    """The opened files of one bag.

    Parameters
    ----------
    storages : list of Storage
    compressed_messages : bool
        Whether each message is zstd-compressed on its own.
    damage : list of str
        What is wrong with the folder itself.
    temporary : TemporaryDirectory or None
        Where compressed files were unpacked.
    """

    storages: list[Storage] = field(default_factory=list)
    compressed_messages: bool = False
    damage: list[str] = field(default_factory=list)
    temporary: tempfile.TemporaryDirectory[str] | None = None

    def close(self) -> None:
        """Close the files and remove what was unpacked."""
        for storage in self.storages:
            storage.close()
        if self.temporary is not None:
            self.temporary.cleanup()


def open_files(path: Path) -> BagFiles:
    """Open a bag's files.

    Raises
    ------
    BagError
        In one line, when none of them can be read.
    """
    files = BagFiles()
    try:
        paths = _folder(path, files) if path.is_dir() else [path]
        for file in paths:
            _open_one(file, files, alone=len(paths) == 1)
        if not files.storages:
            raise BagError(f"{path}: nothing in it can be read: {'; '.join(files.damage)}")
    except OSError as error:
        files.close()
        raise BagError(f"{path}: expected a bag, cannot be read: {reason(error)}") from error
    except BaseException:
        files.close()
        raise
    return files


def _folder(path: Path, files: BagFiles) -> list[Path]:
    """Files of a rosbag2 folder, in order; those that are missing are noted."""
    there = sorted((f for f in path.iterdir() if f.name.endswith(_SUFFIXES) and f.is_file()), key=natural_order)
    try:
        metadata = _read_metadata(path / "metadata.yaml")
    except BagError as error:
        if not there:
            raise BagError(f"{path}: expected a bag, got a folder without .mcap or .db3 files") from error
        files.damage.append(str(error))
        return there
    files.compressed_messages = metadata.get("compression_mode") in ("message", "MESSAGE")
    named = [_find(path, name) for name in metadata["relative_file_paths"]]
    files.damage += [f"{file.name}: named in metadata.yaml, not there" for file in named if not file.is_file()]
    present = [file for file in named if file.is_file()]
    if not present:
        raise BagError(f"{path}: none of the {len(named)} files named in metadata.yaml is there")
    return present


def _find(folder: Path, name: str) -> Path:
    """The file's last name only: a bag never leads out of its folder. A recorder that crashed names it uncompressed."""
    file = folder / PurePosixPath(name).name
    packed = file.with_name(file.name + ".zstd")
    return packed if packed.is_file() and not file.is_file() else file


def _read_metadata(path: Path) -> dict[str, Any]:
    try:
        document = strict_yaml.read(path)
    except strict_yaml.YamlError as error:
        raise BagError(f"{path.name}: expected a rosbag2 description: {error}") from error
    metadata = document.get("rosbag2_bagfile_information") if isinstance(document, dict) else None
    names = metadata.get("relative_file_paths") if isinstance(metadata, dict) else None
    if not (isinstance(metadata, dict) and isinstance(names, list) and all(isinstance(name, str) for name in names)):
        raise BagError(f"{path.name}: expected a rosbag2 description, it names no list of relative_file_paths")
    return metadata


def _open_one(path: Path, files: BagFiles, alone: bool) -> None:
    """Open a file; its failure is fatal only for a bag of one file."""
    try:
        storage = _by_content(path, files)
    except BagError as error:
        if alone:
            raise
        files.damage.append(str(error))
    else:
        files.storages.append(storage)


def _by_content(path: Path, files: BagFiles) -> Storage:
    name = path.name
    try:
        given_size = expect_file(path, BagError)
        with path.open("rb") as stream:
            head = stream.read(HEAD)
        if head.startswith(_ZSTD_MAGIC):
            path = _unpack(path, files)
            with path.open("rb") as stream:
                head = stream.read(HEAD)
        if head.startswith(MCAP_MAGIC):
            return McapFile(path, name, given_size)
        if head.startswith(_SQLITE_MAGIC):
            return SqliteFile(path, name)
        if head.startswith(ROS1_MAGIC):
            return Ros1File(path, name)
    except OSError as error:
        raise BagError(f"{path}: expected a bag, cannot be read: {reason(error)}") from error
    raise BagError(f"{path}: expected a ROS 2 bag (MCAP or SQLite), got {describe(head)}")


def _unpack(path: Path, files: BagFiles) -> Path:
    """Decompress a file to a temporary one, as far as it goes."""
    if files.temporary is None:
        files.temporary = tempfile.TemporaryDirectory(prefix="uw_recon_ros-bag-")
    unpacked = Path(files.temporary.name) / f"{len(files.storages)}-{len(files.damage)}"
    left = min(unpacked_limit(path.stat().st_size), shutil.disk_usage(files.temporary.name).free - SPARE_BYTES)
    with path.open("rb") as packed, unpacked.open("wb") as target:
        try:
            for piece in zstandard.ZstdDecompressor().read_to_iter(packed):
                left -= len(piece)
                if left < 0:
                    raise ValueError("larger than any recording, or than the disk")
                target.write(piece)
        except (zstandard.ZstdError, ValueError) as error:
            files.damage.append(f"{path.name}: compressed file damaged ({reason_of(error)}): what follows is lost")
    return unpacked


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key that counts as people do: frame_2 before frame_10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"([0-9]+)", path.name)]
