"""Where the pairs of a recording are: the images of a bag paired by their stamps alone, without decoding them."""

from __future__ import annotations

import heapq
import itertools
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from uw_recon_ros.bags import BagReader, RawMessage, StereoTopics
from uw_recon_ros.bags.stereo import CameraInfoCache
from uw_recon_ros.calibration.rectified import rig_as_imaged
from uw_recon_ros.errors import BagError
from uw_recon_ros.pairing import Synchronizer
from uw_recon_ros.types import CameraModel, StereoCalibration


@dataclass(frozen=True)
class Place:
    """Where one image is.

    Parameters
    ----------
    name : str
        Topic, or file of a still or a video.
    log_ns : int
        When the message was recorded, or a frame shown, ns.
    nth : int
        Which of the messages of that topic and time, from 0; a frame's presentation time in its video's unit.
    part : str
        Which view of an image with both: layout and side, as ``side-by-side:0``; empty: the whole image.
    """

    name: str
    log_ns: int = 0
    nth: int = 0
    part: str = ""


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
    before : (Place, Place) or None
        Left and right of the pair before it in the same source; of a video, of one half a second or more before.
    lag_ns : int
        The right image was taken so much later than the left one, where the cameras have no common trigger.
    around : tuple of (ns, Place)
        Of a pair with a lag: left images before and after it, and their time from it.
    """

    number: int
    source: int
    stamp_ns: int
    left: Place
    right: Place
    rig: int = -1
    before: tuple[Place, Place] | None = None
    lag_ns: int = 0
    around: tuple[tuple[int, Place], ...] = ()


_Key = tuple[bytes | str | int, ...]


class Rigs:
    """Numbers calibrations in the order they appear.

    Parameters
    ----------
    given : StereoCalibration, optional
        Taken instead of any other.
    images_rectified : {'auto', 'yes', 'no'}
        Whether images come rectified already; auto: by the names of their topics.

    Attributes
    ----------
    calibrations : list of StereoCalibration
    """

    def __init__(self, given: StereoCalibration | None = None, images_rectified: str = "auto") -> None:
        self.images_rectified = images_rectified
        self.calibrations: list[StereoCalibration] = []
        self.given = given
        self._numbers: dict[_Key, int] = {}
        self._last: tuple[StereoCalibration, tuple[bool, bool], int] | None = None

    def index(self, found: StereoCalibration | None, rectified: tuple[bool, bool]) -> int:
        """Number of the calibration of images that came rectified or not; -1 for none."""
        calibration = self.given or found
        if calibration is None:
            return -1
        if self._last and self._last[1] == rectified and _same(self._last[0], calibration):
            return self._last[2]
        imaged = rig_as_imaged(calibration, rectified)
        key = (*_key(imaged.left), *_key(imaged.right))
        if key not in self._numbers:
            self._numbers[key] = len(self.calibrations)
            self.calibrations.append(imaged)
        self._last = calibration, rectified, self._numbers[key]
        return self._numbers[key]


def _same(one: StereoCalibration, other: StereoCalibration) -> bool:
    return one.left is other.left and one.right is other.right


def _key(camera: CameraModel) -> _Key:
    arrays = (camera.k, camera.d, camera.r, camera.p)
    return (camera.width, camera.height, camera.distortion_model, camera.frame_id, *(a.tobytes() for a in arrays))


_STAMP = struct.Struct("<4xiI")  # CDR's encapsulation, then the header's stamp
_BIG_STAMP = struct.Struct(">4xiI")


class StampPairer:
    """Pairs the messages of a bag by the stamps at the beginning of their bytes; iterate once, then ask.

    Parameters
    ----------
    bag : BagReader
    topics : StereoTopics
    source : int
        Number that the frames carry.
    tolerance_ns : int
        Largest difference of stamps within a pair, ns.
    rigs : Rigs
        Learns the calibrations.
    offset_ns : int
        What the right camera's stamps are ahead of the left one's.
    on_message : callable
        Is given every message of the rig's topics as it passes, so that a bag is read once.
    """

    def __init__(
        self,
        bag: BagReader,
        topics: StereoTopics,
        source: int,
        tolerance_ns: int,
        rigs: Rigs,
        offset_ns: int = 0,
        on_message: Callable[[RawMessage], None] = lambda message: None,
    ) -> None:
        self._on_message = on_message
        self._offset_ns, self._stampless, self._by_log = offset_ns, 0, False
        self._bag, self._topics, self._source, self._rigs = bag, topics, source, rigs
        self._rectified = topics.rectified(rigs.images_rectified)
        self._cameras = {topics.left: 0, topics.right: 1}
        self._infos = {topics.left_info: CameraInfoCache(), topics.right_info: CameraInfoCache()}
        self._synchronizer: Synchronizer[tuple[int, Place]] = Synchronizer(2, tolerance_ns)
        self._last_place = {name: Place(name, -1) for name in (topics.left, topics.right)}
        self._counts, self._lasts, self._shapeless = [0, 0], [0, 0], 0
        self._pairs = 0
        self._closest: int | None = None

    def __iter__(self) -> Iterator[Frame]:
        self._learn_first_infos()
        self._by_log = not any(map(any, map(self._first_stamps, (self._topics.left, self._topics.right))))
        for message in self._messages():
            self._on_message(message)
            if message.topic in self._infos:
                self._learn(message)
            else:
                yield from self._push(message)

    def _messages(self) -> Iterator[RawMessage]:
        """In log-time order; where the clocks differ, in that of the left one's, so that partners come together."""
        topics = self._topics
        names = [
            [n for n in side if n] for side in ((topics.left, topics.left_info), (topics.right, topics.right_info))
        ]
        if not self._offset_ns:
            return self._bag.raw_messages([*names[0], *names[1]])
        ours, theirs = map(self._bag.raw_messages, names)
        shifted = (
            ((raw.log_ns - offset, raw) for raw in side) for offset, side in ((0, ours), (self._offset_ns, theirs))
        )
        return (raw for _, raw in heapq.merge(*shifted, key=lambda timed: timed[0]))

    def _first_stamps(self, topic: str) -> list[int]:
        """Of a few messages: a driver that sends none sends zeros."""
        first = itertools.islice(self._bag.raw_messages([topic]), 3)
        return [sum(_STAMP.unpack_from(message.data)) for message in first if len(message.data) >= _STAMP.size]

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
        side = self._cameras[message.topic]
        big = message.data[1] == 0
        seconds, rest = (_BIG_STAMP if big else _STAMP).unpack_from(message.data)
        stamp = seconds * 1_000_000_000 + rest
        if self._by_log:
            stamp = message.log_ns
            self._stampless += 1
        stamp -= self._offset_ns * side
        self._counts[side] += 1
        self._lasts[side] = stamp
        for left, right in self._synchronizer.push(side, stamp, (stamp, self._place(message))):
            self._pairs += 1
            yield Frame(0, self._source, left[0], left[1], right[1], self._rig())
        self._watch_gap()

    def _place(self, message: RawMessage) -> Place:
        """Log times never go back within a bag, so only the last message need be remembered."""
        last = self._last_place[message.topic]
        nth = last.nth + 1 if last.log_ns == message.log_ns else 0
        self._last_place[message.topic] = Place(message.topic, message.log_ns, nth)
        return self._last_place[message.topic]

    def _rig(self) -> int:
        left, right = (self._infos[n].camera for n in (self._topics.left_info, self._topics.right_info))
        return self._rigs.index(StereoCalibration(left, right) if left and right else None, self._rectified)

    def _watch_gap(self) -> None:
        if all(self._counts) and not self._pairs:
            gap = abs(self._lasts[0] - self._lasts[1])
            self._closest = gap if self._closest is None else min(gap, self._closest)

    def nearest(self) -> str:
        """Why there is no pair."""
        counts = f"{self._counts[0]} left and {self._counts[1]} right images"
        if self._closest is None:
            return counts
        return (
            f"{counts}, the nearest stamps {self._closest / 1e6:g} ms apart: where that is jitter, "
            "--pair-tolerance-ms; where the clocks differ, --clock-offset SECONDS"
        )

    def notes(self) -> list[str]:
        """What is odd about the recording."""
        problems = dict.fromkeys(str(i.problem) for i in self._infos.values() if i.problem)
        notes = [f"camera_info not used: {problem}" for problem in problems]
        if any(self._rectified):
            notes.append("images already rectified: described by P alone (images_rectified: no, where they are not)")
        if self._stampless:
            notes.append(f"{self._stampless} images without a stamp: paired by the time they were recorded")
        if self._shapeless:
            notes.append(f"{self._shapeless} image messages too short to have a stamp")
        for side, count in zip(("left", "right"), self._counts, strict=True):
            if count > self._pairs > 0:
                notes.append(f"{count - self._pairs} of {count} {side} images have no partner")
        return notes
