"""Parameters, declared once.

A stage's parameters are a frozen dataclass derived from `Params`, each field made by `param`. Validation, ROS
descriptors, parameter files and ``config/PARAMETERS.md`` all come from that declaration. Names are unique over all
stages, so that one flat list serves every node.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, get_type_hints

_SPEC = "uw_recon_spec"
P = TypeVar("P", bound="Params")


@dataclass(frozen=True)
class ParamSpec:
    """What is known of one parameter.

    Parameters
    ----------
    name : str
    type : type
        bool, int, float or str.
    default : bool, int, float or str
    unit : str
        Empty when it has none.
    doc : str
        One sentence.
    low, high : float or None
        Inclusive range.
    choices : tuple of str
        Allowed values of a str; empty = any.
    read_only : bool
        Whether it is fixed once a node runs.
    """

    name: str
    type: type
    default: Any
    unit: str
    doc: str
    low: float | None
    high: float | None
    choices: tuple[str, ...]
    read_only: bool

    @property
    def expectation(self) -> str:
        """The allowed values in words, e.g. ``a float in [0, 1] px``."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        article = "an" if self.type is int else "a"
        text = f"{article} {self.type.__name__}"
        if self.low is not None or self.high is not None:
            low = "-inf" if self.low is None else f"{self.low:g}"
            high = "inf" if self.high is None else f"{self.high:g}"
            text += f" in [{low}, {high}]"
        return f"{text} {self.unit}".rstrip()

    def check(self, value: Any) -> Any:
        """Return `value` as the declared type.

        Raises
        ------
        TypeError, ValueError
            Naming the parameter, the expectation and what came.
        """
        if self.type is float and isinstance(value, int) and not isinstance(value, bool):
            value = float(value)
        if type(value) is not self.type:
            raise TypeError(f"{self.name}: expected {self.expectation}, got {value!r} ({type(value).__name__})")
        if not self._in_range(value) or (self.choices and value not in self.choices):
            raise ValueError(f"{self.name}: expected {self.expectation}, got {value!r}")
        return value

    def _in_range(self, value: Any) -> bool:
        if self.type not in (int, float):
            return True
        low, high = self.low, self.high
        return math.isfinite(value) and (low is None or value >= low) and (high is None or value <= high)


def param(
    default: bool | int | float | str,
    doc: str,
    *,
    unit: str = "",
    low: float | None = None,
    high: float | None = None,
    choices: tuple[str, ...] = (),
    read_only: bool = False,
) -> Any:
    """Declare a field of a `Params` dataclass."""
    spec = {
        "default": default, "unit": unit, "doc": doc, "low": low, "high": high,
        "choices": choices, "read_only": read_only,
    }  # fmt: skip
    return dataclasses.field(default=default, metadata={_SPEC: spec})


@dataclass(frozen=True)
class Params:
    """Base of every stage's parameters: validated when made, never changed."""

    def __post_init__(self) -> None:
        for spec in self.specs():
            object.__setattr__(self, spec.name, spec.check(getattr(self, spec.name)))
        self.check_together()

    def check_together(self) -> None:
        """Raise ``ValueError`` where parameters contradict each other. Overridden where they can."""

    @classmethod
    def specs(cls) -> tuple[ParamSpec, ...]:
        """The declarations, in order."""
        hints = get_type_hints(cls)
        return tuple(ParamSpec(name=f.name, type=hints[f.name], **f.metadata[_SPEC]) for f in dataclasses.fields(cls))

    @classmethod
    def from_mapping(cls: type[P], values: Mapping[str, Any]) -> P:
        """Build from `values`, ignoring names that are other stages'; see `unknown_names`."""
        own = {spec.name for spec in cls.specs()}
        return cls(**{name: value for name, value in values.items() if name in own})


def unknown_names(values: Iterable[str], known: Iterable[type[Params]]) -> list[str]:
    """Names in `values` that no class in `known` declares: misspelt, most likely."""
    declared = {spec.name for cls in known for spec in cls.specs()}
    return sorted(set(values) - declared)


def read_parameter_file(path: str | Path, node_names: Iterable[str]) -> dict[str, Any]:
    """Read a ROS parameter file as the named nodes would.

    Parameters
    ----------
    path : path
        YAML: ``NODE: {ros__parameters: {name: value}}``; ``/**`` is every node, later sections win.
    node_names : iterable of str
        Sections to merge, e.g. the four stage nodes.

    Returns
    -------
    dict
        Parameter name to value.

    Raises
    ------
    ValueError
        The file cannot be read, or is not a ROS parameter file.
    """
    from uw_recon_ros.files import strict_yaml

    try:
        document = strict_yaml.read(path) or {}
    except strict_yaml.YamlError as error:
        raise ValueError(f"{path}: expected a ROS parameter file: {error}") from error
    wanted = set(node_names)
    merged: dict[str, Any] = {}
    for section, body in document.items() if isinstance(document, dict) else [(None, None)]:
        values = body.get("ros__parameters") if isinstance(body, dict) else None
        if not isinstance(section, str) or not isinstance(values, dict):
            raise ValueError(f"{path}: expected 'NODE: ros__parameters: ...' sections, got {section!r}")
        if section.split("/")[-1] in wanted | {"**", "*"}:
            merged.update(values)
    return merged
