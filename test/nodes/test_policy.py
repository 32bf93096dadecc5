"""The SROS2 policy says what the nodes do, no more and no less: compared with the graph that real nodes make."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from pathlib import Path
from typing import Any

import pytest
from helpers.ros_bench import Bench

from uw_recon_ros.bags import open_bag
from uw_recon_ros.nodes import (
    calibrate_node,
    disparity_node,
    model_node,
    odometry_node,
    pipeline_node,
    point_cloud_node,
    preprocess_node,
    rectify_node,
)
from uw_recon_ros.nodes.bag_player_node import BagPlayerNode
from uw_recon_ros.nodes.replay import parse
from uw_recon_ros.ros import rectified_frame, transforms

ROOT = Path(__file__).parent.parent.parent
TOOL = ROOT / "tools" / "write_policy.py"
ALLOWED = {"topics": ("publish", "subscribe"), "services": ("reply", "request"), "actions": ("call", "execute")}
STAGES: dict[str, tuple[Any, Any, Any]] = {
    "preprocess_node": (preprocess_node.PreprocessNode, preprocess_node.CAMERAS, preprocess_node.OUTPUTS),
    "rectify_node": (rectify_node.RectifyNode, rectify_node.INPUTS, rectify_node.OUTPUTS),
    "disparity_node": (disparity_node.DisparityNode, disparity_node.INPUTS, disparity_node.OUTPUTS),
    "point_cloud_node": (point_cloud_node.PointCloudNode, point_cloud_node.INPUTS, point_cloud_node.OUTPUTS),
    "pipeline_node": (pipeline_node.PipelineNode, pipeline_node.INPUTS, pipeline_node.OUTPUTS),
    "model_node": (model_node.ModelNode, model_node.INPUTS, model_node.OUTPUTS),
    "odometry_node": (odometry_node.OdometryNode, odometry_node.INPUTS, odometry_node.OUTPUTS),
    "calibrate_node": (calibrate_node.CalibrateNode, calibrate_node.CAMERAS, calibrate_node.OUTPUTS),
}


def policy() -> ElementTree.Element:
    return ElementTree.parse(ROOT / "config" / "security" / "policy.xml").getroot()


def allowed(node: str, kind: str, qualifier: str) -> set[str]:
    """Full names."""
    (profile,) = (p for p in policy().iter("profile") if p.get("node") == node)
    names = {n.text or "" for rules in profile.findall(kind) if rules.get(qualifier) == "ALLOW" for n in rules}
    assert profile.get("ns") == "/"
    return {name if name.startswith("/") else f"/{name}".replace("/~", f"/{node}") for name in names}


def test_the_file_follows_from_the_code() -> None:
    assert subprocess.run([sys.executable, str(TOOL), "--check"], check=False).returncode == 0, "make docs"


def test_it_is_of_the_form_that_sros2_reads() -> None:
    """The rules of sros2's policy.xsd, version 0.2.0: elements, their order, attributes and values."""
    root = policy()
    assert (root.tag, root.get("version"), [child.tag for child in root]) == ("policy", "0.2.0", ["enclaves"])
    enclaves = list(root[0])
    assert len(enclaves) == len({enclave.get("path") for enclave in enclaves}) > 0
    for enclave in enclaves:
        assert enclave.tag == "enclave"
        assert enclave.attrib.keys() == {"path"}
        assert (enclave.get("path") or "").startswith("/")
        assert [child.tag for child in enclave] == ["profiles"]
        for profile in enclave[0]:
            assert profile.tag == "profile"
            assert profile.attrib.keys() == {"ns", "node"}
            for rules in profile:
                assert set(rules.attrib) <= set(ALLOWED[rules.tag])
                assert set(rules.attrib.values()) <= {"ALLOW", "DENY"}
                assert {each.tag for each in rules} == {rules.tag[:-1]}
                assert all(each.text and not each.text.isspace() and "*" not in each.text for each in rules)


def seen(bench: Bench, node: Any) -> dict[str, set[str]]:
    """Names that the graph gives a node."""
    asked = node.get_name(), node.get_namespace()
    outsider = bench.outsider
    return {
        "publish": {name for name, _ in outsider.get_publisher_names_and_types_by_node(*asked)},
        "subscribe": {name for name, _ in outsider.get_subscriber_names_and_types_by_node(*asked)},
        "reply": {name for name, _ in outsider.get_service_names_and_types_by_node(*asked)},
        "request": {name for name, _ in outsider.get_client_names_and_types_by_node(*asked)},
    }


@pytest.mark.parametrize("name", STAGES)
def test_a_stage_does_what_it_may_and_nothing_else(bench: Bench, name: str) -> None:
    """Every source of every input in turn, with simulated time."""
    make, inputs, outputs = STAGES[name]
    for output in outputs:
        bench.listen(output.type, output.topic)
    node = bench.start(make, use_sim_time=True)
    may_subscribe = allowed(name, "topics", "subscribe")
    absent = {f"/{topic.name}" for wanted in inputs for topic in wanted.alternatives if topic.type is None}
    may_subscribe -= absent  # their message packages are not installed
    subscribed: set[str] = set()
    served = [[topic for topic in wanted.alternatives if topic.type is not None] for wanted in inputs]
    for rank in range(max(map(len, served))):
        chosen = [topics[min(rank, len(topics) - 1)] for topics in served]
        talkers = [bench.talk(topic.type, topic.name) for topic in chosen]
        topics = {f"/{topic.name}" for topic in chosen}
        bench.spin_until(lambda t=topics: t <= seen(bench, node)["subscribe"], f"subscriptions to {topics}")
        subscribed |= seen(bench, node)["subscribe"]
        for talker in talkers:
            bench.outsider.destroy_publisher(talker)
    assert subscribed == may_subscribe
    found = seen(bench, node)
    without = {rectified_frame.TOPIC, transforms.TOPIC} - found["publish"]  # tf2_msgs is not installed
    assert found["publish"] == allowed(name, "topics", "publish") - without
    assert found["reply"] >= {f"/{name}/change_state"}
    # Humble has no get_type_description
    assert found["reply"] | {f"/{name}/get_type_description"} == allowed(name, "services", "reply")
    assert found["request"] == set()
    assert node.stop(300.0)  # the matcher may still be compiling


def test_the_player_does_what_it_may(bench: Bench) -> None:
    path = ROOT / "bags" / "amphora"
    with open_bag(path) as bag:
        chosen = ["/left/image_raw", "/right/image_raw", "/left/camera_info", "/right/camera_info"]
        settings = parse([str(path), "--start-paused", "--topics", *chosen], "")
        player = BagPlayerNode(bag, settings, context=bench.context)
        try:
            bench.spin_until(lambda: seen(bench, player)["publish"] >= set(chosen), "publishers")
            found = seen(bench, player)
        finally:
            player.close()
    assert found["publish"] <= allowed("bag_player_node", "topics", "publish")
    assert found["subscribe"] <= allowed("bag_player_node", "topics", "subscribe")
    assert found["reply"] | {"/bag_player_node/get_type_description"} == allowed("bag_player_node", "services", "reply")


def test_nodes_in_a_name_space_have_a_policy_of_their_own(tmp_path: Path) -> None:
    own = tmp_path / "policy.xml"
    subprocess.run([sys.executable, str(TOOL), "--namespace", "/rov", "--output", str(own)], check=True)
    root = ElementTree.parse(own).getroot()
    assert {profile.get("ns") for profile in root.iter("profile")} == {"/rov"}


def why_no_security() -> str:
    """Why DDS Security cannot be tried here; empty where it can.

    A Fast DDS with security reads the property that names the authentication plugin; SROS2's tools make the keys.
    """
    reasons = []
    folders = [Path(folder) for folder in os.environ.get("LD_LIBRARY_PATH", "").split(":") if folder]
    libraries = {library.resolve() for folder in folders for library in folder.glob("libfast*.so*")}
    if not any(b"dds.sec.auth.plugin" in library.read_bytes() for library in libraries):
        reasons.append("this Fast DDS is built without DDS Security")
    if shutil.which("ros2") is None or importlib.util.find_spec("sros2") is None:
        reasons.append("sros2's tools (ros2 security) are not installed")
    return "; ".join(reasons)


STRANGER = """
import sys, time
import rclpy
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import Image
rclpy.init(args=sys.argv, signal_handler_options=SignalHandlerOptions.NO)
node = rclpy.create_node("stranger")
publisher = node.create_publisher(Image, "left/image_raw", 5)
node.create_subscription(Image, "left/image_enhanced", lambda m: None, 5)
end = time.monotonic() + 8
met = False
while time.monotonic() < end and not met:
    rclpy.spin_once(node, timeout_sec=0.1)
    met = publisher.get_subscription_count() > 0
print("met" if met else "alone")
"""


@pytest.mark.skipif(bool(why_no_security()), reason=why_no_security() or "there is security")
def test_a_stranger_outside_of_the_enclaves_meets_nobody(tmp_path: Path) -> None:
    """With keys and Enforce a node without an enclave is not found; one in an enclave that allows it is."""
    store, policy_file = str(tmp_path / "keys"), str(ROOT / "config" / "security" / "policy.xml")
    subprocess.run(["ros2", "security", "create_keystore", store], check=True)
    for name in ("preprocess_node", "bag_player_node"):
        subprocess.run(["ros2", "security", "create_enclave", store, f"/uw_recon/{name}"], check=True)
        subprocess.run(["ros2", "security", "create_permission", store, f"/uw_recon/{name}", policy_file], check=True)
    secure = {
        **os.environ,
        "ROS_SECURITY_ENABLE": "true",
        "ROS_SECURITY_STRATEGY": "Enforce",
        "ROS_SECURITY_KEYSTORE": store,
    }
    node = subprocess.Popen(
        [sys.executable, "-m", "uw_recon_ros.nodes.preprocess_node", "--ros-args", "--enclave",
         "/uw_recon/preprocess_node"], env=secure, start_new_session=True,
    )  # fmt: skip
    try:
        insecure = subprocess.run([sys.executable, "-c", STRANGER], capture_output=True, text=True, check=True)
        assert insecure.stdout.strip() == "alone"
        player = subprocess.run(
            [sys.executable, "-m", "uw_recon_ros.nodes.bag_player_node", str(ROOT / "bags" / "amphora"),
             "--wait-for", "/left/image_raw", "--ros-args", "--enclave", "/uw_recon/bag_player_node"],
            env=secure, timeout=60, check=False,
        )  # fmt: skip
        assert player.returncode == 0
    finally:
        node.terminate()
        node.wait(10)
