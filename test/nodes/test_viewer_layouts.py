"""RViz's and Foxglove's files: they parse, name our topics with the right displays, and leave nothing out."""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml
from diagnostic_msgs.msg import DiagnosticArray
from helpers.ros_bench import Bench, banded_pair, color, infos, stamped
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from uw_recon_ros.nodes import calibrate_node, model_node, odometry_node, pipeline_node
from uw_recon_ros.nodes.pipeline_node import PipelineNode
from uw_recon_ros.topics import find_topic

ROOT = Path(__file__).parents[2]
RVIZ, FOXGLOVE = ROOT / "config" / "rviz" / "uw_recon.rviz", ROOT / "config" / "foxglove" / "uw_recon.json"
OUTPUTS = (*pipeline_node.OUTPUTS, *odometry_node.OUTPUTS, *model_node.OUTPUTS, *calibrate_node.OUTPUTS)


def _message(topic: str) -> str:
    return find_topic(topic).type.rpartition("/")[2]


#: All topics by message, cameras included: absolute, as without a name space.
TYPES = {
    **{f"/{topic.name}": _message(topic.name) for wanted in pipeline_node.INPUTS for topic in wanted.alternatives},
    **{f"/{output.topic}": output.type.__name__ for output in OUTPUTS if output.topic not in ("/tf", "/tf_static")},
}
LATCHED = {f"/{output.topic}" for output in OUTPUTS if output.latched}
KINDS = ("Image", "PointCloud2", "Marker", "LaserScan", "Range", "Odometry", "Path")
SHOWS = {kind: kind for kind in KINDS}  # RViz's display of a message
NOT_IN_RVIZ = {"CameraInfo", "DisparityImage", "CompressedImage", "FFMPEGPacket", "CompressedVideo"}
NOT_IN_RVIZ |= {"DiagnosticArray"}  # words  # no display


def rviz_displays(node: Any) -> Iterator[dict[str, Any]]:
    for display in node["Displays"]:
        yield display
        if "Displays" in display:
            yield from rviz_displays(display)


def test_rviz_shows_every_topic_it_can_as_what_it_is() -> None:
    manager = yaml.safe_load(RVIZ.read_text())["Visualization Manager"]
    shown = {d["Topic"]["Value"]: d for d in rviz_displays(manager) if "Topic" in d}
    assert set(shown) == {topic for topic, kind in TYPES.items() if kind not in NOT_IN_RVIZ}
    for topic, display in shown.items():
        assert display["Class"] == f"rviz_default_plugins/{SHOWS[TYPES[topic]]}"
        assert display["Topic"]["Reliability Policy"] == "Reliable"
        durability = "Transient Local" if topic in LATCHED else "Volatile"
        assert display["Topic"]["Durability Policy"] == durability
        assert display["Enabled"] is display["Value"]
    names = [d["Name"] for d in rviz_displays(manager)]
    assert len(names) == len(set(names))
    assert "rviz_default_plugins/TF" in {d["Class"] for d in rviz_displays(manager)}


def foxglove() -> dict[str, Any]:
    layout: dict[str, Any] = json.loads(FOXGLOVE.read_text())
    return layout


def panels(node: Any) -> Iterator[str]:
    """Identities in a tree of splits, tabs included."""
    if isinstance(node, str):
        yield node
        for tab in foxglove()["configById"][node].get("tabs", []):
            yield from panels(tab["layout"])
    else:
        assert node["direction"] in ("row", "column")
        assert 0 < node["splitPercentage"] < 100
        yield from panels(node["first"])
        yield from panels(node["second"])


def test_foxglove_panels_are_all_laid_out_once() -> None:
    layout = foxglove()
    assert set(layout) == {"configById", "globalVariables", "userNodes", "playbackConfig", "layout"}
    placed = list(panels(layout["layout"]))
    assert len(placed) == len(set(placed))
    assert set(placed) == set(layout["configById"])
    known = {"3D", "Image", "Plot", "RawMessages", "DiagnosticSummary", "DiagnosticStatusPanel", "Tab"}
    assert {name.split("!")[0] for name in placed} <= known


def test_foxglove_shows_every_topic_as_what_it_is() -> None:
    configs = foxglove()["configById"]
    images = {c["imageMode"]["imageTopic"] for name, c in configs.items() if name.startswith("Image!")}
    assert images == {topic for topic, kind in TYPES.items() if kind == "Image"}
    for name, config in configs.items():
        if name.startswith("Image!") and "calibrationTopic" in config["imageMode"]:
            assert TYPES[config["imageMode"]["calibrationTopic"]] == "CameraInfo"
    space = configs["3D!clouds"]["topics"]
    assert set(space) == {
        topic for topic, kind in TYPES.items() if kind in ("PointCloud2", "Marker", "CameraInfo", "Path")
    }
    assert configs["RawMessages!disparity"]["topicPath"] == "/disparity"
    assert {c["topicToRender"] for name, c in configs.items() if name.startswith("Diagnostic")} == {"/diagnostics"}


PATH = re.compile(r'/diagnostics\.status\[:\]\{name=="/(\w+)"\}\.values\[:\]\{key=="([^"]+)"\}\.value')


def test_what_foxglove_plots_is_what_nodes_say(bench: Bench) -> None:
    """Every key is on the diagnostics of a node at work, and is a number."""
    configs = foxglove()["configById"]
    paths = [p["value"] for name, c in configs.items() if name.startswith("Plot!") for p in c["paths"]]
    wanted = {match[2] for match in map(PATH.fullmatch, paths) if match and match[1] == "pipeline_node"}
    assert all(map(PATH.fullmatch, paths))
    assert wanted >= {"done [Hz]", "latency [s]", "work [s]", "density"}
    said = _diagnostics(bench)
    assert all(float(said[key]) >= 0 for key in wanted)


def _diagnostics(bench: Bench) -> dict[str, str]:
    """What a pipeline says that works on pairs stamped now."""
    bench.start(PipelineNode, min_disparity=0, max_disparity=24, effort="navigation")
    heard = bench.listen(DiagnosticArray, "/diagnostics")
    bench.listen(PointCloud2, "points2")
    sides = [bench.talk(Image, f"{side}/image_raw") for side in ("left", "right")]
    numbers = [bench.talk(CameraInfo, f"{side}/camera_info") for side in ("left", "right")]
    views = banded_pair()

    def publish() -> None:
        stamp = time.time_ns()
        for side, number, view, info in zip(sides, numbers, views, infos(0), strict=True):
            number.publish(stamped(info, stamp))
            side.publish(color(view, stamp))

    timer = bench.outsider.create_timer(0.2, publish)
    said: dict[str, str] = {}

    def complete() -> bool:
        for message in heard:
            said.update({pair.key: pair.value for status in message.status for pair in status.values})
        return {"latency [s]", "density", "done [Hz]", "row_error_median_px"} <= said.keys()

    bench.spin_until(complete, "diagnostics of a pair")
    timer.cancel()
    return said
