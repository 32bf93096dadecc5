"""Parameters of a real node, declared from a `Params` class."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from helpers.ros_bench import Bench
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter

from uw_recon_ros.params import Params, param
from uw_recon_ros.ros.parameters import NodeParameters, ParameterError, ParameterSet, descriptor


@dataclass(frozen=True)
class Sieve(Params):
    mesh_mm: float = param(2.0, "Width of a hole.", unit="mm", low=0.5, high=10)
    shakes: int = param(3, "How often it is shaken.", low=1)
    shape: str = param("round", "Shape of a hole.", choices=("round", "square"))
    wet: bool = param(False, "Whether under water.")
    maker: str = param("unknown", "Who made it.", read_only=True)

    def check_together(self) -> None:
        if self.wet and self.mesh_mm < 1:
            raise ValueError(f"wet, mesh_mm: expected mesh_mm >= 1 under water, got {self.mesh_mm:g}")


@dataclass(frozen=True)
class Scale(Params):
    tare_g: float = param(0.0, "Weight of the bowl.", unit="g")


@dataclass(frozen=True)
class Neighbour(Params):
    neighbours_knob: float = param(0.0, "Of another node.")


class Host:
    """A node with the parameters, and what was put into force."""

    def __init__(self, bench: Bench, **overrides: Any) -> None:
        self.node = Node(
            "host", context=bench.context,
            parameter_overrides=[Parameter(name, value=value) for name, value in overrides.items()],
        )  # fmt: skip
        self.in_force: list[ParameterSet] = []
        self.parameters = NodeParameters(self.node, (Sieve, Scale), lambda: (Sieve, Scale, Neighbour))
        self.refuse = ""
        self.parameters.watch(self.prepare)
        bench.executor.add_node(self.node)

    def prepare(self, proposed: ParameterSet) -> Any:
        if self.refuse:
            raise ValueError(self.refuse)
        return lambda: self.in_force.append(proposed)

    def set(self, **values: Any) -> list[Any]:
        return list(self.node.set_parameters([Parameter(name, value=value) for name, value in values.items()]))

    def ros_values(self) -> dict[str, Any]:
        return {name: self.node.get_parameter(name).value for name in self.parameters.current.values()}


@pytest.fixture
def host(bench: Bench) -> Iterator[Host]:
    host = Host(bench)
    yield host
    host.node.destroy_node()


def test_defaults(host: Host) -> None:
    assert host.parameters.current[Sieve] == Sieve()
    assert host.ros_values() == {
        "mesh_mm": 2.0, "shakes": 3, "shape": "round", "wet": False, "maker": "unknown", "tare_g": 0.0,
    }  # fmt: skip


def test_overrides_whole_numbers_for_floats_included(bench: Bench) -> None:
    host = Host(bench, mesh_mm=4, shape="square")
    assert host.parameters.current[Sieve] == Sieve(mesh_mm=4.0, shape="square")
    value = host.node.get_parameter("mesh_mm")
    assert (value.type_, value.value) == (Parameter.Type.DOUBLE, 4.0)


def test_refused_overrides_are_all_named_in_one_line(bench: Bench) -> None:
    with pytest.raises(ParameterError) as caught:
        Host(bench, mesh_mm=99.0, shakes="often", shape="round")
    text = str(caught.value)
    assert "mesh_mm: expected a float in [0.5, 10] mm, got 99.0" in text
    assert "shakes: expected an int" in text
    assert "\n" not in text


def test_overrides_that_contradict_each_other_are_refused(bench: Bench) -> None:
    with pytest.raises(ParameterError, match=r"expected mesh_mm >= 1 under water, got 0\.5"):
        Host(bench, wet=True, mesh_mm=0.5)


def test_only_misspelt_names_are_warned_about(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    overrides = {"mesh": 1.0, "neighbours_knob": 1.0, "qos_overrides./x.publisher.depth": 3, "use_sim_time": True}
    Host(bench, **overrides)
    lines = [line for line in capfd.readouterr().err.splitlines() if "unknown" in line]
    assert len(lines) == 1
    assert "parameter mesh:" in lines[0]


def test_a_change_is_put_into_force(host: Host) -> None:
    (result,) = host.set(mesh_mm=3.5)
    assert result.successful
    assert host.in_force[-1][Sieve].mesh_mm == 3.5
    assert host.parameters.current[Sieve] == Sieve(mesh_mm=3.5)
    assert host.parameters.current[Scale] == Scale()


def test_a_whole_number_is_a_float_while_running_too(host: Host) -> None:
    (result,) = host.set(mesh_mm=5)
    assert result.successful, result.reason
    assert host.in_force[-1][Sieve].mesh_mm == 5.0
    assert host.node.get_parameter("mesh_mm").type_ == Parameter.Type.DOUBLE


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"mesh_mm": 11.0}, "mesh_mm"),
        ({"shakes": 0}, "shakes"),
        ({"shape": "oval"}, "one of round, square, got 'oval'"),
        ({"wet": "yes"}, "type"),
        ({"maker": "me"}, "read-only"),
        ({"mesh_mm": float("nan")}, "mesh_mm"),
    ],
)
def test_a_refused_change_changes_nothing(host: Host, change: dict[str, Any], words: str) -> None:
    before = host.ros_values()
    (result,) = host.set(**change)
    assert not result.successful
    assert words in result.reason
    assert host.ros_values() == before
    assert host.parameters.current[Sieve] == Sieve()
    assert host.in_force == []


def test_the_stage_may_refuse_too(host: Host) -> None:
    host.refuse = "mesh_mm: does not fit the frame"
    (result,) = host.set(mesh_mm=3.0)
    assert (result.successful, result.reason) == (False, "mesh_mm: does not fit the frame")
    assert host.ros_values()["mesh_mm"] == 2.0


def test_several_at_once_stand_or_fall_together(host: Host) -> None:
    def at_once(**values: Any) -> Any:
        return host.node.set_parameters_atomically([Parameter(n, value=v) for n, v in values.items()])

    assert not at_once(shakes=7, wet=True, mesh_mm=0.5).successful
    assert host.parameters.current[Sieve] == Sieve()
    assert host.ros_values()["shakes"] == 3
    assert at_once(shakes=7, wet=True, mesh_mm=1).successful
    assert host.parameters.current[Sieve] == Sieve(shakes=7, wet=True, mesh_mm=1.0)


def test_over_the_service_as_ros2_param_does_it(bench: Bench, host: Host) -> None:
    client = bench.outsider.create_client(SetParametersAtomically, "/host/set_parameters_atomically")
    bench.spin_until(client.service_is_ready)
    request = SetParametersAtomically.Request(parameters=[Parameter("mesh_mm", value=7).to_parameter_msg()])
    future = client.call_async(request)
    bench.spin_until(future.done)
    assert future.result().result.successful, future.result().result.reason
    assert host.in_force[-1][Sieve].mesh_mm == 7.0


def test_descriptors() -> None:
    mesh, shakes, shape, _, maker = (descriptor(spec) for spec in Sieve.specs())
    assert mesh.description == "Width of a hole. [mm]"
    assert (mesh.floating_point_range[0].from_value, mesh.floating_point_range[0].to_value) == (0.5, 10.0)
    assert (shakes.integer_range[0].from_value, shakes.integer_range[0].to_value) == (1, 2**63 - 1)
    assert shape.additional_constraints == "one of round, square"
    assert maker.read_only
    assert not mesh.read_only


def test_which_classes_changed() -> None:
    before = ParameterSet((Sieve, Scale), {})
    assert before.changed(ParameterSet((Sieve, Scale), {"tare_g": 1.0})) == {Scale}
    assert before.changed(ParameterSet((Sieve, Scale), {})) == frozenset()
