"""Where the stills of either camera lie: two folders, however named and nested, or one with names that tell."""

from __future__ import annotations

import glob
import re
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

from uw_recon_ros.bags.files import natural_order
from uw_recon_ros.camera_sides import NUMBERED, pairs_of, partners
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.raw_photographs import SUFFIXES as RAW
from uw_recon_ros.files.raw_photographs import expect_library
from uw_recon_ros.findings import Code
from uw_recon_ros.system_errors import told_as

IMAGES = frozenset((".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".pgm", ".ppm", ".webp", ".jp2", ".mpo"))
#: A camera's number or letter in the name of a file; that of other words counts the stills.
_CAMERA = re.compile(r"cam(?:era)?[_-]?(?:[0-9]{1,2}|[a-g])(?![0-9a-z])", re.IGNORECASE)
_DEEPEST = 4
_MOST = 1_000_000


def camera_folders(path: Path) -> tuple[tuple[Path, Path] | None, list[str]]:
    """The two folders of a rig's cameras in a folder, and the names of other such pairs and cameras.

    Raises
    ------
    BagError
        Several rigs are named equally well.
    """
    folders = {child.name: child for child in path.iterdir() if child.is_dir()}
    named = pairs_of(list(folders))
    if not named:
        return None, []
    found, grade = _disjoint(named), named[0][0]
    equal = [pair for pair in named if pair[0] == grade]  # of a row of cameras, too, nobody knows which two are the rig
    if len(equal) > 1:
        told = "; ".join(f"{left} and {right}" for _, left, right in equal)
        raise BagError(
            f"{path}: expected one rig, got several: {told}: give each a folder of its own, or link its two there as "
            "left/ and right/", Code.RECORDING_SEVERAL_RIGS,
        )  # fmt: skip
    _, left, right = found[0]
    paired = {name for pair in found for name in pair[1:]}
    alone = sorted({name for pair in named for name in pair[1:]} - paired)
    return (folders[left], folders[right]), [*(f"{one} and {other}" for _, one, other in found[1:]), *alone]


def _disjoint(found: list[tuple[int, str, str]]) -> list[tuple[int, str, str]]:
    """Pairs without those that use a name of a better one."""
    kept: list[tuple[int, str, str]] = []
    for pair in found:
        if not {pair[1], pair[2]} & {name for other in kept for name in other[1:]}:
            kept.append(pair)
    return kept


def find_images(pattern: str) -> list[Path]:
    """Image files a glob pattern or folder names, in natural order; a folder without any is looked into deeper.

    Raises
    ------
    BagError
        There are none; the text says what is there instead.
    """
    with told_as(BagError, pattern, "image files"):
        folder = Path(pattern).expanduser()
        paths = (
            images_in(folder)
            if folder.is_dir()
            else [p for p in map(Path, glob.glob(str(folder), recursive=True)) if p.is_file()]
        )
        if not paths:
            raise BagError(f"{pattern}: expected image files, found {what_is_in(folder)}")
    for suffix in sorted(RAW & {path.suffix.lower() for path in paths}):
        try:
            expect_library(suffix)
        except ImageError as error:
            raise BagError(f"{pattern}: {error}", error.code) from error
    return sorted(
        paths,
        key=lambda path: ([natural_order(Path(part)) for part in path.parent.parts], natural_order(path), str(path)),
    )


def images_in(folder: Path, depth: int = 0) -> list[Path]:
    """Image files of a folder, or, where it has none, of the folders in it (``data/``, ``DCIM/100GOPRO/``).

    Raw photographs only where there are no others: cameras write both of one moment.
    """
    children = [child for _, child in zip(range(_MOST), folder.iterdir(), strict=False)]
    here = [
        child
        for child in children
        if child.suffix.lower() in IMAGES | RAW and child.is_file() and not child.name.startswith(".")
    ]
    here = [child for child in here if child.suffix.lower() in IMAGES] or here
    if here or depth == _DEEPEST:
        return here
    return [image for child in children if child.is_dir() for image in images_in(child, depth + 1)]


def what_is_in(folder: Path) -> str:
    """What is there where image files were expected, with what to do about it where that is known."""
    files = (
        [path for _, path in zip(range(_MOST), folder.rglob("*"), strict=False) if path.is_file()]
        if folder.is_dir()
        else []
    )
    counts = Counter(path.suffix.lower() or path.name for path in files)
    if not counts:
        return "none"
    told = ", ".join(f"{count} {suffix[:20]}" for suffix, count in counts.most_common(8))
    return f"none that can be read, but {told}"


def raw_in(folder: Path) -> str:
    """Raw photographs beside other images, for a sentence; empty where there are none."""
    files = (path for _, path in zip(range(_MOST), folder.rglob("*"), strict=False))
    counts = Counter(path.suffix.lower() for path in files if path.suffix.lower() in RAW)
    return ", ".join(f"{count} {suffix}" for suffix, count in counts.most_common())


def flat_pairs(paths: Iterable[Path]) -> tuple[list[Path], list[Path]] | None:
    """Files of one folder whose names tell the camera (``dive_0001_L.jpg``), left and right; None: they do not."""
    files = sorted(paths, key=natural_order)
    known = {path.name.lower(): path for path in files}
    by_grade: dict[int, list[tuple[Path, Path]]] = {}
    for path in files:
        for other, grade in partners(path.name).items():
            if other in known and (grade < NUMBERED or _CAMERA.search(path.name)):
                by_grade.setdefault(grade, []).append((path, known[other]))
    for _, found in sorted(by_grade.items()):
        left, right = [one for one, _ in found], [other for _, other in found]
        if 2 * len(found) > 0.5 * len(files) and not set(left) & set(right):
            return left, right
    return None
