"""The end of the chain: does a cloud come, is there anything in it, does anybody want it."""

from __future__ import annotations

import re

from uw_recon_ros.doctor.calibrations import scale_is_unknown
from uw_recon_ros.doctor.check import Check, fail, ok, warn
from uw_recon_ros.doctor.observation import Observation, ObservedTopic
from uw_recon_ros.doctor.stages import EXCHANGE, EXCHANGED
from uw_recon_ros.doctor.topic_graph import METRIC_CLOUD, TYPES, UNSCALED_CLOUD
from uw_recon_ros.topics import POINT_CLOUD

_STAGE = "cloud"
_SPARSE = 0.05
_RESULTS = (METRIC_CLOUD, "points2_filtered", UNSCALED_CLOUD)


_FOR_AUTOPILOTS = ("obstacles", "range")
_SILENT = ("not published", "all sectors unknown", "silent", "waiting")
_RANGE = re.compile(r"(-?\d+) to (-?\d+) px")


def _empty(topic: ObservedTopic, seen: Observation) -> Check:
    """Clouds come and hold nothing: behind a rig whose cameras are swapped there is nothing to see."""
    text = f"{topic.name}: clouds without a point"
    for node in seen.nodes.values():
        said = node.statuses[-1].values if node.statuses else {}
        found = _RANGE.search(said.get("disparities", ""))
        if (found and int(found[2]) < 0) or said.get("last drop code") in EXCHANGED:
            searched = f"; disparities are {found[0]}" if found else ""
            return fail(_STAGE, f"{text}: left and right images seem swapped{searched}", EXCHANGE)
    return fail(_STAGE, text, "look at disparity/status: it says why, pixel by pixel")


def _contents(topic: ObservedTopic, seen: Observation) -> Check:
    came = topic.arrivals
    share = came.valid_share
    if share == 0:
        return _empty(topic, seen)
    text = f"{topic.name}: {came.rate_hz:.1f} Hz, {came.width}x{came.height} in frame '{came.frame_id}'"
    if share is not None:
        text += f", {share:.0%} of the pixels have a point"
    if share is not None and share < _SPARSE:
        advice = "look at disparity/status; widen min_disparity and max_disparity, or come closer: the water is murky"
        return warn(_STAGE, text, advice)
    if not came.frame_id:
        return warn(_STAGE, f"{text}: RViz shows no cloud without a frame", "set the camera driver's frame_id")
    return ok(_STAGE, text)


def check_clouds(seen: Observation) -> list[Check]:
    """Look at what comes out at the end."""
    metric, unscaled = (seen.topics.get(name, ObservedTopic(name)) for name in (METRIC_CLOUD, UNSCALED_CLOUD))
    if metric.arrivals.count:
        return [_contents(metric, seen)]
    if scale_is_unknown(seen):
        text = f"no {metric.name}: the scale is unknown; {unscaled.name} comes instead"
        rate = f" ({unscaled.arrivals.rate_hz:.1f} Hz)"
        return [
            fail(_STAGE, text + rate, "give the rig a scale: a calibration, or baseline_m and focal_px", symptom=True)
        ]
    return [fail(_STAGE, f"no cloud in {seen.seconds:.1f} s", symptom=True)]


def check_autopilot(seen: Observation) -> list[Check]:
    """Where somebody listens to obstacles or range: what the node tells on them, or the cause it names for silence."""
    found = []
    for name in _FOR_AUTOPILOTS:
        topic = seen.topics.get(name, ObservedTopic(name))
        statuses = (node.statuses[-1].values for node in seen.nodes.values() if node.statuses)
        said = next((values[name] for values in statuses if name in values), "")
        if topic.subscribers and said:
            text = f"{topic.name}: {said}"
            silent = warn("autopilot", text, "see docs/how-to/autopilot.md", symptom=True)
            found.append(silent if said.startswith(_SILENT) else ok("autopilot", text))
    return found


def check_listeners(seen: Observation) -> list[Check]:
    """See who wants the clouds, and who waits for them under another name."""
    topics = [seen.topics.get(name, ObservedTopic(name)) for name in _RESULTS]
    listeners = {end.node for topic in topics for end in topic.subscribers}
    astray = [
        f"{', '.join(sorted({end.node for end in topic.subscribers}))} on {topic.name}"
        for topic in seen.others
        if not topic.publishers and topic.name.rsplit("/", 1)[-1] in TYPES | {"surface": ""}
        and any(end.type == POINT_CLOUD for end in topic.subscribers)
    ]  # fmt: skip
    found = []
    if astray:
        text = f"waiting where nobody publishes: {'; '.join(astray)} (ours is {topics[0].name})"
        found.append(warn("listeners", text, "remap, or start both in one name space"))
    if listeners:
        found.append(ok("listeners", f"{', '.join(sorted(listeners))} listen to the clouds"))
    else:
        text = "nobody but this doctor listens to the clouds: no subscribers: the nodes stay idle"
        found.append(warn("listeners", text, f"subscribe, e.g. RViz to {topics[0].name}"))
    return found
