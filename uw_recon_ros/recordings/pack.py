"""`pack`: stills or videos become a rosbag2 MCAP bag."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.errors import BagError, ReconError
from uw_recon_ros.progress import say
from uw_recon_ros.recordings.folders import find_images
from uw_recon_ros.recordings.listing import list_frames
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame, Place
from uw_recon_ros.recordings.read import LEFT_FRAME, RIGHT_FRAME, Reader
from uw_recon_ros.recordings.sources import Source, find_sources, is_bag, is_video, video_source
from uw_recon_ros.recordings.stills import pair_stills
from uw_recon_ros.recordings.views import list_video, list_whole
from uw_recon_ros.topics import SIDES
from uw_recon_ros.types import RawImage, StereoCalibration


class Packed(NamedTuple):
    """How many pairs a bag was written of, and why others are not in it."""

    pairs: int
    left_out: tuple[str, ...]


def pack(
    left: str,
    right: str,
    bag: str | Path,
    *,
    calibration: StereoCalibration | None = None,
    rate_hz: float = 2.0,
    overwrite: bool = False,
    progress: Callable[[list[Frame]], Iterable[Frame]] = iter,
) -> Packed:
    """Write a bag of image files, bits unchanged: ``/left/image_raw``, ``/right/image_raw`` and, with a calibration,
    ``/left/camera_info``, ``/right/camera_info``.

    Parameters
    ----------
    left, right : str
        Glob patterns or folders of stills, paired as `survey` pairs them (`stills.pair_stills`); or videos; or bags
        with one camera each. The same twice: each image holds both views.
    bag : path
        Folder to make; with the suffix ``.mcap`` a bare file.
    calibration : StereoCalibration, optional
        Instead of what bags say.
    rate_hz : float
        Pairs per second of stills that carry no time; their first stamp is 1 s.
    overwrite : bool
        Whether to replace a bag that stands there.
    progress : callable, optional
        Given the list of pairs, yields them one by one while it shows how far it is.

    Returns
    -------
    Packed
        Images that cannot be read, or are of another size than the rest, are left out with their partners.

    Raises
    ------
    BagError, ImageError
        Not a single pair; a name that is taken.
    """
    if not rate_hz > 0:
        raise ValueError(f"rate_hz: expected > 0 Hz, got {rate_hz}")
    pairs, reader, found = _listed(left, right, rate_hz)
    calibration = calibration or found
    frames = LEFT_FRAME, RIGHT_FRAME
    if calibration is not None:
        frames = calibration.left.frame_id or LEFT_FRAME, calibration.right.frame_id or RIGHT_FRAME
    problems: list[ReconError] = []
    with closing(reader), BagWriter(bag, overwrite=overwrite) as writer:
        like: _Like | None = None
        for frame in progress(pairs):
            try:
                images = reader.images(frame)
                like = like or _Like(frame.left.name, images[0], calibration)
                _check(frame, images, like)
            except ReconError as error:
                if len(pairs) == 1:
                    raise
                problems.append(error)
                like = None if len(problems) == frame.number + 1 else like  # what is wrong may be the first one
                continue
            for side, image, name in zip(SIDES, images, frames, strict=True):
                writer.image(f"/{side}/image_raw", image, time_ns=frame.stamp_ns, frame_id=name)
            if calibration is not None:
                writer.camera_info("/left/camera_info", calibration.left, time_ns=frame.stamp_ns, frame_id=frames[0])
                writer.camera_info("/right/camera_info", calibration.right, time_ns=frame.stamp_ns, frame_id=frames[1])
        if len(problems) == len(pairs):
            raise problems[0]
    return Packed(len(pairs) - len(problems), tuple(map(str, problems)))


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
        found = list(list_video(source, options, notes))
    else:
        source = Source("stills", str(Path(left).absolute()), left)
        ours, theirs = find_images(left), find_images(right)
        if ours == theirs:
            found = list(list_whole(source, ours, options, notes))
        else:
            name, offset = f"{left} and {right}", options.offset_ns or 0
            _expect_others(ours, theirs)
            matched = pair_stills(ours, theirs, name, rate_hz, offset, notes)
            found = [
                Frame(0, 0, p.stamp_ns, *_places(p.left, p.right, p.stamp_ns)) for p in matched if p.left and p.right
            ]
    for note in notes:
        say(f"note: {note}")
    return [replace(frame, number=n) for n, frame in enumerate(found)], Reader([source], []), None


def _places(left: Path, right: Path, stamp_ns: int) -> tuple[Place, Place]:
    return Place(str(left), stamp_ns), Place(str(right), stamp_ns)


def _expect_others(left: Sequence[Path], right: Sequence[Path]) -> None:
    both = {path.resolve() for path in left} & {path.resolve() for path in right}
    if both:
        raise BagError(f"left and right name the same files, e.g. {min(both)}")


class _Like(NamedTuple):
    """What all images of a bag are like."""

    name: str
    image: RawImage
    calibration: StereoCalibration | None


def _check(frame: Frame, images: tuple[RawImage, RawImage], like: _Like) -> None:
    camera = like.calibration.left if like.calibration is not None else None
    for place, image in zip((frame.left, frame.right), images, strict=True):
        name = place.name if Path(place.name).is_file() else f"{place.name} at {frame.stamp_ns / 1e9:.3f} s"
        if image.shape != like.image.shape or image.dtype != like.image.dtype:
            raise BagError(f"{name}: expected {_shape(like.image)} as {Path(like.name).name}, got {_shape(image)}")
        if camera is not None and (camera.height, camera.width) != image.shape[:2]:
            size = f"{camera.width}x{camera.height}"
            raise BagError(f"{name}: expected {size} px as in the calibration, got {_shape(image)}")


def _shape(image: RawImage) -> str:
    return (
        f"{image.shape[1]}x{image.shape[0]} px {'colour' if image.ndim == 3 else 'mono'} {8 * image.dtype.itemsize} bit"
    )
