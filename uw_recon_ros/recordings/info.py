"""`inspect_recording`: what bags, stills and videos hold, and whether a surface can be reconstructed from them."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.first_image import image_of
from uw_recon_ros.bags.model import RawMessage, plain
from uw_recon_ros.bags.reader import BagReader
from uw_recon_ros.bags.stereo import CameraInfoCache, StereoTopics
from uw_recon_ros.errors import BagError, ReconError
from uw_recon_ros.files.images import image_size
from uw_recon_ros.files.video_packets import is_video
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS
from uw_recon_ros.recordings.contents import CalibrationState, CameraImages, RecordingInfo
from uw_recon_ros.recordings.listing import Listing, list_frames
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame, Place, Rigs, StampPairer
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.recordings.sources import Source, find_sources, open_source, other_calibrations
from uw_recon_ros.recordings.verdict import judge, judge_infos, judge_rig
from uw_recon_ros.recordings.video import Video
from uw_recon_ros.types import RawImage, StereoCalibration, StereoPair

#: Why a pair cannot be of a rig; empty where nothing speaks against it.
PairJudge = Callable[[StereoPair], str]
_PROBED = 5  # frames of a video that are decoded


def inspect_recording(
    paths: str | Path | Iterable[str | Path],
    options: Options = Options(),  # noqa: B008 (frozen)
    calibration: StereoCalibration | None = None,
    images_rectified: str = "auto",
    judge_pair: PairJudge | None = None,
) -> list[RecordingInfo]:
    """Look at all of a recording and judge it. Of stills every file is read, but few are decoded.

    Parameters
    ----------
    paths : path, or iterable of paths
        As ``uw_recon survey`` takes them.
    options : Options
    calibration : StereoCalibration, optional
        Instead of what the recording says.
    images_rectified : {'auto', 'yes', 'no'}
        Whether the images come rectified already; auto: by the names of their topics.
    judge_pair : callable, optional
        What speaks against the pair it is given, one out of the middle; empty: nothing.

    Returns
    -------
    list of RecordingInfo
        One a source.

    Raises
    ------
    BagError
        There is nothing that can be read, or no topic of a given name.
    """
    sources = find_sources([paths] if isinstance(paths, (str, Path)) else paths)
    look = {"bag": _of_bag, "stills": _of_files, "video": _of_files}
    found = []
    for source in sources:
        try:
            found.append(look[source.kind](source, options, Rigs(calibration, images_rectified), judge_pair))
        except ReconError as error:  # of several, the others are told of
            if len(sources) == 1:
                raise
            found.append(RecordingInfo(_shown(source), 0, 0, kind=source.kind, reasons=(str(error),)))
    return found


def bag_info(
    path: str | Path,
    left: str | None = None,
    right: str | None = None,
    *,
    tolerance_ns: int = round(PAIR_TOLERANCE_MS * 1e6),
    images_rectified: str = "auto",
) -> RecordingInfo:
    """Read a whole bag and judge it: `inspect_recording` for one bag.

    Parameters
    ----------
    path : path
    left, right : str or None
        Image topics; None = found by type and name.
    tolerance_ns : int
        Largest difference of stamps within a pair, ns.
    images_rectified : {'auto', 'yes', 'no'}

    Raises
    ------
    BagError
        Nothing in it can be read, or it has no topic of a given name.
    """
    whole = Path(path).absolute()
    options = Options(left or "", right or "", tolerance_ns / 1e6)
    return _of_bag(Source("bag", str(whole), whole.name), options, Rigs(None, images_rectified), None)


# ---- bags ------------------------------------------------------------------------------------------------------------


def _of_bag(source: Source, options: Options, rigs: Rigs, judge_pair: PairJudge | None) -> RecordingInfo:
    with open_source(source) as bag:
        try:
            topics = bag.stereo_topics(options.left_topic or None, options.right_topic or None)
        except BagError as error:
            if options.left_topic or options.right_topic:
                raise
            return _without_pairs(source, bag, str(error))
        found, frames = _inspect_bag(source, bag, topics, options, rigs)
    with closing(Reader([source], rigs.calibrations)) as reader:
        return _judged_by_a_pair(found, frames, reader, judge_pair)


def _judged_by_a_pair(
    found: RecordingInfo, frames: list[Frame], reader: Reader, judge_pair: PairJudge | None
) -> RecordingInfo:
    """The verdict, and what one pair out of the middle says of the cameras."""
    if judge_pair is None or not found.reconstructable or not frames:
        return found
    try:
        against = judge_pair(reader.read(frames[len(frames) // 2]))
    except ReconError as error:  # an image that cannot be read is told of already
        against = str(error) if error.code == Code.IMAGE_IDENTICAL else ""
    return replace(found, reasons=(*found.reasons, against)) if against else found


def _shown(source: Source) -> str:
    return " and ".join(filter(None, (source.path, source.other)))


def _without_pairs(source: Source, bag: BagReader, reason: str) -> RecordingInfo:
    for _ in bag.raw_messages():  # for the damage
        pass
    damage = tuple(bag.damage)
    return RecordingInfo(_shown(source), bag.start_ns, bag.end_ns, tuple(bag.topics), damage=damage, reasons=(reason,))


def _inspect_bag(
    source: Source, bag: BagReader, topics: StereoTopics, options: Options, rigs: Rigs
) -> tuple[RecordingInfo, list[Frame]]:
    """Read it once, every message looked at and paired."""
    rectified = topics.rectified(rigs.images_rectified)
    sides = (
        CameraImages(topics.left, topics.left_info, rectified=rectified[0]),
        CameraImages(topics.right, topics.right_info, rectified=rectified[1]),
    )
    infos = CameraInfoCache(rectified[0]), CameraInfoCache(rectified[1])
    takers: dict[str, Callable[[RawMessage], None]] = {}
    for side, cache in zip(sides, infos, strict=True):
        takers[side.topic] = _image_taker(side)
        if side.info_topic:
            takers[side.info_topic] = cache.update

    def look(raw: RawMessage) -> None:
        try:
            takers[raw.topic](raw)
        except BagError as error:
            bag.note(str(error))

    tolerance_ns = round(options.pair_tolerance_ms * 1e6)
    frames = list(StampPairer(bag, topics, 0, tolerance_ns, rigs, options.offset_ns or 0, look))
    numbers = _pair_numbers([frame.stamp_ns for frame in frames])
    size = sides[0].width, sides[0].height
    state, baseline, findings = judge_rig(rigs.given, size) if rigs.given else judge_infos(infos, size)
    found = RecordingInfo(
        _shown(source), bag.start_ns, bag.end_ns, tuple(bag.topics), "bag", *sides, **numbers,
        stamp_offset_s=_nearest_offset(sides[0].stamps_ns, sides[1].stamps_ns), calibration=state,
        baseline_m=baseline, calibration_findings=findings, damage=tuple(bag.damage),
    )  # fmt: skip
    return judge(found, changes=max(cache.changes for cache in infos)), frames


def _image_taker(side: CameraImages) -> Callable[[RawMessage], None]:
    def take(raw: RawMessage) -> None:
        image = messages.decode(raw)
        if not side.stamps_ns:
            _describe_first(side, image)
        elif side.problem and is_video(image):  # recorded from the middle of a stream: the first key frame tells
            side.before_key += 1
            _describe_first(side, image)
        elif not side.problem and _differs(side, image):
            side.odd += 1
        side.stamps_ns.append(messages.stamp_ns(image))

    return take


def _describe_first(side: CameraImages, image: Any) -> None:
    side.frame_id = plain(image.header.frame_id if hasattr(image, "header") else image.frame_id)
    side.encoding = plain(getattr(image, "encoding", "") or getattr(image, "format", ""))
    try:
        _describe(side, image_of(image))
        side.problem = ""
    except ReconError as error:
        side.problem = str(error)


def _describe(side: CameraImages, shown: RawImage) -> None:
    side.height, side.width = shown.shape[:2]
    side.kind = f"{'colour' if shown.ndim == 3 else 'mono'}, {8 * shown.itemsize} bits"


def _differs(side: CameraImages, image: Any) -> bool:
    if not hasattr(image, "step"):
        return plain(getattr(image, "format", "") or getattr(image, "encoding", "")) != side.encoding
    whole = 2 * len(image.data) in (2 * image.step * image.height, 3 * image.step * image.height)  # YUV 4:2:0
    return not whole or (image.width, image.height, plain(image.encoding)) != (side.width, side.height, side.encoding)


def _pair_numbers(stamps_ns: list[int]) -> dict[str, Any]:
    """The fields of `RecordingInfo` that follow from the stamps of the pairs."""
    intervals = np.diff(np.array(sorted(stamps_ns), np.int64)) * 1e-9
    numbers: dict[str, Any] = {"pairs": len(stamps_ns)}
    if intervals.size:
        typical = np.float64(np.median(intervals))
        numbers["rate_hz"] = float(1.0 / typical) if typical > 0 else float("nan")
        numbers["largest_gap_s"] = float(intervals.max())
        numbers["gaps"] = int((intervals > 2.5 * typical).sum())
    return numbers


def _nearest_offset(left: list[int], right: list[int]) -> float:
    if not left or not right:
        return float("nan")
    ours, theirs = np.array(sorted(left), np.int64), np.array(sorted(right), np.int64)
    after = np.searchsorted(theirs, ours).clip(0, len(theirs) - 1)
    before = (after - 1).clip(0)
    return float(np.median(np.minimum(abs(theirs[after] - ours), abs(theirs[before] - ours)))) * 1e-9


# ---- stills and videos -----------------------------------------------------------------------------------------------


@dataclass
class _Looked:
    """What a look at all files found: why some cannot be read, and the sizes of the others, px."""

    bad: dict[tuple[str, int], str] = field(default_factory=dict)
    sizes: dict[tuple[str, int], tuple[int, int]] = field(default_factory=dict)


def _of_files(source: Source, options: Options, rigs: Rigs, judge_pair: PairJudge | None) -> RecordingInfo:
    if source.kind == "video":
        for path in filter(None, (source.path, source.other)):
            Video(path).close()  # what cannot be opened is refused, as a bag is
    try:
        listing = list_frames([source], options, rigs.given, rigs.images_rectified)
    except ReconError as error:
        return RecordingInfo(_shown(source), 0, 0, kind=source.kind, reasons=(str(error),))
    frames = listing.frames
    left, right = _places_of(source, frames)
    sides = CameraImages(left, None), CameraImages(right, None)
    with closing(Reader([source], listing.calibrations)) as reader:
        looked = _look_at_stills(frames) if source.kind == "stills" else _look_at_video(source, frames, reader)
        for number, side in enumerate(sides):
            places = [(frame.stamp_ns, (frame.left, frame.right)[number]) for frame in frames]
            _describe_files(side, source, places, looked, reader)
        sound = [frame for frame in frames if not {_key(frame.left), _key(frame.right)} & looked.bad.keys()]
        state, baseline, findings = _calibration_of(source, listing, (sides[0].width, sides[0].height))
        found = RecordingInfo(
            _shown(source), frames[0].stamp_ns, frames[-1].stamp_ns, (), source.kind, *sides,
            **_pair_numbers([frame.stamp_ns for frame in sound]), calibration=state, baseline_m=baseline,
            calibration_findings=findings, damage=tuple(looked.bad.values()),
        )  # fmt: skip
        judged = _judged_by_a_pair(judge(found, changes=-1), sound, reader, judge_pair)
    return replace(judged, warnings=(*judged.warnings, *listing.notes))


def _places_of(source: Source, frames: list[Frame]) -> tuple[str, str]:
    """Where each camera's images are, for people: a video, a folder, or the first file of a folder with both."""
    if source.kind == "video":
        return Path(source.path).name, Path(source.other or source.path).name
    files = [frame.left.name for frame in frames], [frame.right.name for frame in frames]
    left, right = (os.path.commonpath([os.path.dirname(name) for name in names]) for names in files)
    if left == right:
        left, right = files[0][0], files[1][0]
    return _inside(source, left), _inside(source, right)


def _inside(source: Source, path: str) -> str:
    """A path from the folder that the source is in; as it is, where it lies elsewhere."""
    inside = os.path.relpath(path, os.path.dirname(source.path))
    return path if inside.startswith(os.pardir) else inside


def _key(place: Place) -> tuple[str, int]:
    return place.name, place.nth


def _look_at_stills(frames: list[Frame]) -> _Looked:
    """Every file, as far as its header and its end tell."""
    looked = _Looked()
    for place in dict.fromkeys(place for frame in frames for place in (frame.left, frame.right)):
        try:
            looked.sizes[_key(place)] = image_size(place.name)
        except ReconError as error:
            looked.bad[_key(place)] = str(error)
    return looked


def _look_at_video(source: Source, frames: list[Frame], reader: Reader) -> _Looked:
    """Frames spread over a video, decoded."""
    looked = _Looked()
    for number in np.unique(np.linspace(0, len(frames) - 1, _PROBED).astype(int)):
        for place, side in ((frames[number].left, "left"), (frames[number].right, "right")):
            try:
                reader.view(source, place, side)
            except ReconError as error:
                looked.bad[_key(place)] = str(error)
    return looked


def _describe_files(
    side: CameraImages, source: Source, places: list[tuple[int, Place]], looked: _Looked, reader: Reader
) -> None:
    """Stamps of what can be read; size and kind of the first."""
    sound = [(stamp, place) for stamp, place in places if _key(place) not in looked.bad]
    side.stamps_ns = [stamp for stamp, _ in sound]
    for _, place in sound:
        try:
            _describe(side, reader.view(source, place, "first"))
        except ReconError as error:
            looked.bad[_key(place)] = str(error)
            continue
        side.encoding = Path(place.name).suffix.lower().lstrip(".")
        size = looked.sizes.get(_key(place))
        side.odd = sum(looked.sizes.get(_key(other), size) != size for _, other in sound)
        return


def _calibration_of(
    source: Source, listing: Listing, size: tuple[int, int]
) -> tuple[CalibrationState, float, tuple[Finding, ...]]:
    if listing.calibrations:
        return judge_rig(listing.calibrations[0], size)
    others = other_calibrations(source)
    told = f" ({', '.join(others[:4])} may be one: --calibration)" if others else ""
    none = Finding(Code.CALIBRATION_NONE, f"no calibration beside the images{told}", Severity.WARN)
    return "none", float("nan"), (none,)
