"""The stereo pairs of a bag: which topics are the cameras, and their messages paired by stamp."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.messages import CAMERA_INFO, IMAGE, IMAGES
from uw_recon_ros.bags.model import RawMessage, TopicInfo
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.calibration.rectified import as_rectified, named_rectified, rectified_by_name
from uw_recon_ros.camera_sides import pairs_of, partners, side_of
from uw_recon_ros.errors import BagError, CalibrationError, ImageError, ReconError
from uw_recon_ros.findings import Code
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.pairing import Synchronizer
from uw_recon_ros.types import CameraModel, StereoCalibration, StereoPair

#: What a simulator knows and no camera says.
_TRUTH = re.compile(r"(^|[/_])(truth|ground_truth|gt)([/_]|$)", re.IGNORECASE)
_DERIVED = re.compile(r"depth|disparity|truth|enhanced|matching|mask|status|sigma|debug(?!_)|theora|aligned")
_IMAGE_LIKE = re.compile(r"image|video|h26|packet|jpeg|frame(?!id)", re.IGNORECASE)
_KINDS = {"image", "images", "img", "raw", "rect", "rectified", "color", "colour", "mono", "gray", "grey", "rgb", "bgr"}
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
        return rectified_by_name(told, self.left), rectified_by_name(told, self.right)


def _rank(topic: TopicInfo) -> tuple[bool, bool, bool, int, str]:
    """Least is best: has messages, raw, not compressed, a usual name."""
    base = _image_base(topic)
    last = base.rsplit("/", 1)[-1]
    usual = _PREFERRED.index(last) if last in _PREFERRED else len(_PREFERRED)
    return topic.count == 0, named_rectified(topic.name), topic.type != IMAGE, usual, topic.name


def _image_base(topic: TopicInfo) -> str:
    """Name of the image topic that a transport's topic is of."""
    if topic.type == IMAGE:
        return topic.name
    return re.sub(r"/(compressed|ffmpeg|h264|h265|foxglove)$", "", topic.name)


def _info_topics(left: TopicInfo, right: TopicInfo, topics: Sequence[TopicInfo]) -> tuple[str | None, str | None]:
    """The ``camera_info`` beside either image topic, as image_transport finds it; else the nearest two of a pair."""
    infos = [t.name for t in topics if t.type == CAMERA_INFO and not _TRUTH.search(t.name)]
    beside: list[str | None] = []
    for image in (left, right):
        base = _image_base(image)
        names = (f"{base.rsplit('/', 1)[0]}/camera_info", f"{base}/camera_info", f"{base}_camera_info")
        beside.append(next((name for name in names if name in infos), None))
    if any(beside):
        return beside[0], beside[1]
    named = [pair for pair in pairs_of(infos) if _alike(pair[1], left.name) and _alike(pair[2], right.name)]
    return named[0][1:] if named else (None, None)


def _alike(info: str, image: str) -> bool:
    """Whether two topics are of one name space and do not contradict each other's camera."""
    return info.split("/")[1:2] == image.split("/")[1:2] or (
        side_of(info) in (0, 1) and side_of(info) == side_of(image)
    )


def _named(name: str, topics: Sequence[TopicInfo]) -> TopicInfo:
    wanted = "/" + name.strip("/")
    matching = [t for t in topics if t.type in IMAGES and wanted in (t.name, "/" + t.name)]
    if not matching:
        raise BagError(f"topic {name}: expected an image topic of the bag, it has {_list_images(topics)}")
    return min(matching, key=_rank)


def _list_images(topics: Iterable[TopicInfo]) -> str:
    images = [f"{t.name} ({t.count})" for t in topics if t.type in IMAGES]
    unread = [f"{t.name} ({t.type})" for t in topics if t.type not in IMAGES and _IMAGE_LIKE.search(_type(t))]
    told = ", ".join(images) if images else "no image topics"
    return f"{told}; of types that are not read: {', '.join(unread)}" if unread else told


def _type(topic: TopicInfo) -> str:
    return topic.type.rsplit("/", 1)[-1]


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
        Naming what the bag has instead, or the rigs there are.
    """
    images = [t for t in topics if t.type in IMAGES]
    if left and right:
        found = [(0, _named(left, topics), _named(right, topics))]
    else:
        lefts = [_named(left, topics)] if left else [t for t in images if not _DERIVED.search(t.name)]
        rights = [_named(right, topics)] if right else images
        found = [
            (grade, one, other)
            for one in lefts
            for name, grade in partners(_image_base(one)).items()
            for other in rights
            if _image_base(other).lower() == name and other.name != one.name
        ]
        raw = [t for t in rights if right or not _DERIVED.search(t.name)]
        found = found or _but_for_numbers([*lefts, *raw])
    if not found:
        raise BagError(
            f"no stereo pair: expected images of a left and a right camera, got {_list_images(topics)}: name both, "
            "--left-topic and --right-topic", Code.RECORDING_ONE_CAMERA,
        )  # fmt: skip
    best_left, best_right = _best(found, told=bool(left or right))
    return StereoTopics(best_left.name, best_right.name, *_info_topics(best_left, best_right, topics))


def _but_for_numbers(images: Sequence[TopicInfo]) -> list[tuple[int, TopicInfo, TopicInfo]]:
    """Cameras whose names tell the side, and differ in their serial numbers too."""
    by_base = {_image_base(topic): topic for topic in sorted(images, key=_rank, reverse=True)}
    return [(grade, by_base[one], by_base[other]) for grade, one, other in pairs_of(list(by_base))]


def best_images(topics: Sequence[TopicInfo]) -> str | None:
    """The images of a bag of one camera; None where it has none."""
    images = [t for t in topics if t.type in IMAGES and not _DERIVED.search(t.name)]
    return min(images, key=_rank).name if images else None


def holds_one_camera(topics: Sequence[TopicInfo]) -> bool:
    """Whether there are images, and not of two cameras."""
    try:
        find_stereo_topics(topics)
    except BagError as error:
        return error.code == Code.RECORDING_ONE_CAMERA and best_images(topics) is not None
    return False


def _best(found: list[tuple[int, TopicInfo, TopicInfo]], told: bool) -> tuple[TopicInfo, TopicInfo]:
    """The best topics of the only rig.

    Raises
    ------
    BagError
        There are several, named equally well.
    """
    filled = [pair for pair in found if pair[1].count and pair[2].count] or found
    grade = min(pair[0] for pair in filled)
    best = [pair for pair in filled if pair[0] == grade]
    rigs: dict[tuple[str, str], tuple[TopicInfo, TopicInfo]] = {}
    for _, one, other in sorted(best, key=lambda pair: (_rank(pair[1]), _rank(pair[2]))):
        rigs.setdefault(_rig(one, other), (one, other))
    if len(rigs) > 1 and not told:
        names = "; ".join(f"{one.name} and {other.name}" for one, other in rigs.values())
        raise BagError(
            f"several rigs: {names}: choose one, --left-topic and --right-topic", Code.RECORDING_SEVERAL_RIGS
        )
    return next(iter(rigs.values()))


def _rig(left: TopicInfo, right: TopicInfo) -> tuple[str, str]:
    """What all topics of one rig share: names up to where the cameras' differ, without words for kinds of images."""
    one, other = _image_base(left).split("/"), _image_base(right).split("/")
    differ = [place for place, (a, b) in enumerate(zip(one, other, strict=False)) if a.lower() != b.lower()]
    last = differ[-1] if differ else len(one) - 1
    if last < len(one) - 1:
        return "/".join(one[: last + 1]), "/".join(other[: last + 1])
    return _without_kind(one), _without_kind(other)


def _without_kind(parts: list[str]) -> str:
    words = re.findall(r"[a-z]+|[0-9]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", parts[-1]).lower())
    return "/".join([*parts[:-1], *(word for word in words if word not in _KINDS)])


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
