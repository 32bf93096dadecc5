"""`Params` dataclasses <-> a node's ROS parameters.

All of a node's parameters are one flat list; each dataclass finds its own. Values are checked by the dataclasses, so
that a node, the command line and a test refuse the same values with the same words.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from uw_recon_ros.params import Params, ParamSpec

P = TypeVar("P", bound=Params)
_LARGEST_FLOAT, _LARGEST_INT = 1.7976931348623157e308, 2**63 - 1
_OTHERS_PREFIXES = ("qos_overrides.",)


class ParameterError(ValueError):
    """A node cannot start with the parameters it was given."""


class ParameterSet:
    """One instance of each of several `Params` classes; never changed.

    Parameters
    ----------
    classes : iterable of type
    values : mapping
        Names to values, of any of the classes; what is left out has its default.

    Raises
    ------
    TypeError, ValueError
        As the classes do.
    """

    def __init__(self, classes: Iterable[type[Params]], values: Mapping[str, Any]) -> None:
        self._instances = {cls: cls.from_mapping(values) for cls in classes}

    def __getitem__(self, cls: type[P]) -> P:
        instance = self._instances[cls]
        assert isinstance(instance, cls)
        return instance

    def values(self) -> dict[str, Any]:
        """All names and values."""
        return {
            spec.name: getattr(instance, spec.name)
            for instance in self._instances.values()
            for spec in instance.specs()
        }

    def changed(self, other: ParameterSet) -> frozenset[type[Params]]:
        """Classes whose values differ from `other`'s."""
        return frozenset(cls for cls, instance in self._instances.items() if instance != other._instances[cls])


def descriptor(spec: ParamSpec) -> ParameterDescriptor:
    """Describe a parameter to ROS: sentence, unit, range, choices, read-only flag."""
    text = f"{spec.doc} [{spec.unit}]" if spec.unit else spec.doc
    described = ParameterDescriptor(name=spec.name, description=text, read_only=spec.read_only)
    if spec.choices:
        described.additional_constraints = "one of " + ", ".join(spec.choices)
    if spec.low is not None or spec.high is not None:
        if spec.type is int:
            low, high = _ends(spec, -_LARGEST_INT, _LARGEST_INT)
            described.integer_range = [IntegerRange(from_value=int(low), to_value=int(high))]
        else:
            low, high = _ends(spec, -_LARGEST_FLOAT, _LARGEST_FLOAT)
            described.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
    return described


def _ends(spec: ParamSpec, lowest: float, highest: float) -> tuple[float, float]:
    return lowest if spec.low is None else spec.low, highest if spec.high is None else spec.high


class NodeParameters:
    """A node's parameters: declared, checked together, changed as a whole or not at all.

    Parameters
    ----------
    node : Node
    classes : iterable of type
        The `Params` classes the node has.
    others : callable
        Gives the `Params` classes of all nodes, asked only to tell a misspelt override from one meant for another node.

    Raises
    ------
    ParameterError
        An override is refused; one line that names all of them.

    Attributes
    ----------
    current : ParameterSet
    """

    def __init__(
        self, node: Node, classes: Iterable[type[Params]], others: Callable[[], Iterable[type[Params]]] = lambda: ()
    ) -> None:
        self._node, self._classes = node, tuple(classes)
        self._specs = {spec.name: spec for cls in self._classes for spec in cls.specs()}
        self._overrides: dict[str, Any] = {name: p.value for name, p in node._parameter_overrides.items()}
        self.current = self._declare()
        self._warn_of_unknown(others)

    def watch(self, prepare: Callable[[ParameterSet], Callable[[], None]]) -> None:
        """Be asked about every later change.

        Parameters
        ----------
        prepare : callable
            Given the new set, returns what puts it into force, or raises ``ValueError`` with the reason against it.
        """
        self._prepare = prepare
        # Integers become floats before rclpy compares types; Humble has no such hook and refuses them.
        if hasattr(self._node, "add_pre_set_parameters_callback"):
            self._node.add_pre_set_parameters_callback(self._with_floats)
        self._node.add_on_set_parameters_callback(self._on_set)

    def _declare(self) -> ParameterSet:
        given = {name: value for name, value in self._overrides.items() if name in self._specs}
        reasons = []
        for name, value in given.items():
            try:
                self._specs[name].check(value)
            except (TypeError, ValueError) as error:
                reasons.append(str(error))
        if reasons:
            raise ParameterError("; ".join(reasons))
        try:
            declared = ParameterSet(self._classes, given)
        except (TypeError, ValueError) as error:
            raise ParameterError(str(error)) from error
        for name, value in declared.values().items():
            self._node.declare_parameter(name, value, descriptor(self._specs[name]), ignore_override=True)
        return declared

    def _warn_of_unknown(self, others: Callable[[], Iterable[type[Params]]]) -> None:
        strange = [
            name
            for name in self._overrides
            if not (self._node.has_parameter(name) or name.startswith(_OTHERS_PREFIXES))
        ]
        if not strange:
            return
        foreign = {spec.name for cls in others() for spec in cls.specs()}
        for name in sorted(set(strange) - foreign):
            self._node.get_logger().warning(f"parameter {name}: expected a declared name, got an unknown one: ignored")

    def _with_floats(self, parameters: list[Parameter]) -> list[Parameter]:
        return [self._as_float(p) if self._is_whole_float(p) else p for p in parameters]

    def _is_whole_float(self, parameter: Parameter) -> bool:
        spec = self._specs.get(parameter.name)
        return spec is not None and spec.type is float and parameter.type_ == Parameter.Type.INTEGER

    @staticmethod
    def _as_float(parameter: Parameter) -> Parameter:
        return Parameter(parameter.name, Parameter.Type.DOUBLE, float(parameter.value))

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        if not all(p.name for p in parameters):  # rclpy takes an empty name for a declared one
            return SetParametersResult(successful=False, reason="parameter: expected a declared name, got an empty one")
        changes = {p.name: p.value for p in parameters if p.name in self._specs}
        if not changes:
            return SetParametersResult(successful=True)
        try:
            proposed = ParameterSet(self._classes, {**self.current.values(), **changes})
            commit = self._prepare(proposed)
        except (TypeError, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))
        commit()
        self.current = proposed
        return SetParametersResult(successful=True)
