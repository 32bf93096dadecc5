"""The doctor on real graphs, one fault each: what it names must be that fault."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
import rclpy
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from helpers.ros_bench import Bench, banded_pair, color, infos, stamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.context import Context
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2

from uw_recon_ros.doctor.diagnose import Diagnosis, diagnose
from uw_recon_ros.doctor.text import as_table
from uw_recon_ros.doctor.topic_graph import LISTENED, PIPELINE, STAGES, TYPES
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
from uw_recon_ros.nodes.pipeline_node import PipelineNode
from uw_recon_ros.nodes.preprocess_node import PreprocessNode
from uw_recon_ros.nodes.rectify_node import RectifyNode
from uw_recon_ros.ros.observer.observe import surroundings
from uw_recon_ros.ros.observer.probe import Probe

PERIOD_S = 0.1
FAST = {"min_disparity": 0, "max_disparity": 24, "effort": "navigation"}
pytestmark = pytest.mark.timeout(3600)


@dataclass
class Rig:
    """Two cameras that publish a pair every `PERIOD_S`; fields may be changed."""

    node: Node
    namespace: str = ""
    exchanged: bool = False
    calibrated: bool = True
    zero_k: bool = False
    apart_ms: float = 0.0
    reliable: bool = True

    def start(self) -> Rig:
        policy = ReliabilityPolicy.RELIABLE if self.reliable else ReliabilityPolicy.BEST_EFFORT
        qos = QoSProfile(depth=10, reliability=policy)
        make = self.node.create_publisher
        self._images = [make(Image, f"{self.namespace}{side}/image_raw", qos) for side in ("left", "right")]
        self._infos = [
            make(CameraInfo, f"{self.namespace}{side}/camera_info", qos) if self.calibrated else None
            for side in ("left", "right")
        ]
        self._views = banded_pair()[:: -1 if self.exchanged else 1]
        self.node.create_timer(PERIOD_S, self._publish)
        return self

    def _publish(self) -> None:
        stamp = time.time_ns()
        for place, (publisher, info, numbers) in enumerate(zip(self._images, self._infos, infos(0), strict=True)):
            own = stamp + round(place * self.apart_ms * 1e6)
            publisher.publish(color(self._views[place], own))
            if info is not None:
                if self.zero_k:
                    numbers.k = np.zeros(9)
                info.publish(stamped(numbers, own))


@pytest.fixture
def rig(bench: Bench) -> Rig:
    return Rig(bench.outsider)


@pytest.fixture
def examine(bench: Bench) -> Iterator[Callable[..., Diagnosis]]:
    """Let the doctor look, for so long at most or until something is as expected."""
    probes: list[Probe] = []

    def look(words: str = "", namespace: str = "", seconds: float = 120.0, table: str = "") -> Diagnosis:
        probe = Probe(surroundings(), namespace=namespace, context=bench.context)
        probes.append(probe)
        bench.executor.add_node(probe)

        def named() -> bool:
            diagnosis = diagnose(probe.observation()) if probe.seconds > 2 else None
            found = diagnosis and diagnosis.cause
            return bool(diagnosis and found and words in found.text and table in as_table(diagnosis))

        if words:
            bench.spin_until(lambda: named() or probe.seconds > seconds)
        else:
            bench.spin_until(lambda: probe.satisfied or probe.seconds > seconds)
        return diagnose(probe.observation())

    yield look
    for probe in probes:
        bench.executor.remove_node(probe)
        probe.destroy_node()


def cause(diagnosis: Diagnosis) -> str:
    assert diagnosis.cause is not None, as_table(diagnosis)
    return f"{diagnosis.cause.text} -> {diagnosis.cause.advice}"


def test_the_chain_is_the_nodes() -> None:
    """Names and types that the doctor knows by heart are those of the nodes."""
    modules = (preprocess_node, rectify_node, disparity_node, point_cloud_node)
    declared: dict[str, Any] = {}
    for stage, module in zip(STAGES, modules, strict=True):
        assert module.__name__.endswith(stage.node)
        outputs = {output.topic: output.type for output in module.OUTPUTS}
        assert stage.output in outputs
        declared |= outputs
    for wanted in pipeline_node.INPUTS:
        declared |= {topic.name: topic.type for topic in wanted.alternatives}
    for module in (odometry_node, model_node, calibrate_node):
        declared |= {output.topic: output.type for output in module.OUTPUTS}
    for topic, kind in TYPES.items():
        package, _, name = kind.split("/")
        if topic in declared and declared[topic] is None:
            continue  # a type of video that is not installed
        assert declared[topic].__name__ == name
        assert declared[topic].__module__.startswith(f"{package}.msg.")
    assert set(LISTENED) <= set(TYPES)
    assert pipeline_node.__name__.endswith(PIPELINE)


def test_a_healthy_graph(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.start()
    bench.start(PipelineNode, **FAST)
    bench.listen(PointCloud2, "points2")
    diagnosis = examine()
    assert diagnosis.healthy, as_table(diagnosis)
    table = as_table(diagnosis)
    assert "stamps pair up" in table
    assert "horizontal rig, baseline 0.100 m, 160x120" in table
    assert "/outsider listen to the clouds" in table
    assert all(stage.label in table for stage in STAGES)


def test_no_cameras_but_others_of_that_kind(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.namespace = "/stereo/"
    rig.start()
    bench.start(PipelineNode, **FAST)
    line = cause(examine("no publisher"))
    assert "/left/image_raw: no publisher, but /stereo/left/image_raw has one" in line
    assert "namespace:=/stereo" in line


def test_remaps_of_the_nodes_are_found(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.namespace = "/stereo/"
    rig.start()
    remap = {
        f"{side}/{kind}": f"/stereo/{side}/{kind}"
        for side in ("left", "right")
        for kind in ("image_raw", "camera_info")
    }
    bench.start(PipelineNode, remap=remap, **FAST)
    diagnosis = examine()
    assert diagnosis.healthy, as_table(diagnosis)
    assert "/stereo/left/image_raw" in as_table(diagnosis)


def test_another_type(bench: Bench, examine: Any) -> None:
    context = Context()  # Fast DDS refuses two types on one topic within a participant
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    driver = Node("driver", context=context)
    for side in ("left", "right"):
        driver.create_publisher(CompressedImage, f"{side}/image_raw", 1)
    try:
        bench.start(PreprocessNode)
        line = cause(examine("expects"))
    finally:
        driver.destroy_node()
        rclpy.try_shutdown(context=context)
    assert "/driver publishes sensor_msgs/msg/CompressedImage, /preprocess_node expects sensor_msgs/msg/Image" in line


def test_best_effort_against_an_override_that_demands_reliable(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.reliable = False
    rig.start()
    override = {f"qos_overrides./{side}/image_raw.subscription.reliability": "reliable" for side in ("left", "right")}
    bench.start(PipelineNode, **FAST, **override)
    line = cause(examine("best effort"))
    assert "/outsider offers best effort only, /pipeline_node demands reliable" in line
    assert "qos_overrides" in line


DRIVER = """
import array, rclpy
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Image
rclpy.init()
driver = rclpy.create_node("driver")
image = Image(height=600, width=800, encoding="bgr8", step=2400, data=array.array("B", bytes(1440000)))
cameras = [driver.create_publisher(Image, f"{side}/image_raw", qos_profile_sensor_data) for side in ("left", "right")]
def publish():
    image.header.stamp = driver.get_clock().now().to_msg()
    for camera in cameras:
        camera.publish(image)
driver.create_timer(0.1, publish)
try:
    rclpy.spin(driver)
except (KeyboardInterrupt, rclpy.executors.ExternalShutdownException):
    pass
"""


def test_large_images_that_best_effort_loses(bench: Bench, examine: Any) -> None:
    """A driver as most are: sensor-data QoS, Fast DDS as it comes. None arrive, or few: named in either case."""
    plain = {name: value for name, value in os.environ.items() if "PROFILES_FILE" not in name}
    driver = subprocess.Popen([sys.executable, "-c", DRIVER], env=plain, start_new_session=True)
    try:
        bench.start(PreprocessNode)
        bench.spin_until(lambda: bench.outsider.count_publishers("right/image_raw"), "the driver")
        diagnosis = examine(seconds=3.0)
    finally:
        driver.send_signal(signal.SIGINT)
        driver.wait(30)
    for side in ("left", "right"):
        (finding,) = [f for f in diagnosis.findings if f"/{side}/image_raw" in f.text and "best effort" in f.text]
        assert "lost" in finding.text
        assert "publish reliable" in finding.advice


def test_stamps_apart(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.apart_ms = 20.0
    rig.start()
    bench.start(PipelineNode, **FAST)
    line = cause(examine("apart"))
    assert "left and right 20.0 ms (median), pair_tolerance_ms is 1" in line


def test_the_tolerance_is_the_nodes_own(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.apart_ms = 20.0
    rig.start()
    bench.start(PipelineNode, **FAST, pair_tolerance_ms=25.0)
    diagnosis = examine()
    assert diagnosis.healthy, as_table(diagnosis)
    assert "stamps pair up: 20 ms apart (pair_tolerance_ms 25)" in as_table(diagnosis)


def test_a_paused_replay(bench: Bench, examine: Any) -> None:
    for side in ("left", "right"):
        bench.talk(Image, f"{side}/image_raw")
    clock = bench.outsider.create_publisher(Clock, "/clock", 1)
    bench.outsider.create_timer(0.05, lambda: clock.publish(Clock(clock=Time(sec=7))))
    bench.start(PreprocessNode)
    line = cause(examine("stands still"))
    assert "but no message in" in line
    assert "resume the bag or simulation: it is paused" in line


def test_a_calibration_of_noughts(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.zero_k = True
    rig.start()
    bench.start(PipelineNode, **FAST, given_limit_px=5.0)
    diagnosis = examine("K is zero", table="/points_unscaled comes instead")
    assert "/left/camera_info and /right/camera_info: K is zero (not calibrated)" in cause(diagnosis)
    assert "/points_unscaled comes instead" in as_table(diagnosis)


def test_exchanged_cameras(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.exchanged = True
    rig.start()
    bench.start(PreprocessNode)
    bench.start(RectifyNode)
    line = cause(examine("refuses"))
    assert "/rectify_node refuses every frame: left and right images are swapped" in line
    assert "swap the topics" in line


def test_an_inactive_node(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.start()
    bench.start(PreprocessNode)
    bench.start(RectifyNode, autostart=False)
    client = bench.outsider.create_client(ChangeState, "rectify_node/change_state")
    bench.spin_until(client.service_is_ready, "the managed node")
    line = cause(examine("unconfigured"))
    assert "/rectify_node is unconfigured: a managed node works only when active -> ros2 lifecycle set /rect" in line
    answer = client.call_async(ChangeState.Request(transition=Transition(id=Transition.TRANSITION_CONFIGURE)))
    bench.spin_until(answer.done)
    line = cause(examine("inactive"))
    assert "-> ros2 lifecycle set /rectify_node activate" in line


def test_a_node_that_is_missing(bench: Bench, rig: Rig, examine: Any) -> None:
    rig.start()
    bench.start(PreprocessNode)
    bench.start(RectifyNode)
    assert "no disparity_node (nor pipeline_node)" in cause(examine("disparity_node"))


def doctor(bench: Bench, *arguments: str, **environment: str) -> subprocess.CompletedProcess[str]:
    """The command line in a process of its own, while the bench's nodes work."""
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        process = subprocess.Popen(
            [sys.executable, "-m", "uw_recon_ros.cli", "doctor", *arguments],
            stdout=out, stderr=err, env={**os.environ, **environment}, start_new_session=True,
        )  # fmt: skip
        try:
            bench.spin_until(lambda: process.poll() is not None, "the doctor")
        finally:
            process.kill()
        out.seek(0)
        err.seek(0)
        return subprocess.CompletedProcess(process.args, process.wait(), out.read(), err.read())


def test_the_command_finds_the_name_space_and_says_it_in_json(bench: Bench, rig: Rig) -> None:
    rig.namespace = "/rov/"
    rig.start()
    bench.start(lambda **options: PipelineNode(namespace="/rov", **options), **FAST)
    bench.listen(DiagnosticArray, "/diagnostics")
    told = doctor(bench, "--json", "--seconds", "20")
    said = json.loads(told.stdout)
    assert told.returncode == 0, told.stdout + told.stderr
    assert said["namespace"] == "/rov"
    assert said["healthy"] is True
    assert said["cause"] is None


def test_the_command_alone_in_its_domain(bench: Bench) -> None:
    other = str(1 + int(os.environ["ROS_DOMAIN_ID"]) % 101)
    told = doctor(bench, "--seconds", "0.5", ROS_DOMAIN_ID=other)
    assert told.returncode == 1
    assert told.stdout.splitlines()[-1].startswith("most likely cause: no other node is seen (ROS_DOMAIN_ID")
    assert re.search(rf"at work in domain .*\b{os.environ['ROS_DOMAIN_ID']}\b", told.stdout)
    assert told.stderr == ""


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seconds", "0"], "--seconds: expected more than 0"),
        (["--namespace", "no spaces"], "namespace"),
        (["--ros-args", "-r", "nonsense"], "nonsense"),
    ],
)
def test_wrong_usage(bench: Bench, arguments: list[str], words: str) -> None:
    told = doctor(bench, *arguments)
    assert told.returncode == 2
    (line,) = told.stderr.strip().splitlines()
    assert words in line
