"""`pack`: stills or videos become a rosbag2 MCAP bag."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from pathlib import Path

from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.errors import BagError
from uw_recon_ros.progress import say
from uw_recon_ros.recordings.folders import find_images
from uw_recon_ros.recordings.listing import list_frames
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame, Place
from uw_recon_ros.recordings.read import LEFT_FRAME, RIGHT_FRAME, Reader
from uw_recon_ros.recordings.sources import Source, find_sources, is_bag, is_video, video_source
from uw_recon_ros.recordings.stills import FIRST_NS
from uw_recon_ros.recordings.views import list_video, list_whole
from uw_recon_ros.types import RawImage, StereoCalibration

Pair = tuple[Path, Path]


def pack(
    left: str,
    right: str,
    bag: str | Path,
    *,
    calibration: StereoCalibration | None = None,
    rate_hz: float = 2.0,
    overwrite: bool = False,
    progress: Callable[[list[Frame]], Iterable[Frame]] = iter,
) -> int:
    """Write a bag of image files, bits unchanged: ``/left/image_raw``, ``/right/image_raw`` and, with a calibration,
    ``/left/camera_info``, ``/right/camera_info``.

    Parameters
    ----------
    left, right : str
        Glob patterns or folders of stills, sorted as people count (2 before 10) and paired by order; or videos; or bags
        with one camera each. The same twice: each image holds both views.
    bag : path
        Folder to make; with the suffix ``.mcap`` a bare file.
    calibration : StereoCalibration, optional
        Instead of what bags say.
    rate_hz : float
        Pairs per second; the first stamp is 1 s.
    overwrite : bool
        Whether to replace a bag that stands there.
    progress : callable, optional
        Given the list of pairs, yields them one by one while it shows how far it is.

    Returns
    -------
    int
        Number of pairs.

    Raises
    ------
    BagError
        No files, different counts or sizes, a frame missing on one side, a name that is taken.
    ImageError
        A file that is no image.
    """
    if not rate_hz > 0:
        raise ValueError(f"rate_hz: expected > 0 Hz, got {rate_hz}")
    pairs, reader, found = _listed(left, right, rate_hz)
    calibration = calibration or found
    frames = LEFT_FRAME, RIGHT_FRAME
    if calibration is not None:
        frames = calibration.left.frame_id or LEFT_FRAME, calibration.right.frame_id or RIGHT_FRAME
    with closing(reader), BagWriter(bag, overwrite=overwrite) as writer:
        first: RawImage | None = None
        for frame in progress(pairs):
            images = reader.images(frame)
            first = images[0] if first is None else first
            for side, image, place, name in (
                ("left", images[0], frame.left, frames[0]),
                ("right", images[1], frame.right, frames[1]),
            ):
                _check(Path(place.name), image, Path(pairs[0].left.name), first, calibration)
                writer.image(f"/{side}/image_raw", image, time_ns=frame.stamp_ns, frame_id=name)
            if calibration is not None:
                writer.camera_info("/left/camera_info", calibration.left, time_ns=frame.stamp_ns, frame_id=frames[0])
                writer.camera_info("/right/camera_info", calibration.right, time_ns=frame.stamp_ns, frame_id=frames[1])
    return len(pairs)


def _listed(left: str, right: str, rate_hz: float) -> tuple[list[Frame], Reader, StereoCalibration | None]:
    """The pairs that two files, patterns, folders or bags hold, what reads them, and the calibration of bags."""
    options, notes = Options(stills_rate=rate_hz), list[str]()
    if is_bag(Path(left)) and is_bag(Path(right)):
        sources = find_sources([left] if left == right else [left, right])
        listing = list_frames(sources, options)
        for note in listing.notes:
            say(f"note: {note}")
        rigs = listing.calibrations
        return listing.frames, Reader(sources, rigs), rigs[0] if rigs else None
    if is_video(Path(left)):
        source = video_source(Path(left), None if left == right else Path(right))
        listed = list(list_video(source, options, notes))
    else:
        source = Source("stills", str(Path(left).absolute()), left)
        ours, theirs = find_images(left), find_images(right)
        if ours == theirs:
            listed = list(list_whole(source, ours, options, notes))
        else:
            matched = enumerate(_matched(ours, theirs, left, right))
            stamps = ((FIRST_NS + round(n * 1e9 / rate_hz), one, other) for n, (one, other) in matched)
            listed = [(stamp, Place(str(one), stamp), Place(str(other), stamp)) for stamp, one, other in stamps]
    for note in notes:
        say(f"note: {note}")
    return [Frame(n, 0, stamp, one, other) for n, (stamp, one, other) in enumerate(listed)], Reader([source], []), None


def _matched(left: list[Path], right: list[Path], left_name: str, right_name: str) -> list[Pair]:
    if len(left) != len(right):
        raise BagError(
            f"expected as many left as right images, got {len(left)} ({left_name}) and {len(right)} ({right_name})"
        )
    if {path.resolve() for path in left} & {path.resolve() for path in right}:
        raise BagError(f"left and right name the same files, e.g. {left[0]}")
    _check_numbering(left, right)
    return list(zip(left, right, strict=True))


def _check_numbering(left: Sequence[Path], right: Sequence[Path]) -> None:
    """Frames numbered alike that do not line up: one is missing on either side."""
    numbers = [[_last_number(path) for path in paths] for paths in (left, right)]
    common = {n for n in numbers[0] if n is not None} & {n for n in numbers[1] if n is not None}
    if 2 * len(common) < len(left):
        return  # numbered independently
    for a, b, number_a, number_b in zip(left, right, *numbers, strict=True):
        if number_a != number_b:
            raise BagError(f"pairs do not line up: {a.name} would meet {b.name}; is a frame missing on one side?")


def _last_number(path: Path) -> int | None:
    digits = re.findall(r"[0-9]+", path.stem)
    return int(digits[-1]) if digits else None


def _check(
    path: Path, image: RawImage, first_path: Path, first: RawImage, calibration: StereoCalibration | None
) -> None:
    if image.shape != first.shape or image.dtype != first.dtype:
        raise BagError(f"{path}: expected {_shape(first)} as {first_path.name}, got {_shape(image)}")
    camera = calibration.left if calibration is not None else None
    if camera is not None and (camera.height, camera.width) != image.shape[:2]:
        raise BagError(f"{path}: expected {camera.width}x{camera.height} px as in the calibration, got {_shape(image)}")


def _shape(image: RawImage) -> str:
    return (
        f"{image.shape[1]}x{image.shape[0]} px {'colour' if image.ndim == 3 else 'mono'} {8 * image.dtype.itemsize} bit"
    )
