"""The first pass over a recording: which pairs there are and where, without decoding a single image."""

from __future__ import annotations

import itertools
import struct
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

from uw_recon_ros.bags import BagReader, RawMessage, StereoTopics, open_bag
from uw_recon_ros.bags.stereo import CameraInfoCache
from uw_recon_ros.errors import BagError, CalibrationError
from uw_recon_ros.pairing import Synchronizer
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.rigs import Rigs
from uw_recon_ros.survey.sources import Source
from uw_recon_ros.survey.stills import list_stills
from uw_recon_ros.types import StereoCalibration

_STAMP = struct.Struct("<4xiI")  # CDR's encapsulation, then the header's stamp
_BIG_STAMP = struct.Struct(">4xiI")


@dataclass(frozen=True)
class Place:
    """Where one image is.

    Parameters
    ----------
    name : str
        Topic, or file of a still.
    log_ns : int
        When the message was recorded, ns.
    nth : int
        Which of the messages of that topic and time, from 0.
    """

    name: str
    log_ns: int = 0
    nth: int = 0


@dataclass(frozen=True)
class Frame:
    """One stereo pair, not read yet.

    Parameters
    ----------
    number : int
        Of the pair in the whole input, from 0; the files are named by it.
    source : int
        Index into the sources.
    stamp_ns : int
        Header stamp of the left image, ns.
    left, right : Place
    rig : int
        Index into the calibrations; -1: none.
    """

    number: int
    source: int
    stamp_ns: int
    left: Place
    right: Place
    rig: int = -1


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


def list_frames(sources: list[Source], params: SurveyParams, given: StereoCalibration | None = None) -> Listing:
    """Find the pairs of all sources and choose those asked for.

    Parameters
    ----------
    sources : list of Source
    params : SurveyParams
    given : StereoCalibration, optional
        Instead of what the recordings say.

    Raises
    ------
    BagError
        There is no pair at all, or none is chosen; the text says why.
    """
    listing, rigs = Listing(), Rigs(given)
    for index, source in enumerate(sources):
        try:
            found = _list_source(source, index, params, rigs, listing.notes)
        except (BagError, CalibrationError) as error:
            listing.unreadable.append(str(error))
            continue
        _note_backward_steps(source, found, listing.notes)
        listing.frames += found
    listing.frames = [replace(frame, number=number) for number, frame in enumerate(listing.frames)]
    listing.pairs = len(listing.frames)
    if not listing.frames:
        raise BagError("no stereo pairs: " + "; ".join([*listing.unreadable, *listing.notes]))
    listing.frames = choose(listing.frames, params)
    listing.calibrations = rigs.calibrations
    return listing


def choose(frames: list[Frame], params: SurveyParams) -> list[Frame]:
    """Apply `start`, `end`, `every` and `max_frames`.

    Raises
    ------
    BagError
        Nothing is left.
    """
    first = frames[0].stamp_ns
    end = params.end or float("inf")
    within = [frame for frame in frames if params.start <= (frame.stamp_ns - first) / 1e9 <= end]
    chosen = within[:: params.every][: params.max_frames or None]
    if not chosen:
        lasts = (max(frame.stamp_ns for frame in frames) - first) / 1e9
        raise BagError(f"start {params.start:g} s: expected pairs there, the input lasts {lasts:g} s")
    return chosen


def _list_source(source: Source, index: int, params: SurveyParams, rigs: Rigs, notes: list[str]) -> list[Frame]:
    if source.kind == "stills":
        return [
            Frame(0, index, stamp_ns, Place(left, stamp_ns), Place(right, stamp_ns), rig)
            for stamp_ns, left, right, rig in list_stills(source, params, rigs, notes)
        ]
    with open_bag(Path(source.path)) as bag:
        topics = bag.stereo_topics(params.left_topic or None, params.right_topic or None)
        walk = _Walk(bag, topics, index, round(params.pair_tolerance_ms * 1e6), rigs)
        frames = list(walk)
        notes += [f"{source.name}: {sentence}" for sentence in [*bag.damage, *walk.notes()]]
    if not frames:
        raise BagError(f"{source.name}: no pair within {params.pair_tolerance_ms:g} ms: {walk.nearest()}")
    return frames


class _Walk:
    """Pairs the messages of a bag by the stamps at the beginning of their bytes."""

    def __init__(self, bag: BagReader, topics: StereoTopics, source: int, tolerance_ns: int, rigs: Rigs) -> None:
        self._bag, self._topics, self._source, self._rigs = bag, topics, source, rigs
        self._eyes = {topics.left: 0, topics.right: 1}
        self._infos = {topics.left_info: CameraInfoCache(), topics.right_info: CameraInfoCache()}
        self._synchronizer: Synchronizer[tuple[int, Place]] = Synchronizer(2, tolerance_ns)
        self._seen: Counter[tuple[str, int]] = Counter()
        self._log_ns = {topics.left: -1, topics.right: -1}
        self._counts, self._lasts, self._shapeless = [0, 0], [0, 0], 0
        self._pairs = 0
        self._closest: int | None = None

    def __iter__(self) -> Iterator[Frame]:
        names = [n for n in (self._topics.left, self._topics.right, *self._infos) if n]
        self._learn_first_infos()
        for message in self._bag.raw_messages(names):
            if message.topic in self._infos:
                self._learn(message)
            else:
                yield from self._push(message)

    def _learn_first_infos(self) -> None:
        """What the first CameraInfo says holds from the first image on: it is recorded after it, most often."""
        for name in filter(None, self._infos):
            first = next(self._bag.raw_messages([name]), None)
            if first is not None:
                self._learn(first)

    def _learn(self, message: RawMessage) -> None:
        try:
            self._infos[message.topic].update(message)
        except BagError:  # not CDR of a CameraInfo: as if it had not come
            return

    def _push(self, message: RawMessage) -> Iterator[Frame]:
        if len(message.data) < _STAMP.size:
            self._shapeless += 1
            return
        eye = self._eyes[message.topic]
        big = message.data[1] == 0
        seconds, rest = (_BIG_STAMP if big else _STAMP).unpack_from(message.data)
        stamp = seconds * 1_000_000_000 + rest
        self._counts[eye] += 1
        self._lasts[eye] = stamp
        for left, right in self._synchronizer.push(eye, stamp, (stamp, self._place(message))):
            self._pairs += 1
            yield Frame(0, self._source, left[0], left[1], right[1], self._rig())
        self._watch_gap()

    def _place(self, message: RawMessage) -> Place:
        """Times never go back within a bag, so only the last moment's messages need counting."""
        if self._log_ns[message.topic] != message.stamp_ns:
            self._log_ns[message.topic] = message.stamp_ns
            self._seen[message.topic, 0] = 0
        nth = self._seen[message.topic, 0]
        self._seen[message.topic, 0] += 1
        return Place(message.topic, message.stamp_ns, nth)

    def _rig(self) -> int:
        left, right = (self._infos[n].camera for n in (self._topics.left_info, self._topics.right_info))
        return self._rigs.index(StereoCalibration(left, right) if left and right else None)

    def _watch_gap(self) -> None:
        if all(self._counts) and not self._pairs:
            gap = abs(self._lasts[0] - self._lasts[1])
            self._closest = gap if self._closest is None else min(gap, self._closest)

    def nearest(self) -> str:
        """Why there is no pair."""
        counts = f"{self._counts[0]} left and {self._counts[1]} right images"
        if self._closest is None:
            return counts
        return f"{counts}, the nearest stamps {self._closest / 1e6:g} ms apart (--pair-tolerance-ms)"

    def notes(self) -> list[str]:
        """What is odd about the recording."""
        problems = dict.fromkeys(str(i.problem) for i in self._infos.values() if i.problem)
        notes = [f"camera_info not used: {problem}" for problem in problems]
        if self._shapeless:
            notes.append(f"{self._shapeless} image messages too short to have a stamp")
        for eye, count in zip(("left", "right"), self._counts, strict=True):
            if count > self._pairs > 0:
                notes.append(f"{count - self._pairs} of {count} {eye} images have no partner")
        return notes


def _note_backward_steps(source: Source, frames: list[Frame], notes: list[str]) -> None:
    steps = [(a, b) for a, b in itertools.pairwise(frames) if b.stamp_ns < a.stamp_ns]
    if steps:
        before, after = steps[0]
        back = (before.stamp_ns - after.stamp_ns) / 1e9
        notes.append(
            f"{source.name}: stamps go back {len(steps)} times, first by {back:g} s (a looped or spliced bag?)"
        )
