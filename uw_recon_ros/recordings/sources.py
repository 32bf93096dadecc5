"""From the paths a user gives to what can be read: bags, videos, folders of either, folders of stills."""

from __future__ import annotations

import hashlib
import os
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from uw_recon_ros.bags import BagReader, open_bag
from uw_recon_ros.bags.files import natural_order
from uw_recon_ros.bags.stereo import holds_one_camera
from uw_recon_ros.bags.two_bags import TwoBags
from uw_recon_ros.camera_sides import pairs_of, partners, side_of
from uw_recon_ros.errors import BagError
from uw_recon_ros.files.kinds import describe_file
from uw_recon_ros.findings import Code
from uw_recon_ros.recordings.folders import camera_folders, find_images, flat_pairs, images_in, what_is_in
from uw_recon_ros.recordings.video import SUFFIXES as VIDEOS
from uw_recon_ros.system_errors import reason, told_as

_BAGS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".bag")
_CALIBRATIONS = ("calibration.yaml", "calibration.yml", "calibration.xml", "calibration.json", "camchain.yaml")
_CALIBRATION_SUFFIXES = (".yaml", ".yml", ".xml", ".json", ".txt", ".npz", ".mat", ".conf", ".gz")
_MAY_CALIBRATE = re.compile(
    r"calib|camchain|intrinsic|extrinsic|stereo|sensor|rig|^(left|right|ost)\.|^SN[0-9]", re.IGNORECASE
)
_BLOCK = 1 << 20


@dataclass(frozen=True)
class Source:
    """One recording.

    Parameters
    ----------
    kind : {'bag', 'stills', 'video'}
    path : str
        Absolute. Of two videos, the left one.
    name : str
        What reports call it: the path's last part.
    other : str
        The right camera's video or bag; empty: one holds both views.
    """

    kind: Literal["bag", "stills", "video"]
    path: str
    name: str
    other: str = ""


def find_sources(paths: Iterable[str | Path]) -> list[Source]:
    """Look at what each path is: a bag, a video, a folder of stills or videos, or a folder of any.

    Two videos given one after the other are a left and a right one unless their names tell otherwise, and so are two
    bags with the images of one camera each. The two folders of a rig's stills are one recording, as their parent is.

    Raises
    ------
    BagError
        A path that is none of it.
    """
    given = [Path(path) for path in paths]
    if len(given) == 2 and all(map(is_video, given)) and _may_be_a_pair(given[0].stem, given[1].stem):
        return [video_source(given[0], given[1])]
    rig = _folder_of_both(given) if len(given) == 2 else None
    if rig is not None:
        return [Source("stills", str(rig), rig.name)]
    sources = [source for path in given for source in _sources_at(path)]
    if len(given) == 2 and len(sources) == 2 and all(map(_is_half, sources)):
        swapped = (side_of(given[0].stem), side_of(given[1].stem)) == (1, 0)
        return [_bag_pair(*(reversed(sources) if swapped else sources))]
    return sources


def _folder_of_both(given: Sequence[Path]) -> Path | None:
    """The folder in which two folders of stills are those of the rig's cameras."""
    both = [path.absolute() for path in given]
    if both[0].parent != both[1].parent or not all(path.is_dir() and _images_right_in(path) for path in both):
        return None
    folders, _ = camera_folders(both[0].parent)
    return both[0].parent if folders is not None and set(folders) == set(both) else None


def open_source(source: Source) -> BagReader:
    """Open a source that is a bag, or two. Raises `BagError` as `open_bag` does."""
    return TwoBags(Path(source.path), Path(source.other)) if source.other else open_bag(Path(source.path))


def _is_half(source: Source) -> bool:
    """Whether it is a bag with the images of one camera."""
    if source.kind != "bag" or source.other:
        return False
    try:
        with open_bag(source.path) as bag:
            return holds_one_camera(bag.topics)
    except BagError:
        return False


def _bag_pair(left: Source, right: Source) -> Source:
    return Source("bag", left.path, f"{left.name} and {right.name}", right.path)


def _halves_in(path: Path) -> list[Source]:
    """The two cameras' bags, where a folder that no recorder described holds these; else nothing."""
    if path.is_file() or (path / "metadata.yaml").is_file():
        return []
    files = [_source(file) for file in sorted(path.iterdir(), key=natural_order) if file.is_file()]
    joined = _joined([source for source in files if source is not None])
    return joined if len(joined) == 1 and joined[0].other else []


def _joined(found: list[Source]) -> list[Source]:
    """The bags of a folder, those of a left and a right camera whose names tell as one."""
    by_name = {source.name: source for source in found if source.kind == "bag"}
    halves: dict[str, Source] = {}
    for _, left, right in pairs_of(list(by_name)):
        if not {left, right} & halves.keys() and _is_half(by_name[left]) and _is_half(by_name[right]):
            halves |= dict.fromkeys((left, right), _bag_pair(by_name[left], by_name[right]))
    return list(dict.fromkeys(halves.get(source.name, source) for source in found))


def _may_be_a_pair(first: str, second: str) -> bool:
    """Whether names do not tell that the first is the right one, or both of one camera."""
    sides = side_of(first), side_of(second)
    return sides in ((0, 1), (0, None), (None, 1), (None, None))


def is_video(path: Path) -> bool:
    """Whether a path is a video, by its name."""
    return path.suffix.lower() in VIDEOS and path.is_file()


def is_bag(path: Path) -> bool:
    """Whether a path is a bag, by the names of its files."""
    if os.path.isdir(path):  # pathlib's asks louder: a name that is too long raises
        return (path / "metadata.yaml").is_file() or any(f.name.endswith(_BAGS[:-1]) for f in path.iterdir())
    return path.name.endswith(_BAGS) and os.path.isfile(path)


def video_source(left: Path, right: Path | None = None) -> Source:
    """One video with both views, or two."""
    other = "" if right is None else str(right.absolute())
    return Source("video", str(left.absolute()), left.name if right is None else f"{left.name} and {right.name}", other)


def _sources_at(path: Path) -> list[Source]:
    with told_as(BagError, path, "a bag, a video or a folder"):
        path.stat()
        return _sources_in(path)


def _sources_in(path: Path) -> list[Source]:
    if is_video(path):
        return [video_source(*_with_partner(path))]
    own = _source(path)
    if own is None and not path.is_dir():
        raise BagError(f"{path}: expected a bag (a folder, .mcap, .db3 or .bag) or a video, got {describe_file(path)}")
    if own and not _holds_bag_folders(path):
        return _halves_in(path) or [own]
    videos = _videos_in(path)
    if videos:
        return videos
    inside = [_source(child) for child in sorted(path.iterdir(), key=natural_order)]
    found = [source for source in inside if source is not None]
    if not found and images_in(path):
        return [Source("stills", str(path.absolute()), path.absolute().name)]
    if not found:
        raise BagError(
            f"{path}: expected a bag, a video, a folder of either, or a folder with the stills of both cameras in "
            f"left/ and right/, got a folder with {what_is_in(path)}"
        )
    return _joined(found)


def _holds_bag_folders(path: Path) -> bool:
    """Whether a folder is a collection: files of one bag have no folders of bags beside them."""
    if path.is_file() or (path / "metadata.yaml").is_file():
        return False
    return any(child.is_dir() and _source(child) for child in path.iterdir())


def _source(path: Path) -> Source | None:
    if is_bag(path):
        return Source("bag", str(path.absolute()), path.absolute().name)
    if path.is_dir() and has_stills(path):
        return Source("stills", str(path.absolute()), path.absolute().name)
    return None


def has_stills(path: Path) -> bool:
    """Whether a folder has a folder of stills for each camera."""
    folders, _ = camera_folders(path)
    if folders is None:
        return flat_pairs(_images_right_in(path)) is not None
    return not any(is_video(file) for folder in folders for file in folder.rglob("*"))


def _images_right_in(path: Path) -> list[Path]:
    images = images_in(path)
    return images if images and images[0].parent == path else []


# ---- videos ----------------------------------------------------------------------------------------------------------


def _with_partner(path: Path) -> tuple[Path, Path | None]:
    """The left and the right video, where the names beside one tell; else that one alone."""
    beside = {file.name.lower(): file for file in path.parent.iterdir() if is_video(file) and file != path}
    for name in partners(path.name):
        if name in beside:
            return path, beside[name]
    for file in beside.values():
        if path.name.lower() in partners(file.name):
            return file, path
    own = side_of(path.stem)
    others = [file for file in beside.values() if own is not None and side_of(file.stem) == 1 - own]
    if len(others) == 1:
        return (path, others[0]) if own == 0 else (others[0], path)
    return path, None


def _videos_in(path: Path) -> list[Source]:
    """Videos of a folder: of two cameras' folders one by one, by names that tell, or each with both views."""
    folders, _ = camera_folders(path)
    if folders is not None:
        left, right = (_all_videos(folder) for folder in folders)
        if len(left) != len(right):
            raise BagError(
                f"{path}: expected as many left as right videos, got {len(left)} and {len(right)}: name both of each "
                "dive on the command line", Code.RECORDING_ONE_CAMERA,
            )  # fmt: skip
        return [video_source(one, other) for one, other in zip(left, right, strict=True)]
    here = sorted((file for file in path.iterdir() if is_video(file)), key=natural_order)
    pairs = dict.fromkeys(_with_partner(file) for file in here)
    return [video_source(left, right) for left, right in pairs]


def _all_videos(folder: Path) -> list[Path]:
    return sorted(
        (file for file in folder.rglob("*") if is_video(file)), key=lambda file: (str(file.parent), natural_order(file))
    )


# ---- files -----------------------------------------------------------------------------------------------------------


def calibration_file(source: Source) -> Path | None:
    """The calibration beside stills or videos."""
    if source.kind == "bag":
        return None
    folder = Path(source.path) if source.kind == "stills" else Path(source.path).parent
    return next((folder / name for name in _CALIBRATIONS if (folder / name).is_file()), None)


def other_calibrations(source: Source) -> list[str]:
    """Files beside stills or videos that may be calibrations, by their names, and are not read unasked."""
    if source.kind == "bag":
        return []
    folder = Path(source.path) if source.kind == "stills" else Path(source.path).parent
    files = [*folder.iterdir(), *folder.glob("cam[0-9]/sensor.yaml")]
    found = [file for file in files if file.suffix.lower() in _CALIBRATION_SUFFIXES and file.is_file()]
    return sorted(str(file.relative_to(folder)) for file in found if _MAY_CALIBRATE.search(file.name))


def told_of_calibrations(source: Source, given: Sequence[str]) -> list[str]:
    """Which files beside stills or videos are used as calibration and which are not, in sentences; nothing for bags."""
    beside = calibration_file(source)
    used = [Path(path).name for path in given] or ([beside.name] if beside else [])
    unused = [name for name in other_calibrations(source) if Path(name).name not in used]
    found = [f"{source.name}: calibrated by {' and '.join(used)}"] if used and source.kind != "bag" else []
    if unused:
        why = "one rig has one calibration" if used else "name it with --calibration to use it"
        found.append(f"{source.name}: not used as calibration: {', '.join(unused[:4])}: {why}")
    return found


def source_files(source: Source) -> list[Path]:
    """All files a source is read from, in natural order."""
    if source.kind == "bag":
        return [file for path in filter(None, (source.path, source.other)) for file in _bag_files(Path(path))]
    path = Path(source.path)
    beside = calibration_file(source)
    extra = [beside] if beside else []
    if source.kind == "video":
        return [path, *([Path(source.other)] if source.other else []), *extra]
    sides = camera_folders(path)[0] or (path,)
    return [*(file for folder in sides for file in find_images(str(folder))), *extra]


def _bag_files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    return sorted((file for file in path.iterdir() if file.is_file()), key=natural_order)


def fingerprint(source: Source, on_bytes: Callable[[int], None] = lambda count: None) -> dict[str, str]:
    """SHA-256 of every file of a source, by its path inside the source.

    Raises
    ------
    BagError
        A file cannot be read.
    """
    root = Path(source.path)
    base = root.parent if root.is_file() or source.other else root
    return {_within(file, base): sha256(file, on_bytes) for file in source_files(source)}


def _within(file: Path, base: Path) -> str:
    return file.relative_to(base).as_posix() if file.is_relative_to(base) else file.as_posix()


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
