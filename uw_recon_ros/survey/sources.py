"""From the paths a user gives to what can be read: bags, folders of bags, folders of stills."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from uw_recon_ros.bags.files import natural_order
from uw_recon_ros.bags.pack import find_images
from uw_recon_ros.calibration.rectified import came_rectified
from uw_recon_ros.errors import BagError
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.files.kinds import describe_file
from uw_recon_ros.survey.pair_index import Rigs
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.system_errors import reason, told_as

_FIRST_NS = 1_000_000_000  # as `pack` counts


def list_stills(
    source: Source, params: SurveyParams, rigs: Rigs, notes: list[str]
) -> Iterator[tuple[int, str, str, int]]:
    """Yield stamp (ns), left file, right file and rig of every pair.

    Files are paired by the last number in their names where all have different ones, else by order.

    Raises
    ------
    BagError
        The two folders do not go together.
    """
    folders = camera_folders(Path(source.path))
    if folders is None:
        raise BagError(f"{source.name}: expected the stills of both cameras in left/ and right/")
    left, right = (find_images(str(folder)) for folder in folders)
    rig_file = calibration_file(source)
    rectified = came_rectified(rigs.images_rectified)
    rig = rigs.index(read_calibration(rig_file) if rig_file else None, (rectified, rectified))
    for rank, (one, other) in enumerate(_paired(source, left, right, notes)):
        if one and other:
            yield _FIRST_NS + round(rank * 1e9 / params.stills_rate), str(one), str(other), rig


def _paired(
    source: Source, left: list[Path], right: list[Path], notes: list[str]
) -> list[tuple[Path | None, Path | None]]:
    """Partners side by side in order; None where there is no partner, so that time goes on."""
    numbered = [_by_number(left), _by_number(right)]
    common = numbered[0].keys() & numbered[1].keys()
    unique = len(numbered[0]) == len(left) and len(numbered[1]) == len(right)
    if unique and 2 * len(common) >= min(len(left), len(right)):
        for side, mine in zip(("left", "right"), numbered, strict=True):
            alone = [path.name for number, path in mine.items() if number not in common]
            if alone:
                notes.append(f"{source.name}: {len(alone)} {side} stills have no partner, first {alone[0]}")
        everything = sorted(numbered[0].keys() | numbered[1].keys())
        return [(numbered[0].get(number), numbered[1].get(number)) for number in everything]
    if len(left) != len(right):
        raise BagError(f"{source.name}: expected as many left as right stills, got {len(left)} and {len(right)}")
    return list(zip(left, right, strict=True))


def _by_number(paths: list[Path]) -> dict[int, Path]:
    found = ((re.findall(r"[0-9]+", path.stem), path) for path in paths)
    return {int(digits[-1]): path for digits, path in found if digits}


CAMERA_FOLDERS = (("left", "right"), ("cam0", "cam1"), ("camera0", "camera1"), ("l", "r"), ("0", "1"))
_BAG_SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_CALIBRATION = "calibration.yaml"
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Source:
    """One recording.

    Parameters
    ----------
    kind : {'bag', 'stills'}
    path : str
        Absolute.
    name : str
        What reports call it: the path's last part.
    """

    kind: Literal["bag", "stills"]
    path: str
    name: str


def find_sources(paths: Iterable[str | Path]) -> list[Source]:
    """Look at what each path is: a bag, a folder of stills, or a folder of either.

    Raises
    ------
    BagError
        A path that is none of it.
    """
    return [source for path in paths for source in _sources_at(Path(path))]


def _sources_at(path: Path) -> list[Source]:
    with told_as(BagError, path, "a bag or a folder"):
        path.stat()
        return _sources_in(path)


def _sources_in(path: Path) -> list[Source]:
    own = _source(path)
    if own is None and not path.is_dir():
        raise BagError(f"{path}: expected a ROS 2 bag (a folder, .mcap or .db3), got {describe_file(path)}")
    if own and not _holds_bag_folders(path):
        return [own]
    inside = [_source(child) for child in sorted(path.iterdir(), key=natural_order)]
    found = [source for source in inside if source is not None]
    if not found:
        raise BagError(
            f"{path}: expected a bag, a folder of bags, or a folder with the stills of both cameras in left/ and right/"
        )
    return found


def _holds_bag_folders(path: Path) -> bool:
    """Whether a folder is a collection: files of one bag have no folders of bags beside them."""
    if path.is_file() or (path / "metadata.yaml").is_file():
        return False
    return any(child.is_dir() and _source(child) for child in path.iterdir())


def _source(path: Path) -> Source | None:
    if path.is_file():
        is_bag = path.name.endswith(_BAG_SUFFIXES)
    else:
        is_bag = (path / "metadata.yaml").is_file() or any(f.name.endswith(_BAG_SUFFIXES) for f in path.iterdir())
    if is_bag:
        return Source("bag", str(path.absolute()), path.absolute().name)
    return (
        Source("stills", str(path.absolute()), path.absolute().name) if path.is_dir() and camera_folders(path) else None
    )


def camera_folders(path: Path) -> tuple[Path, Path] | None:
    """The two folders that hold the stills of either camera."""
    folders = {child.name.lower(): child for child in path.iterdir() if child.is_dir()}
    for left, right in CAMERA_FOLDERS:
        if left in folders and right in folders:
            return folders[left], folders[right]
    return None


def calibration_file(source: Source) -> Path | None:
    """The ``calibration.yaml`` beside stills."""
    file = Path(source.path) / _CALIBRATION
    return file if source.kind == "stills" and file.is_file() else None


def source_files(source: Source) -> list[Path]:
    """All files a source is read from, in natural order."""
    path = Path(source.path)
    if path.is_file():
        return [path]
    if source.kind == "bag":
        return sorted((file for file in path.iterdir() if file.is_file()), key=natural_order)
    sides = camera_folders(path) or ()
    stills = [file for folder in sides for file in find_images(str(folder))]
    beside = calibration_file(source)
    return [*stills, beside] if beside else stills


def fingerprint(source: Source, on_bytes: Callable[[int], None] = lambda count: None) -> dict[str, str]:
    """SHA-256 of every file of a source, by its path inside the source.

    Raises
    ------
    BagError
        A file cannot be read.
    """
    root = Path(source.path)
    base = root.parent if root.is_file() else root
    return {file.relative_to(base).as_posix(): sha256(file, on_bytes) for file in source_files(source)}


def digests(path: str | Path) -> list[str]:
    """SHA-256 of a file, or of the files right in a folder, by name."""
    path = Path(path)
    with told_as(BagError, path, "a file or a folder"):
        files = sorted(file for file in path.iterdir() if file.is_file()) if path.is_dir() else [path]
    return [sha256(file) for file in files]


def sha256(path: str | Path, on_bytes: Callable[[int], None] = lambda count: None) -> str:
    """Digest of a file, read in pieces."""
    digest = hashlib.sha256()
    try:
        with Path(path).open("rb") as stream:
            while block := stream.read(_BLOCK):
                digest.update(block)
                on_bytes(len(block))
    except OSError as error:
        raise BagError(f"{path}: cannot be read: {reason(error)}") from error
    return digest.hexdigest()
