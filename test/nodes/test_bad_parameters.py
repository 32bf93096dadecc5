"""Parameter values that make no sense, through the real parameter services: refused with the reason, no change."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from helpers.ros_bench import Bench
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter

from uw_recon_ros.nodes.disparity_node import DisparityNode
from uw_recon_ros.nodes.pipeline_node import PipelineNode
from uw_recon_ros.nodes.point_cloud_node import PointCloudNode
from uw_recon_ros.nodes.preprocess_node import PreprocessNode
from uw_recon_ros.nodes.rectify_node import RectifyNode
from uw_recon_ros.params import ParamSpec

NODES = (PreprocessNode, RectifyNode, DisparityNode, PointCloudNode, PipelineNode)
ARRAYS = ([], [1, 2], [0.5], [True], ["auto"], [b"\0"])


class Client:
    """An outsider that calls the parameter services of a node."""

    def __init__(self, bench: Bench, node: Any) -> None:
        self.bench, self.node = bench, node
        self.specs: dict[str, ParamSpec] = dict(node._declared._specs)
        kinds = {"get": GetParameters, "set": SetParameters, "set_atomically": SetParametersAtomically}
        names = {"get": "get_parameters", "set": "set_parameters", "set_atomically": "set_parameters_atomically"}
        self.clients = {
            key: bench.outsider.create_client(kind, f"/{node.get_name()}/{names[key]}") for key, kind in kinds.items()
        }
        bench.spin_until(lambda: all(c.service_is_ready() for c in self.clients.values()), "parameter services")

    def call(self, key: str, request: Any) -> Any:
        future = self.clients[key].call_async(request)
        self.bench.spin_until(future.done, f"an answer of {key}")
        return future.result()

    def values(self) -> list[str]:
        """As text, so that NaN would equal NaN."""
        return [str(v) for v in self.call("get", GetParameters.Request(names=list(self.specs))).values]

    def set(self, *pairs: tuple[str, Any]) -> list[Any]:
        messages = [message(name, value) for name, value in pairs]
        return list(self.call("set", SetParameters.Request(parameters=messages)).results)


def message(name: str, value: Any) -> ParameterMessage:
    sent: ParameterMessage = Parameter(name, value=value).to_parameter_msg()
    return sent


def wrong(spec: ParamSpec) -> list[Any]:
    """Values that a parameter must refuse: other types, what is not finite, what is out of range, what is no choice."""
    values: list[Any] = [*ARRAYS, None]
    scalars = {bool: True, int: 3, float: 0.5, str: "x" * 10_000}
    values += [v for kind, v in scalars.items() if kind is not spec.type and (kind, spec.type) != (int, float)]
    if spec.type is float:
        values += [math.nan, math.inf, -math.inf]
    if spec.type in (int, float):
        step = 1 if spec.type is int else 1e-3 * (1 + abs(spec.low or 0))
        values += [spec.type(spec.low - step)] if spec.low is not None else []
        values += [spec.type(spec.high + 1000 * step)] if spec.high is not None and spec.high < 2**62 else []
        values += [v for v in (-(2**63), 2**63 - 1) if spec.type is int and not spec._in_range(v)]
    if spec.choices:
        values += ["", spec.choices[0].upper() + " ", "../" + spec.choices[0], "\n", "x" * 100_000]
    return values


@pytest.fixture(params=NODES, ids=lambda make: make.__name__)
def client(request: pytest.FixtureRequest, bench: Bench) -> Iterator[Client]:
    client = Client(bench, bench.start(request.param))
    yield client
    assert client.node.stop(300.0)  # the matcher may still be compiling


def test_each_wrong_value_is_refused_and_changes_nothing(client: Client) -> None:
    before, stage = client.values(), client.node.stage
    for name, spec in client.specs.items():
        cases = [(name, value) for value in wrong(spec)]
        for (_, value), result in zip(cases, client.set(*cases), strict=True):
            assert not result.successful, (name, value)
            assert result.reason, (name, value)
            assert "\n" not in result.reason, (name, value)
    assert client.values() == before
    assert client.node.stage is stage


def test_names_nobody_declared_are_refused(client: Client) -> None:
    for name in ("", "no_such", "../up", "x" * 10_000, "max_disparity\n", "a.b.c"):
        (result,) = client.set((name, 1))
        assert not result.successful, name
        assert result.reason, name


def test_one_wrong_value_among_good_ones_leaves_all_as_they_were(client: Client) -> None:
    before = client.values()
    parameters = [message("pair_tolerance_ms", 2.0), message("stall_warning_s", math.nan)]
    result = client.call("set_atomically", SetParametersAtomically.Request(parameters=parameters)).result
    assert not result.successful
    assert "stall_warning_s" in result.reason
    assert client.values() == before


def test_any_values_at_all(client: Client) -> None:
    """Whatever is taken is a valid value; whatever is not changes nothing; the node goes on answering."""
    anything = st.one_of(
        st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(), st.text(max_size=20),
        st.lists(st.integers(-9, 9), max_size=3), st.lists(st.floats(), max_size=3),
        st.lists(st.text(max_size=3), max_size=3),
    )  # fmt: skip

    @settings(
        database=None, max_examples=10, phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(st.lists(st.tuples(st.sampled_from(sorted(client.specs)), anything), min_size=30, max_size=30))
    def test(pairs: list[tuple[str, Any]]) -> None:
        for (name, value), result in zip(pairs, client.set(*pairs), strict=True):
            if result.successful:
                client.specs[name].check(value)
            else:
                assert result.reason, (name, value)
        current = client.node._declared.current.values()
        for name, spec in client.specs.items():
            assert spec.check(current[name]) == current[name]
            assert client.node.get_parameter(name).value == current[name]

    test()
