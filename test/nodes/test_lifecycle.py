"""Managed nodes: transitions over their services, and what each promises."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from helpers.lifecycle_manager import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, SHUTDOWN, WAY_TO, Manager
from helpers.ros_bench import LIMIT_S, Bench, array, color, texture
from lifecycle_msgs.msg import Transition, TransitionEvent
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions
from rclpy.parameter import Parameter
from sensor_msgs.msg import Image

from uw_recon_ros.nodes.preprocess_node import CAMERAS, OUTPUTS, PreprocessNode
from uw_recon_ros.nodes.rectify_node import RectifyNode
from uw_recon_ros.params import Params, param
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.ros.diagnostics import DEACTIVATED, SUPERSEDED
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.parameters import ParameterError, ParameterSet
from uw_recon_ros.types import StereoPair

SECOND = 1_000_000_000
LEFT, RIGHT = texture(48, 64, 1), texture(48, 64, 2)


def manage(bench: Bench, name: str) -> Manager:
    return Manager(bench.outsider, name, bench.spin_until)


class Cameras:
    """Two cameras publishing to the node under test."""

    def __init__(self, bench: Bench) -> None:
        self._bench = bench
        self.sides = [bench.talk(Image, f"{side}/image_raw") for side in ("left", "right")]

    def connect(self) -> None:
        self._bench.connected(*self.sides)

    def disconnected(self) -> bool:
        return not any(side.get_subscription_count() for side in self.sides)

    def send(self, stamp_ns: int) -> None:
        for side, image in zip(self.sides, (LEFT, RIGHT), strict=True):
            side.publish(color(image, stamp_ns))


@dataclass(frozen=True)
class GateParams(Params):
    gate_width: int = param(1, "Refused by the stage above a hundred.", low=0)


class GateNode(StageNode[int]):
    """A stage node whose work and warm-up wait for the test: what a slow stage does, without its haste."""

    def __init__(self, **options: Any) -> None:
        self.begun, self.go_on, self.warm, self.fail = [threading.Event() for _ in range(4)]
        self.warm.set()
        super().__init__("gate_node", classes=(GateParams,), inputs=CAMERAS, outputs=OUTPUTS, **options)

    def build(self, params: ParameterSet) -> int:
        width = params[GateParams].gate_width
        if width > 100:
            raise ValueError(f"gate_width: expected at most 100, got {width}")
        return width

    def configure(self) -> None:
        super().configure()
        if self.fail.is_set():
            raise OSError("no such gate")

    def warm_up(self, stage: int) -> None:
        self.warm.wait(30)

    def work(self, stage: int, group: Group, outputs: Outputs) -> int:
        def message() -> Image:
            self.begun.set()
            assert self.go_on.wait(30)
            return group["left"]

        outputs.send("left/image_enhanced", message)
        return int(group["left"].header.stamp.sec) * SECOND


@pytest.fixture
def gate(bench: Bench) -> Iterator[GateNode]:
    node = bench.start(GateNode)
    yield node
    node.warm.set()
    node.go_on.set()


def publishers(bench: Bench, topic: str) -> int:
    return len(bench.outsider.get_publishers_info_by_topic(topic))


def test_each_transition_and_what_it_brings(bench: Bench) -> None:
    node = bench.start(PreprocessNode, autostart=False)
    manager, cameras = manage(bench, "preprocess_node"), Cameras(bench)
    heard = bench.listen(Image, "left/image_enhanced")
    told = bench.listen(DiagnosticArray, "/diagnostics")
    events = bench.listen(TransitionEvent, "/preprocess_node/transition_event")

    def says(state: str) -> bool:
        return bool(told) and told[-1].status[0].values[0].value == state

    assert manager.state == "unconfigured"
    bench.spin_until(lambda: says("unconfigured"))
    assert told[-1].status[0].message == "unconfigured"
    assert publishers(bench, "/left/image_enhanced") == 0
    assert manager.change(CONFIGURE)
    bench.spin_until(lambda: says("inactive") and publishers(bench, "/left/image_enhanced"))
    bench.spin_for(0.6)
    assert cameras.disconnected()
    assert manager.change(ACTIVATE)
    cameras.connect()
    cameras.send(SECOND)
    bench.spin_until(lambda: heard and says("active"))
    assert manager.change(DEACTIVATE)
    bench.spin_until(cameras.disconnected)
    assert manager.state == "inactive"
    assert manager.change(CLEANUP)
    bench.spin_until(lambda: publishers(bench, "/left/image_enhanced") == 0)
    assert (manager.state, node.stage) == ("unconfigured", None)
    assert manager.change(SHUTDOWN["unconfigured"])
    assert manager.state == "finalized"
    bench.spin_until(lambda: says("finalized"))
    assert events


def test_by_default_a_node_starts_itself(bench: Bench) -> None:
    bench.start(PreprocessNode)
    manager = manage(bench, "preprocess_node")
    assert manager.state == "active"
    ways = manager.call(GetAvailableTransitions.Request(), GetAvailableTransitions).available_transitions
    assert {way.transition.label for way in ways} == {"deactivate", "shutdown"}


@pytest.mark.parametrize(
    ("state", "wrong"),
    [
        ("unconfigured", (ACTIVATE, DEACTIVATE, CLEANUP, 99)),
        ("inactive", (CONFIGURE, DEACTIVATE, SHUTDOWN["active"])),
        ("active", (CONFIGURE, ACTIVATE, CLEANUP)),
    ],
)
def test_a_wrong_order_is_refused_and_harms_nothing(bench: Bench, state: str, wrong: tuple[int, ...]) -> None:
    bench.start(PreprocessNode, autostart=False)
    manager = manage(bench, "preprocess_node")
    assert manager.change(*WAY_TO[state])
    assert [manager.change(each) for each in wrong] == [False] * len(wrong)
    label = ChangeState.Request(transition=Transition(label="no_such_way"))
    assert not manager.call(label, ChangeState).success
    assert manager.state == state


@pytest.mark.parametrize("state", sorted(WAY_TO))
def test_shutdown_from_every_state(bench: Bench, state: str) -> None:
    bench.start(PreprocessNode, autostart=False)
    manager, cameras = manage(bench, "preprocess_node"), Cameras(bench)
    bench.listen(Image, "left/image_enhanced")
    assert manager.change(*WAY_TO[state])
    if state == "active":
        cameras.connect()
    assert manager.change(SHUTDOWN[state])
    assert manager.state == "finalized"
    bench.spin_until(lambda: cameras.disconnected() and not publishers(bench, "/left/image_enhanced"))
    assert not manager.change(CONFIGURE)
    assert manager.set(stall_warning_s=3.0).successful


def test_work_resumes_after_a_pause(bench: Bench) -> None:
    bench.start(PreprocessNode)
    manager, cameras = manage(bench, "preprocess_node"), Cameras(bench)
    heard = bench.listen(Image, "left/image_enhanced")
    for round_ in (1, 2, 3):
        cameras.connect()
        cameras.send(round_ * SECOND)
        bench.spin_until(lambda n=round_: len(heard) == n)
        assert manager.change(DEACTIVATE)
        bench.spin_until(cameras.disconnected)
        cameras.send(round_ * SECOND + 1)
        assert manager.change(ACTIVATE)
    assert [message.header.stamp.sec for message in heard] == [1, 2, 3]


def test_what_is_under_way_is_not_sent_after_deactivation(bench: Bench, gate: GateNode) -> None:
    """Not even when the node is active again by the time it is finished; what waited behind it is dropped."""
    manager, cameras = manage(bench, "gate_node"), Cameras(bench)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras.connect()
    cameras.send(SECOND)
    bench.spin_until(gate.begun.is_set)
    cameras.send(2 * SECOND)
    cameras.send(3 * SECOND)
    bench.spin_until(lambda: gate.diagnostics.drops.get(SUPERSEDED) == 1)
    assert manager.change(DEACTIVATE)
    assert manager.change(ACTIVATE)
    cameras.connect()
    gate.go_on.set()
    bench.spin_until(lambda: gate.diagnostics.drops.get(DEACTIVATED) == 2)
    assert heard == []
    cameras.send(4 * SECOND)
    bench.spin_until(lambda: heard)
    assert [message.header.stamp.sec for message in heard] == [4]


def test_nothing_blocks_while_the_thread_works(bench: Bench, gate: GateNode) -> None:
    """Parameters and transitions are answered while a frame is worked on; a cleaned-up node can be configured anew."""
    manager, cameras = manage(bench, "gate_node"), Cameras(bench)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras.connect()
    cameras.send(SECOND)
    bench.spin_until(gate.begun.is_set)
    assert manager.set(gate_width=7).successful
    assert gate.stage == 7
    assert manager.set(gate_width=101).reason == "gate_width: expected at most 100, got 101"
    assert manager.change(DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE)
    assert not gate.go_on.is_set()
    cameras.connect()
    gate.go_on.set()
    cameras.send(2 * SECOND)
    bench.spin_until(lambda: heard)
    bench.spin_for(0.2)
    assert [message.header.stamp.sec for message in heard] == [2]


def test_nothing_blocks_while_the_thread_compiles(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.start(GateNode, autostart=False)
    node.warm.clear()
    manager, cameras = manage(bench, "gate_node"), Cameras(bench)
    told = bench.listen(DiagnosticArray, "/diagnostics")
    heard = bench.listen(Image, "left/image_enhanced")
    assert manager.change(CONFIGURE, ACTIVATE)
    cameras.connect()
    node.go_on.set()
    cameras.send(SECOND)
    logged = ""

    def log() -> str:
        nonlocal logged
        logged += capfd.readouterr().err
        return logged

    bench.spin_until(lambda: "first start: compiling kernels" in log())
    bench.spin_until(lambda: told[-1].status[0].message == "warming up: compiling")
    assert {"warm_up": "running"}.items() <= {v.key: v.value for v in told[-1].status[0].values}.items()
    assert manager.set(gate_width=7).successful
    assert heard == []
    node.warm.set()
    bench.spin_until(lambda: heard and "compiled in" in log())
    bench.spin_until(lambda: {"done"} <= {v.value for v in told[-1].status[0].values if v.key == "warm_up"})


def test_parameters_in_every_state(bench: Bench) -> None:
    bench.start(PreprocessNode, autostart=False)
    manager, cameras = manage(bench, "preprocess_node"), Cameras(bench)
    heard = bench.listen(Image, "left/image_enhanced")
    iterations = 0
    for way in ((), (CONFIGURE,), (ACTIVATE,), (DEACTIVATE,), (CLEANUP,), (CONFIGURE, ACTIVATE)):
        assert manager.change(*way)
        iterations += 1
        refused = manager.set(diffusion_iterations=-1)
        assert "diffusion_iterations" in refused.reason
        assert manager.set(diffusion_iterations=iterations).successful
    cameras.connect()
    cameras.send(SECOND)
    bench.spin_until(lambda: heard)
    expected = Preprocess(PreprocessParams(diffusion_iterations=iterations))(StereoPair(LEFT, RIGHT)).left
    np.testing.assert_array_equal(array(heard[0]), expected)


def test_what_the_stage_alone_refuses_is_refused_unconfigured_too(bench: Bench) -> None:
    bench.start(GateNode, autostart=False)
    result = manage(bench, "gate_node").set(gate_width=101)
    assert (result.successful, result.reason) == (False, "gate_width: expected at most 100, got 101")
    with pytest.raises(ParameterError, match="gate_width: expected at most 100, got 102"):
        GateNode(context=bench.context, parameter_overrides=[Parameter("gate_width", value=102)])


def test_cleaning_up_forgets_the_rig(bench: Bench) -> None:
    node = bench.start(RectifyNode)
    manager, before = manage(bench, "rectify_node"), node.stage
    assert manager.change(DEACTIVATE, ACTIVATE)
    assert node.stage is before
    assert manager.change(DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE)
    assert node.stage.rig is not before.rig


def test_an_error_in_a_transition(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    """The reason is told, what was made is freed, and the node may be configured again."""
    node = bench.start(GateNode, autostart=False)
    node.fail.set()
    manager = manage(bench, "gate_node")
    told = bench.listen(DiagnosticArray, "/diagnostics")
    assert not manager.change(CONFIGURE)
    assert manager.state == "unconfigured"
    assert node.stage is None
    assert "configure failed: no such gate" in capfd.readouterr().err
    bench.spin_until(lambda: told and told[-1].status[0].level == DiagnosticStatus.ERROR)
    assert told[-1].status[0].message == "unconfigured: configure failed: no such gate"
    assert publishers(bench, "/left/image_enhanced") == 0
    node.fail.clear()
    assert manager.change(CONFIGURE, ACTIVATE)
    bench.spin_until(lambda: told[-1].status[0].level == DiagnosticStatus.OK)


def test_many_rounds_leave_nothing_behind(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    manager = manage(bench, "preprocess_node")

    def held() -> tuple[int, ...]:
        return tuple(len(list(each)) for each in (node.publishers, node.subscriptions, node.timers, node.waitables))

    bench.listen(Image, "left/image_enhanced")
    bench.spin_until(lambda: node.inputs.active)
    before, threads = held(), threading.active_count()
    for _ in range(10):
        assert manager.change(DEACTIVATE, CLEANUP, CONFIGURE, ACTIVATE)
    bench.spin_until(lambda: node.inputs.active and held() == before)
    bench.spin_until(lambda: threading.active_count() == threads)


def test_a_destroyed_node_is_gone_from_the_graph(bench: Bench) -> None:
    node = RectifyNode(context=bench.context)
    bench.spin_until(lambda: "rectify_node" in bench.outsider.get_node_names())
    assert node.stop(LIMIT_S)
    node.destroy_node()
    bench.spin_until(lambda: "rectify_node" not in bench.outsider.get_node_names(), "the node to leave")
