"""The images: do they come, do the cameras agree, do their stamps pair up."""

from __future__ import annotations

import math
import statistics
from bisect import bisect_left
from collections.abc import Sequence

from uw_recon_ros.doctor.check import Check, fail, ok, warn
from uw_recon_ros.doctor.observation import Arrivals, Observation, ObservedTopic
from uw_recon_ros.doctor.suggestions import for_image, namespace_of, same_elsewhere
from uw_recon_ros.doctor.topic_graph import TYPES
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.video_packets import codec_named
from uw_recon_ros.images import decode_image
from uw_recon_ros.node_params import NodeParams
from uw_recon_ros.topics import IMAGE, SIDES, image_topics, transport_of

_STAGE = "cameras"
_MS = 1e6
_ENOUGH, _NEARLY_ALL = 0.5, 0.9
#: Fast DDS's default segment of shared memory: what is larger is lost under best effort.
_DEFAULT_SEGMENT = 512 << 10


def image_topic(seen: Observation, side: str) -> ObservedTopic:
    """The topic that brings a camera's images: raw where it is published, else compressed, else video."""
    asked = str(seen.parameter("image_transport", "auto"))
    names = [name for name in image_topics(side) if transport_of(name) == asked] or image_topics(side)
    choice = [seen.topics.get(name, ObservedTopic(name)) for name in names]
    return next((topic for topic in choice if topic.publishers), choice[0])


def _missing(seen: Observation, side: str) -> Check:
    """Nobody publishes a camera: say what was probably meant."""
    topic, names = image_topic(seen, side), image_topics(side)
    raw = names[0]
    text = f"{topic.name}: no publisher"
    other = next((name for name in names if name in seen.topics and seen.topics[name].publishers), None)
    if other:
        text, transport = f"{text}, but {seen.topics[other].name} has one", transport_of(other)
        return fail(_STAGE, text, f"set image_transport to {transport} or auto")
    found = ((name, same_elsewhere(name, TYPES.values(), seen.others)) for name in names)
    same, moved = next(((name, topics) for name, topics in found if topics), (raw, []))
    if moved:
        space = namespace_of(moved[0], same)
        return fail(
            _STAGE,
            f"{text}, but {' and '.join(moved)} has one",
            f"start the nodes with namespace:={space} (-r __ns:={space}), or remap {raw}:={moved[0]}",
        )
    likely = for_image(side, seen.others)
    if likely:
        name = next((name for name in names[1:] if transport_of(likely[0]) == transport_of(name)), raw)
        return fail(_STAGE, f"{text}; likely meant: {', '.join(likely[:3])}", f"start with -r {name}:={likely[0]}")
    images = sorted(t.name for t in seen.others if IMAGE in t.types)
    listed = f"; images seen: {', '.join(images[:5])}" if images else "; no image topic is seen at all"
    return fail(_STAGE, text + listed, "start the cameras or a bag, or remap their topics to left/ and right/image_raw")


def _silent(seen: Observation, topic: ObservedTopic) -> Check:
    """There is a publisher, but nothing came."""
    text = f"{topic.name}: a publisher ({topic.publishers[0].node}), but no message in {seen.seconds:.1f} s"
    if topic.types - {TYPES[_relative(seen, topic)]}:
        return fail(_STAGE, text, symptom=True)
    if seen.clock.stands_still:
        return fail(_STAGE, f"{text}; /clock stands still", "resume the bag or simulation: it is paused")
    if not all(end.reliable for end in topic.publishers):
        return fail(
            _STAGE,
            f"{text}; it offers best effort: images over 512 KiB are lost with Fast DDS's default shared memory",
            "have it publish reliable, or give its process a larger segment (a Fast DDS profile, see "
            "docs/troubleshooting.md)",
        )
    return fail(_STAGE, text, "see whether the camera streams, and whether the driver's log complains")


def _relative(seen: Observation, topic: ObservedTopic) -> str:
    return next((name for name, known in seen.topics.items() if known.name == topic.name), "left/image_raw")


def _describe(topic: ObservedTopic) -> str:
    came = topic.arrivals
    size = f"{came.width}x{came.height} " if came.width else ""
    return f"{topic.name}: {came.rate_hz:.1f} Hz, {size}{came.encoding} from {topic.publishers[0].node}"


def _camera(seen: Observation, side: str) -> list[Check]:
    topic = image_topic(seen, side)
    if not topic.publishers:
        return [_missing(seen, side)]
    if not topic.arrivals.count:
        return [_silent(seen, topic)]
    found = [ok(_STAGE, _describe(topic))]
    if len(topic.publishers) > 1:
        names = ", ".join(end.node for end in topic.publishers)
        found.append(warn(_STAGE, f"{topic.name}: {len(topic.publishers)} publishers ({names})", "stop all but one"))
    if topic.arrivals.size_bytes > _DEFAULT_SEGMENT and not all(end.reliable for end in topic.publishers):
        size = f"{topic.arrivals.size_bytes / (1 << 20):.1f} MiB"
        found.append(
            warn(
                _STAGE,
                f"{topic.name}: best effort with images of {size}: some or all are lost on the way",
                "have the driver publish reliable",
            )
        )
    return found


def _kind(encoding: str) -> tuple[int, str]:
    """Channels and type that an encoding is decoded to."""
    decoded = decode_image(bytes(8 * 64), height=8, width=8, encoding=encoding, step=64)
    return decoded.ndim, str(decoded.dtype)


def _formats(left: Arrivals, right: Arrivals) -> list[Check]:
    """Both cameras need one size, and one kind of pixel."""
    if not (left.width and right.width):
        return []
    if (left.width, left.height) != (right.width, right.height):
        text = f"left images are {left.width}x{left.height}, right ones {right.width}x{right.height}"
        return [fail(_STAGE, text, "set both cameras to one resolution and one region of interest")]
    if any(codec_named(came.encoding) for came in (left, right)):
        return []
    try:
        kinds = [_kind(came.encoding) for came in (left, right)]
    except ImageError as error:
        return [fail(_STAGE, str(error), "set the driver's encoding to bgr8, rgb8 or mono8")]
    if kinds[0] != kinds[1]:
        text = f"left images are {left.encoding}, right ones {right.encoding}"
        return [fail(_STAGE, text, "set both drivers to one encoding")]
    return []


def offsets_ms(left: Sequence[int], right: Sequence[int]) -> list[float]:
    """Of each left stamp within the right ones' span (or the other way round): how far its nearest partner is, ms."""
    if not left or not right:
        return []
    ordered = sorted(right)
    apart: list[float] = []
    for stamp in left:
        place = bisect_left(ordered, stamp)
        apart.append(min((other - stamp for other in ordered[max(place - 1, 0) : place + 1]), key=abs) / _MS)
    inside = [gap for stamp, gap in zip(left, apart, strict=True) if ordered[0] <= stamp <= ordered[-1]]
    return inside or [min(apart, key=abs)]


def _stamps(seen: Observation, left: Arrivals, right: Arrivals) -> list[Check]:
    """Whether left and right stamps lie within the tolerance of each other."""
    if not any(left.stamps_ns) or not any(right.stamps_ns):
        text = "stamps are zero: left and right images cannot be told which belong together"
        return [fail(_STAGE, text, "have the driver stamp its images")]
    tolerance = float(seen.parameter("pair_tolerance_ms", NodeParams().pair_tolerance_ms))
    few, many = sorted((left.stamps_ns, right.stamps_ns), key=len)
    apart = offsets_ms(few, many)
    paired = sum(abs(gap) <= tolerance for gap in apart) / len(apart)
    median = statistics.median(abs(gap) for gap in apart)
    if paired < _ENOUGH:
        return [_apart(left, median, paired, tolerance)]
    if paired < _NEARLY_ALL:
        text = f"{1 - paired:.0%} of the images find no partner within pair_tolerance_ms ({tolerance:g})"
        return [warn(_STAGE, text, "see whether a camera drops frames, or raise pair_tolerance_ms a little")]
    found = [ok(_STAGE, f"stamps pair up: {median:.3g} ms apart (pair_tolerance_ms {tolerance:g})")]
    slow, fast = sorted((left.rate_hz, right.rate_hz))
    if slow < 0.75 * fast:
        text = f"rates differ: left {left.rate_hz:.1f} Hz, right {right.rate_hz:.1f} Hz: pairs come at the lower one"
        found.append(warn(_STAGE, text, "set both cameras to one rate"))
    return found


def _apart(left: Arrivals, median_ms: float, paired: float, tolerance_ms: float) -> Check:
    period_ms = 1e3 / left.rate_hz if left.rate_hz else math.inf
    text = (
        f"stamps are apart: left and right {median_ms:.1f} ms (median), pair_tolerance_ms is {tolerance_ms:g}; "
        f"{paired:.0%} of the images find a partner"
    )
    if median_ms > 0.6 * period_ms:
        return fail(_STAGE, text, "set both cameras' clocks to one time source (PTP, or stamps by one host)")
    return fail(
        _STAGE,
        text,
        f"trigger the cameras together; or set pair_tolerance_ms to {math.ceil(1.2 * median_ms)} if the scene moves "
        "little in that time",
    )


def check_cameras(seen: Observation) -> list[Check]:
    """Look at both cameras' images."""
    found = [finding for side in SIDES for finding in _camera(seen, side)]
    left, right = (image_topic(seen, side).arrivals for side in SIDES)
    if left.count and right.count:
        found += [*_formats(left, right), *_stamps(seen, left, right)]
    return found
