"""Pairs of stills and videos listed: which file, which moment and which part of the image is either view."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing, suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.images import read_image
from uw_recon_ros.findings import Code
from uw_recon_ros.recordings.clock_offset import Clock, find_clock
from uw_recon_ros.recordings.folders import IMAGES, camera_folders, find_images, flat_pairs, images_in, raw_in
from uw_recon_ros.recordings.layout import LAYOUTS, find_layout, mpo_parts
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame, Place
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.recordings.sources import Source
from uw_recon_ros.recordings.stills import FIRST_NS, pair_stills
from uw_recon_ros.recordings.video import Video
from uw_recon_ros.system_errors import reason
from uw_recon_ros.types import RawImage

_PROBES = (0.1, 0.4, 0.7)  # of the way through, where the layout is looked for
_AROUND_NS = 100_000_000  # a rig's motion is seen over so long, before and after a frame
_TRIED = 20  # images, from there on, until one can be read


def list_stills(source: Source, options: Options, notes: list[str]) -> Iterator[Frame]:
    """Every pair of stills, not numbered yet.

    Raises
    ------
    BagError
        The folder is not one rig's.
    """
    path = Path(source.path)
    folders, others = camera_folders(path)
    raw = raw_in(path)
    if raw and any(file.suffix.lower() in IMAGES for file in images_in(path)):
        notes.append(f"{source.name}: also there, not read: {raw}: the other images are taken; move either away")
    if folders is not None:
        notes += [f"{source.name}: also there, not read: {other}" for other in others]
        sides = find_images(str(folders[0])), find_images(str(folders[1]))
    else:
        images = find_images(str(path))
        flat = flat_pairs(images) if options.layout in ("auto", "separate") else None
        if flat is None:
            try:
                yield from list_whole(source, images, options, notes)
            except BagError as error:
                raise _named_otherwise(path, images, error) from error
            return
        sides = flat
        if len(flat[0]) * 2 < len(images):
            notes.append(f"{source.name}: {len(images) - 2 * len(flat[0])} files have no partner of the same name")
    for pair in pair_stills(*sides, source.name, options.stills_rate, options.offset_ns or 0, notes):
        if pair.left and pair.right:
            left, right = (Place(str(path), pair.stamp_ns) for path in (pair.left, pair.right))
            yield Frame(0, 0, pair.stamp_ns, left, right)


def _named_otherwise(path: Path, images: list[Path], error: BagError) -> BagError:
    """Of images in several folders: that the names of these do not tell the cameras."""
    names = list(dict.fromkeys(image.relative_to(path).parts[0] for image in images if image.parent != path))
    if error.code != Code.RECORDING_ONE_CAMERA or len(names) < 2:
        return error
    return BagError(
        f"{path.name}: expected folders whose names tell the left and the right camera, got {', '.join(names[:8])}: "
        "call the two left and right, or link them so", error.code,
    )  # fmt: skip


def list_whole(source: Source, images: list[Path], options: Options, notes: list[str]) -> Iterator[Frame]:
    """Stills that hold both views."""
    layout = _layout_of(options, source.name, _probes(images), notes)
    for rank, image in enumerate(images):
        stamp = FIRST_NS + round(rank * 1e9 / options.stills_rate)
        left, right = (Place(str(image), stamp, 0, f"{layout}:{side}") for side in (0, 1))
        yield Frame(0, 0, stamp, left, right)


def _probes(images: list[Path]) -> Iterator[RawImage | str]:
    """Images spread over a folder; for one that cannot be read, the next that can."""
    for share in _PROBES:
        for path in images[int(share * len(images)) :][:_TRIED]:
            with suppress(ImageError):
                yield _still(path)
                break


def _still(path: Path) -> RawImage | str:
    """An image, or ``mpo`` where the file holds two."""
    return "mpo" if is_mpo(path) else read_image(path)


def both_views(path: str | Path) -> tuple[RawImage, RawImage]:
    """Left and right view of one image file that holds both.

    Raises
    ------
    BagError, ImageError
        It holds one, or cannot be read.
    """
    path = Path(path)
    try:
        layout = _layout_of(Options(), str(path), iter([_still(path)]), [])
    except BagError as error:
        raise BagError(
            f"{path}: expected the other camera's image, or both views in one file, got one camera's image, the same "
            "twice: name the other camera's file; where a file does hold both views, survey it with --layout",
            Code.IMAGE_IDENTICAL,
        ) from error
    source = Source("stills", str(path.parent.absolute()), path.name)
    with closing(Reader([source], [])) as reader:
        left, right = (Place(str(path), 0, 0, f"{layout}:{side}") for side in (0, 1))
        return reader.images(Frame(0, 0, 0, left, right))


def is_mpo(path: Path) -> bool:
    """Whether a file holds two photographs."""
    if path.suffix.lower() not in (".mpo", ".jpg", ".jpeg"):
        return False
    try:
        with path.open("rb") as stream:
            if b"MPF\0" not in stream.read(2**16):
                return False
        return len(mpo_parts(path.read_bytes())) == 2
    except OSError as error:
        raise ImageError(f"{path}: cannot be read: {reason(error)}") from error
    except ImageError:  # cut short: told when it is read
        return True


def _layout_of(options: Options, name: str, images: Iterator[RawImage | str], notes: list[str]) -> str:
    """The layout told, or found in two of three images.

    Raises
    ------
    BagError
        One view an image, and no other camera.
    """
    if options.layout in LAYOUTS[1:]:
        return options.layout
    found = [image if isinstance(image, str) else find_layout(image) for image in images]
    if not found:
        raise BagError(f"{name}: expected images, got none that can be read (uw_recon info names the reasons)")
    layout = max(set(found), key=found.count)
    if layout == "separate" or options.layout == "separate":
        raise BagError(
            f"{name}: expected two cameras' images, or both views in one, got one camera's: name the other camera's "
            "video too, give the folder with left/ and right/ of stills, or say how both views lie, --layout "
            f"{', '.join(LAYOUTS[1:-1])}", Code.RECORDING_ONE_CAMERA,
        )  # fmt: skip
    notes.append(f"{name}: both views in one image, {layout} (--layout says otherwise)")
    return layout


def list_video(source: Source, options: Options, notes: list[str]) -> Iterator[Frame]:
    """Every pair of frames, not numbered yet.

    Raises
    ------
    BagError
        A file cannot be opened, or the cameras' clocks cannot be brought together.
    """
    if not source.other:
        yield from _list_one(source, options, notes)
        return
    with Video(source.path) as left, Video(source.other) as right:
        ours, theirs = left.times(), right.times()
        clock = find_clock(left, right, ours, theirs, options.offset_ns)
        notes += [f"{source.name}: {sentence}" for sentence in clock.told]
        yield from _nearest(source, ours, theirs, clock, notes)


def _list_one(source: Source, options: Options, notes: list[str]) -> Iterator[Frame]:
    with Video(source.path) as video:
        times = video.times()
        probes = (_frame(video, times[int(share * len(times))][1]) for share in _PROBES)
        try:
            layout = _layout_of(options, source.name, (image for image in probes if image is not None), notes)
        except BagError as error:
            if video.streams == 1:
                raise
            raise BagError(
                f"{source.name}: expected both views in one picture, or two files, got {video.streams} streams of "
                f"pictures: ffmpeg -i {source.name} -map 0:v:0 -c copy left.mkv -map 0:v:1 -c copy right.mkv",
                error.code,
            ) from error
        for stamp, mark in times:
            left, right = (Place(source.path, stamp, mark, f"{layout}:{side}") for side in (0, 1))
            yield Frame(0, 0, FIRST_NS + stamp, left, right)


def _frame(video: Video, mark: int) -> RawImage | None:
    try:
        return video.frame(mark)
    except ImageError:
        return None


def _nearest(
    source: Source, ours: list[tuple[int, int]], theirs: list[tuple[int, int]], clock: Clock, notes: list[str]
) -> Iterator[Frame]:
    """Left and right frames that are each other's nearest in time; where rates differ, frames are used once."""
    stamps = np.array([time for time, _ in theirs], np.int64)
    step = float(np.median(np.diff(stamps))) if len(stamps) > 1 else 1e9
    partner: dict[int, tuple[int, int]] = {}  # of right frames: left ones and the lag to these, ns
    for place, (stamp, _) in enumerate(ours):
        wanted = clock.right_of(stamp)
        after = int(np.searchsorted(stamps, wanted).clip(1, max(1, len(stamps) - 1)))
        best = min((after - 1, min(after, len(stamps) - 1)), key=lambda place: abs(stamps[place] - wanted))
        lag = int(stamps[best] - wanted)
        if abs(lag) <= 0.6 * step and (best not in partner or abs(lag) < abs(partner[best][1])):
            partner[best] = place, lag
    for best, (place, lag) in partner.items():
        stamp, mark = ours[place]
        left, right = Place(source.path, stamp, mark), Place(source.other, int(stamps[best]), theirs[best][1])
        around = tuple((time - stamp, Place(source.path, time, other)) for time, other in _around(ours, place))
        yield Frame(0, 0, FIRST_NS + stamp, left, right, lag_ns=lag, around=around)
    apart, alone = [abs(lag) / 1e6 for _, lag in partner.values()], len(ours) - len(partner)
    if alone:
        notes.append(f"{source.name}: {alone} of {len(ours)} left frames have no partner")
    beyond = _beyond(ours, stamps, clock)
    if beyond:
        notes.append(f"{source.name}: {beyond} of {len(theirs)} right frames lie before or after all left frames")
    if apart and np.median(apart) > 1.0:
        notes.append(
            f"{source.name}: partners are {np.median(apart):.1f} ms apart (median), at most {max(apart):.1f} ms: "
            "cameras without a common trigger; a survey takes the rig's own motion in that time out, not that of "
            "animals and plants"
        )


def _beyond(ours: list[tuple[int, int]], stamps: NDArray[np.int64], clock: Clock) -> int:
    """How many right frames lie further than an interval before the first or after the last left one."""
    if not ours:
        return len(stamps)
    first, last = (clock.right_of(ours[place][0]) for place in (0, -1))
    spare = (last - first) / max(len(ours) - 1, 1)
    return int(((stamps < first - spare) | (stamps > last + spare)).sum())


def _around(marks: list[tuple[int, int]], place: int) -> Iterator[tuple[int, int]]:
    """The frames nearest to `_AROUND_NS` before and after one."""
    for step in (-1, 1):
        at = place + step
        while 0 <= at + step < len(marks) and abs(marks[at][0] - marks[place][0]) < _AROUND_NS:
            at += step
        if 0 <= at < len(marks):
            yield marks[at]
