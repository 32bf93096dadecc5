"""The first pass over a recording: which pairs there are and where, without decoding a single image."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from uw_recon_ros.bags import BagReader
from uw_recon_ros.calibration.rectified import rectified_by_name
from uw_recon_ros.errors import BagError, CalibrationError, ReconError
from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.findings import Code
from uw_recon_ros.recordings.copies import note_copies
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame, Rigs, StampPairer
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.recordings.sources import Source, calibration_file, open_source
from uw_recon_ros.recordings.views import list_stills, list_video
from uw_recon_ros.types import StereoCalibration

_TRIED = 10  # images, for the size
#: Encoders repeat blocks of the frame before where little moves, in one camera and not in the other: no sign that a
#: part of the picture is frozen. After so long none is repeated any more that shows the scene.
_UNLIKE_NS = 500_000_000


@dataclass
class Listing:
    """What the first pass found.

    Parameters
    ----------
    frames : list of Frame
    calibrations : list of StereoCalibration
        Each different one.
    notes : list of str
        What was damaged, missing or odd, a sentence each.
    unreadable : list of str
        Sources of which nothing can be used, with the reason.
    pairs : int
        How many there are in the input; `frames` are those chosen.
    """

    frames: list[Frame] = field(default_factory=list)
    calibrations: list[StereoCalibration] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)
    pairs: int = 0


def list_frames(
    sources: list[Source],
    options: Options,
    given: StereoCalibration | None = None,
    images_rectified: str = "auto",
) -> Listing:
    """Find the pairs of all sources.

    Parameters
    ----------
    sources : list of Source
    options : Options
    given : StereoCalibration, optional
        Instead of what the recordings say.
    images_rectified : {'auto', 'yes', 'no'}

    Raises
    ------
    BagError
        There is no pair at all; the text says why.
    """
    listing, rigs, codes = Listing(), Rigs(given, images_rectified), list[Code]()
    for index, source in enumerate(sources):
        try:
            found = _list_source(source, index, options, rigs, listing.notes)
        except (BagError, CalibrationError) as error:
            listing.unreadable.append(str(error))
            codes.append(error.code)
            continue
        _note_backward_steps(source, found, listing.notes)
        listing.frames += found
    _note_copies(sources, listing)
    listing.frames = _numbered(sources, listing.frames)
    listing.pairs = len(listing.frames)
    if not listing.frames:
        raise BagError("no stereo pairs: " + "; ".join([*listing.unreadable, *listing.notes]), *codes[:1])
    listing.calibrations = rigs.calibrations
    return listing


def first_size(sources: list[Source], options: Options) -> tuple[int, int] | None:
    """Width and height, px, of the first image of the first source, for calibrations that do not tell theirs."""
    source = sources[0]
    if source.kind == "video" and options.clock_offset == "auto":
        options = replace(options, clock_offset="0")  # no search: sizes are the same whatever the clocks
    try:
        return _first_size(source, _first_frames(source, options))
    except ReconError:
        return None


def _first_frames(source: Source, options: Options) -> list[Frame]:
    """A few pairs, without a look at the others."""
    if source.kind != "bag":
        return list(itertools.islice(_lister(source)(source, options, []), _TRIED))
    with open_source(source) as bag:
        return list(itertools.islice(_walk(source, bag, 0, options, Rigs()), _TRIED))


def _lister(source: Source) -> Callable[[Source, Options, list[str]], Iterator[Frame]]:
    return list_stills if source.kind == "stills" else list_video


def _walk(source: Source, bag: BagReader, index: int, options: Options, rigs: Rigs) -> StampPairer:
    topics = bag.stereo_topics(options.left_topic or None, options.right_topic or None)
    return StampPairer(bag, topics, index, round(options.pair_tolerance_ms * 1e6), rigs, options.offset_ns or 0)


def _numbered(sources: list[Source], frames: list[Frame]) -> list[Frame]:
    """The frames with their numbers, each knowing one before it: the last, of a video one well before."""
    found: list[Frame] = []
    for source, group in itertools.groupby(frames, key=lambda frame: frame.source):
        own, first = list(group), len(found)
        places = np.arange(len(own)) - 1
        if sources[source].kind == "video":
            stamps = np.array([frame.stamp_ns for frame in own], np.int64)
            places = np.minimum(places, np.searchsorted(stamps, stamps - _UNLIKE_NS, side="right") - 1)
        for number, (frame, place) in enumerate(zip(own, places.tolist(), strict=True)):
            before = (own[place].left, own[place].right) if place >= 0 else None
            found.append(replace(frame, number=first + number, before=before))
    return found


def _list_source(source: Source, index: int, options: Options, rigs: Rigs, notes: list[str]) -> list[Frame]:
    if source.kind != "bag":
        frames = list(_lister(source)(source, options, notes))
        if source.kind == "stills":
            note_copies(source.name, frames, notes)
        rig = _rig_beside(source, frames, rigs)
        return [replace(frame, source=index, rig=rig) for frame in frames]
    with open_source(source) as bag:
        walk = _walk(source, bag, index, options, rigs)
        frames = list(walk)
        notes += [f"{source.name}: {sentence}" for sentence in [*bag.damage, *walk.notes()]]
    if not frames:
        raise BagError(f"{source.name}: no pair within {options.pair_tolerance_ms:g} ms: {walk.nearest()}")
    return frames


def _rig_beside(source: Source, frames: list[Frame], rigs: Rigs) -> int:
    """The rig of the calibration beside stills or videos."""
    file = None if rigs.given else calibration_file(source)
    rectified = rectified_by_name(rigs.images_rectified)
    own = read_calibration(file, partial(_first_size, source, frames)) if file else None
    return rigs.index(own, (rectified, rectified))


def _first_size(source: Source, frames: list[Frame]) -> tuple[int, int] | None:
    """Width and height, px, of the first image that can be read."""
    reader = Reader([source], [])
    try:
        for frame in frames[:_TRIED]:
            with suppress(ReconError):
                return reader.size(frame)
    finally:
        reader.close()
    return None


def _note_copies(sources: list[Source], listing: Listing) -> None:
    """Bags that hold the same moments: each is reconstructed, as often as it is there."""
    stamps: dict[int, set[int]] = {}
    for frame in listing.frames:
        if sources[frame.source].kind == "bag":
            stamps.setdefault(frame.source, set()).add(frame.stamp_ns)
    for one, other in itertools.combinations(stamps, 2):
        both = len(stamps[one] & stamps[other])
        if 2 * both > min(len(stamps[one]), len(stamps[other])):
            listing.notes.append(
                f"{sources[one].name} and {sources[other].name}: {both} pairs have the same stamps: copies of one "
                "recording? name one of them"
            )


def _note_backward_steps(source: Source, frames: list[Frame], notes: list[str]) -> None:
    steps = [(a, b) for a, b in itertools.pairwise(frames) if b.stamp_ns < a.stamp_ns]
    if steps:
        before, after = steps[0]
        back = (before.stamp_ns - after.stamp_ns) / 1e9
        notes.append(
            f"{source.name}: stamps go back {len(steps)} times, first by {back:g} s (a looped or spliced bag?)"
        )
