"""The stereo pairs of a bag: which topics are the cameras, and their messages paired by stamp."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.messages import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE
from uw_recon_ros.bags.model import RawMessage, TopicInfo
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.calibration.rectified import as_rectified, came_rectified, named_rectified
from uw_recon_ros.errors import BagError, CalibrationError, ImageError, ReconError
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.pairing import Synchronizer
from uw_recon_ros.types import CameraModel, StereoCalibration, StereoPair

#: How recordings name the two cameras, best known first.
_EYES = (
    ("left", "right"),
    ("cam0", "cam1"),
    ("camera0", "camera1"),
    ("infra1", "infra2"),
    ("cam_0", "cam_1"),
    ("l", "r"),
)
_NOT_RAW = re.compile(r"depth|disparity|truth|enhanced|matching|mask|status|sigma|debug|theora|h264")
_PREFERRED = ("image_raw", "image", "image_color", "image_mono")


@dataclass(frozen=True)
class StereoTopics:
    """The topics of a rig; CameraInfo topics are None where the bag has none."""

    left: str
    right: str
    left_info: str | None
    right_info: str | None

    def rectified(self, told: str) -> tuple[bool, bool]:
        """Whether the left and the right images come rectified, as ``images_rectified`` and their names tell."""
        return came_rectified(told, self.left), came_rectified(told, self.right)


def _other_camera(name: str) -> str | None:
    """The right camera's topic name for a left one's."""
    for left, right in _EYES:
        swapped = re.sub(rf"(?<![a-z0-9]){left}(?![a-z0-9])", right, name)
        if swapped != name:
            return swapped
    return None


def _rank(topic: TopicInfo) -> tuple[bool, bool, bool, int, str]:
    """Least is best: has messages, raw, not compressed, a usual name."""
    base = _image_base(topic)
    last = base.rsplit("/", 1)[-1]
    usual = _PREFERRED.index(last) if last in _PREFERRED else len(_PREFERRED)
    return topic.count == 0, named_rectified(topic.name), topic.type == COMPRESSED_IMAGE, usual, topic.name


def _image_base(topic: TopicInfo) -> str:
    return topic.name.removesuffix("/compressed") if topic.type == COMPRESSED_IMAGE else topic.name


def _info_topic(image: TopicInfo, topics: Sequence[TopicInfo]) -> str | None:
    """The ``camera_info`` beside an image topic, as image_transport finds it."""
    name = f"{_image_base(image).rsplit('/', 1)[0]}/camera_info"
    return name if any(topic.name == name and topic.type == CAMERA_INFO for topic in topics) else None


def _named(name: str, topics: Sequence[TopicInfo]) -> TopicInfo:
    wanted = "/" + name.strip("/")
    matching = [t for t in topics if t.type in (IMAGE, COMPRESSED_IMAGE) and wanted in (t.name, "/" + t.name)]
    if not matching:
        raise BagError(f"topic {name}: expected an image topic of the bag, it has {_list_images(topics)}")
    return min(matching, key=_rank)


def _list_images(topics: Iterable[TopicInfo]) -> str:
    images = [f"{t.name} ({t.count})" for t in topics if t.type in (IMAGE, COMPRESSED_IMAGE)]
    return ", ".join(images) if images else "no image topics"


def find_stereo_topics(topics: Sequence[TopicInfo], left: str | None = None, right: str | None = None) -> StereoTopics:
    """Find the two cameras by type and name.

    Parameters
    ----------
    topics : sequence of TopicInfo
    left, right : str or None
        Names to take instead of looking; given one, the other is looked for.

    Raises
    ------
    BagError
        Naming what the bag has instead.
    """
    images = [t for t in topics if t.type in (IMAGE, COMPRESSED_IMAGE)]
    pairs = []
    for candidate in [_named(left, topics)] if left else images:
        partners = [p for p in ([_named(right, topics)] if right else images) if p.name != candidate.name]
        pairs += [(candidate, p) for p in partners if (left and right) or _fit(candidate, p)]
    if not pairs:
        raise BagError(f"no stereo pair: expected images of a left and a right camera, got {_list_images(topics)}")
    best_left, best_right = min(pairs, key=lambda pair: (_rank(pair[0]), _rank(pair[1])))
    infos = _info_topic(best_left, topics), _info_topic(best_right, topics)
    return StereoTopics(best_left.name, best_right.name, *infos)


def _fit(left: TopicInfo, right: TopicInfo) -> bool:
    return _other_camera(_image_base(left)) == _image_base(right) and not _NOT_RAW.search(left.name)


class CameraInfoCache:
    """The camera a stream of CameraInfo messages describes, decoded again only when it changes.

    Parameters
    ----------
    rectified : bool
        Whether the images beside it come rectified.

    Attributes
    ----------
    camera : CameraModel or None
        None before the first message and when the last one is no calibration.
    problem : CalibrationError or None
        Why the last one is none.
    changes : int
        How often the content changed; -1 before the first message.
    """

    def __init__(self, rectified: bool = False) -> None:
        self._rectified = rectified
        self.camera: CameraModel | None = None
        self.problem: CalibrationError | None = None
        self.changes = -1
        self._seen: bytes | None = None

    @property
    def seen(self) -> bool:
        """Whether there was any message."""
        return self._seen is not None

    def update(self, message: RawMessage) -> None:
        """Take a message; one that says "not calibrated" leaves no camera."""
        without_stamp = message.data[:4] + message.data[12:]
        if without_stamp == self._seen:
            return
        self._seen = without_stamp
        self.changes += 1
        self.camera = self.problem = None
        try:
            camera = camera_from_info(messages.decode(message))
            self.camera = as_rectified(camera) if self._rectified else camera
        except CalibrationError as error:
            self.problem = error


def pair_messages(
    raw: Iterable[RawMessage],
    topics: StereoTopics,
    tolerance_ns: int,
    note: Callable[[str], None],
    infos: tuple[CameraInfoCache, CameraInfoCache],
) -> Iterator[tuple[Any, Any]]:
    """Decoded left and right image messages that belong together, in order; CameraInfo goes into `infos`."""
    synchronizer: Synchronizer[Any] = Synchronizer(2, tolerance_ns)
    streams = {topics.left: 0, topics.right: 1}
    info_streams = {topics.left_info: 0, topics.right_info: 1}
    for message in raw:
        try:
            if message.topic in info_streams:
                infos[info_streams[message.topic]].update(message)
                continue
            decoded = messages.decode(message)
        except BagError as error:
            note(str(error))
            continue
        for group in synchronizer.push(streams[message.topic], messages.stamp_ns(decoded), decoded):
            yield group[0], group[1]


def make_pair(left: Any, right: Any, calibration: StereoCalibration | None) -> StereoPair:
    """Arrays and nouns of two paired messages.

    Raises
    ------
    ImageError
        Naming the camera, or what `as_pair` refuses.
    """
    arrays = []
    for side, message in (("left", left), ("right", right)):
        try:
            arrays.append(messages.image_from_message(message))
        except ReconError as error:
            raise ImageError(f"{side} image: {error}", error.code) from error
    first, second, findings = as_pair(*arrays)
    return StereoPair(first, second, messages.stamp_ns(left), str(left.header.frame_id), calibration, findings)
