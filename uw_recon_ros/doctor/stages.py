"""The nodes: running, alone, active, content, and sending something."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

from uw_recon_ros.doctor.check import Check, Level, fail, ok, warn
from uw_recon_ros.doctor.observation import GraphNode, NodeStatus, Observation, ObservedTopic
from uw_recon_ros.doctor.topic_graph import CHAIN, FURTHER, METRIC_CLOUD, PIPELINE, STAGES, UNSCALED_CLOUD, Stage
from uw_recon_ros.findings import Code

_OK, _WARN, _ERROR = 0, 1, 2
#: Standing problems that only say that nothing usable comes in: what keeps it from coming is found upstream.
_WAITING = ("silent", "unpaired")
#: The graph's way to keep up, no fault.
_HARMLESS = frozenset((
    "superseded by newer", "no partner within tolerance", "no longer wanted: deactivated, or nobody listens",
    "passed over: more than max_rate_hz",
))  # fmt: skip
EXCHANGE = "swap the topics of left and right, or the calibrations"
EXCHANGED = (Code.RECTIFY_EXCHANGED.value, Code.MATCH_EXCHANGED.value)
_REMEDIES = {
    Code.ODOMETRY_LOST.value: "slower, nearer to the bottom, or more light",
    **dict.fromkeys(EXCHANGED, EXCHANGE),
    Code.RECTIFY_TIE_POINTS.value: "see left/image_matching: haze, darkness or no overlap? Calibrated rigs need no tie "
    "points",
    Code.RECTIFY_NO_PARALLAX.value: "see that the two topics are not of one camera",
    Code.RECTIFY_UPSIDE_DOWN.value: "turn that camera's images by 180 deg (the driver's flip), and calibrate so",
    Code.IMAGE_IDENTICAL.value: "see that the two topics are not of one camera",
    Code.RECTIFY_FLAT_SCENE.value: "wait for a scene with depth, or calibrate the rig",
    Code.RECTIFY_CALIBRATED_IN_AIR.value: "calibrate in water: a calibration made in air does not hold there",
    "rate": "a faster effort (navigation), smaller images, or a lower target_rate_hz",
}
_LOOK = "look at its log, restart it"
_MOVES = {"unconfigured": ("configure", "activate"), "inactive": ("activate",)}


def _worst(node: GraphNode, *, content: bool) -> NodeStatus | None:
    """The last status; where nothing comes out, the worst one: refusals of a slow stream show every few seconds."""
    if content or not node.statuses:
        return node.statuses[-1] if node.statuses else None
    return max(reversed(node.statuses), key=lambda status: status.level)


def _lifecycle(stage: Stage, node: GraphNode) -> Iterator[Check]:
    if node.lifecycle is None or node.lifecycle == "active":
        return
    if not node.lifecycle:
        yield fail(stage.label, f"{node.name} does not say in which state it is: it hangs", _LOOK)
        return
    trouble = node.statuses[-1].values.get("transition", "") if node.statuses else ""
    text = f"{node.name} is {node.lifecycle}: " + (trouble or "a managed node works only when active")
    moves = "; ".join(f"ros2 lifecycle set {node.name} {move}" for move in _MOVES.get(node.lifecycle, ()))
    yield fail(stage.label, text, f"{moves}, or start it with autostart true" if moves else _LOOK)


def _status(stage: Stage, node: GraphNode, status: NodeStatus) -> Iterator[Check]:
    """What the node itself complains of."""
    if status.level >= _ERROR:
        kinds = _faults(status)
        counted = f" ({kinds})" if kinds else ""
        yield fail(stage.label, f"{node.name} refuses every frame: {status.message}{counted}", _remedy(status))
    elif status.level == _WARN:
        waiting = any(key in status.values for key in _WAITING)
        yield warn(stage.label, f"{node.name}: {status.message}", "" if waiting else _remedy(status), symptom=waiting)


def _faults(status: NodeStatus) -> str:
    """Frames given up since the node's start, by reason, overtaken ones left out."""
    drops = {k.removeprefix("dropped: "): v for k, v in status.values.items() if k.startswith("dropped: ")}
    return ", ".join(f"{reason} x{number}" for reason, number in drops.items() if reason not in _HARMLESS)


def _remedy(status: NodeStatus) -> str:
    """What to do about what a node complains of: by its codes."""
    values = status.values
    told = [*values.get("codes", "").split(","), *values]
    if status.level >= _ERROR or status.message == values.get("last drop"):
        told.insert(0, values.get("last drop code", ""))
    advice = next((_REMEDIES[code] for code in told if code in _REMEDIES), None)
    return advice or "the message says what was expected and what came"


#: What a stage's node says of its last frame, beside the rate.
_FACTS = {
    "rectify": ("row_error_median_px",),
    "disparity": ("density", "disparities"),
    "point cloud": ("work [s]", "latency [s]"),
}


def _works(stage: Stage, topic: ObservedTopic, status: NodeStatus | None) -> Check:
    facts = status.values if status else {}
    said = [f"{name} {facts[name]}" for name in _FACTS.get(stage.label, ()) if name in facts]
    makers = ", ".join(end.node for end in topic.publishers) or "a node that has gone"
    text = f"{topic.name}: {topic.arrivals.rate_hz:.1f} Hz from {makers}"
    if status and _faults(status):
        said.append(f"given up so far: {_faults(status)}")
    return ok(stage.label, ", ".join([text, *said]))


def _nothing(stage: Stage, node: GraphNode, status: NodeStatus | None, seen: Observation) -> Check:
    """The node is up and content, and yet nothing comes."""
    values = status.values if status else {}
    if values.get("warm_up") == "running":
        text = f"{node.name} is still compiling its kernels, as after every installation"
        return fail(stage.label, text, "wait some minutes; look again with --seconds 300")
    if float(values.get("in groups [Hz]", 0)) > 0:
        text = f"{node.name} has taken pairs, but sent nothing in {seen.seconds:.1f} s: still busy with the first"
        return fail(stage.label, text, "look again with --seconds 60; choose a faster effort (navigation)")
    return fail(stage.label, f"{node.name} sends no {seen.topics[stage.output].name}", symptom=True)


def _sends(stage: Stage, seen: Observation) -> bool:
    names = (METRIC_CLOUD, UNSCALED_CLOUD) if stage.output == METRIC_CLOUD else (stage.output,)
    return any(seen.topics[name].arrivals.count for name in names if name in seen.topics)


def _absent(stage: Stage, seen: Observation) -> Check:
    text = f"no {stage.node} (nor {PIPELINE}), and nobody publishes {seen.topics[stage.output].name}"
    other = [name for name in seen.elsewhere if name.rsplit("/", 1)[-1] in (stage.node, PIPELINE)]
    if other:
        space = other[0].rsplit("/", 1)[0] or "/"
        return fail(stage.label, f"{text}; there is {', '.join(other)}", f"uw_recon doctor --namespace {space}")
    return fail(
        stage.label, text, f"ros2 run uw_recon_ros {stage.node}, or ros2 launch uw_recon_ros uw_recon.launch.py"
    )


def _stage(stage: Stage, seen: Observation) -> Iterator[Check]:
    node = seen.nodes.get(stage.node) or seen.nodes.get(PIPELINE)
    topic = seen.topics.get(stage.output, ObservedTopic(stage.output))
    if len(topic.publishers) > 1:
        names = ", ".join(end.node for end in topic.publishers)
        yield warn(stage.label, f"{topic.name} has {len(topic.publishers)} publishers ({names})", "stop all but one")
    if node is None:
        if not topic.publishers:
            yield _absent(stage, seen)
        elif topic.arrivals.count:
            yield _works(stage, topic, None)
        else:
            yield fail(stage.label, f"{topic.publishers[0].node} sends no {topic.name}", symptom=True)
        return
    yield from _of_node(stage, node, topic, seen)


def _of_node(stage: Stage, node: GraphNode, topic: ObservedTopic, seen: Observation) -> Iterator[Check]:
    alone = node.name.rsplit("/", 1)[-1] != PIPELINE  # whose complaints may be of any stage
    complaining = stage if alone else replace(stage, label="pipeline")
    hindrances = list(_hindrances(complaining, node))
    yield from hindrances
    if any(finding.level == Level.FAIL for finding in hindrances):
        return
    sends = _sends(stage, seen)
    status = _worst(node, content=sends)
    complaints = list(_status(complaining, node, status)) if status else []
    yield from complaints
    if sends:
        if topic.arrivals.count:
            yield _works(stage, topic, status)
    elif all(complaint.symptom for complaint in complaints):
        yield _nothing(complaining, node, status, seen)


def _hindrances(stage: Stage, node: GraphNode) -> Iterator[Check]:
    """What keeps a node from working at all, or from being told from another."""
    if node.copies > 1:
        yield warn(stage.label, f"{node.copies} nodes are called {node.name}", "stop all but one")
    if not node.answers and node.lifecycle is None and not node.statuses:
        yield fail(stage.label, f"{node.name} does not answer: it hangs, or has just ended", _LOOK)
    yield from _lifecycle(stage, node)


def replaced(seen: Observation) -> int:
    """How many stages, from the first, others than our nodes stand in for."""
    foreign = [
        place
        for place, stage in enumerate(STAGES, 1)
        if (ends := seen.topics.get(stage.output, ObservedTopic(stage.output)).publishers)
        and not any(end.node.rsplit("/", 1)[-1] in CHAIN for end in ends)
    ]
    return max(foreign, default=0)


def check_stages(seen: Observation) -> list[Check]:
    """Look at every stage that counts, in order; what pipeline_node says is said once."""
    found: list[Check] = []
    said: set[str] = set()
    for stage in STAGES[max(replaced(seen) - 1, 0) :]:
        for finding in _stage(stage, seen):
            if finding.text not in said:
                said.add(finding.text)
                found.append(finding)
    return found


def check_further(seen: Observation) -> list[Check]:
    """Look at the nodes that go on from disparity, where they run: what they lack keeps no clouds from coming."""
    found = [
        finding
        for stage in FURTHER
        if (node := seen.nodes.get(stage.node)) is not None
        for finding in _of_node(stage, node, seen.topics.get(stage.output, ObservedTopic(stage.output)), seen)
    ]
    return [replace(f, level=min(f.level, Level.WARN), symptom=True) for f in found]
