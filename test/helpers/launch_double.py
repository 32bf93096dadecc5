"""What our launch file uses of ROS 2's launch, where that is not installed: enough to execute the file.

No wheels of launch exist. How the file is loaded, signatures, and the command line made of a node follow launch 3.4 and
launch_ros 0.26 (Jazzy); where these are installed, `test_launch_file` compares.
"""

from __future__ import annotations

import sys
import types
from collections.abc import Callable
from dataclasses import dataclass, field
from importlib.machinery import SourceFileLoader
from importlib.util import module_from_spec, spec_from_loader
from pathlib import Path
from typing import Any

import pytest
import yaml


@dataclass
class LaunchContext:
    launch_configurations: dict[str, str] = field(default_factory=dict)
    is_shutdown: bool = False


@dataclass(frozen=True)
class ProcessExited:
    """The event given to a node's `on_exit`."""

    returncode: int
    process_name: str = "a_node-1"


@dataclass
class LaunchDescription:
    entities: list[Any]


class DeclareLaunchArgument:
    def __init__(self, name: str, *, default_value: str, description: str, choices: list[str] | None = None) -> None:
        self.name, self.default_value, self.description, self.choices = name, default_value, description, choices
        assert choices is None or default_value in choices


@dataclass
class OpaqueFunction:
    function: Callable[[LaunchContext], list[Any]]


@dataclass
class Shutdown:
    reason: str = ""


@dataclass(kw_only=True)
class Node:
    executable: str
    package: str
    name: str | None = None
    namespace: str | None = None
    parameters: list[Any] = field(default_factory=list)
    remappings: list[tuple[str, str]] = field(default_factory=list)
    ros_arguments: list[str] = field(default_factory=list)
    arguments: list[str] = field(default_factory=list)
    output: str = "log"
    respawn: bool = False
    respawn_delay: float | None = None
    on_exit: Callable[[ProcessExited, LaunchContext], Any] | None = None

    def __post_init__(self) -> None:
        """Refuse what launch_ros does: values that are no text, parameters of no type that ROS has."""
        for text in (self.executable, self.package, *self.arguments, *self.ros_arguments, *sum(self.remappings, ())):
            assert isinstance(text, str), text
        for given in self.parameters:
            for value in given.values() if isinstance(given, dict) else ():
                assert isinstance(value, (bool, int, float, str)), value
        assert self.on_exit is None or callable(self.on_exit)

    def command(self, folder: Path) -> list[str]:
        """Arguments of the process, as launch_ros makes them; values go into a file in `folder`."""
        space = f"/{(self.namespace or '').strip('/')}"
        line = [*self.arguments, "--ros-args", *self.ros_arguments, "--ros-args"]
        line += ["-r", f"__node:={self.name}", "-r", f"__ns:={space}"]
        for number, given in enumerate(self.parameters):
            path = given
            if isinstance(given, dict):
                path = folder / f"launch_params_{self.name}_{number}.yaml"
                name = f"{space.rstrip('/')}/{self.name}"
                path.write_text(yaml.safe_dump({name: {"ros__parameters": given}}))
            if Path(path).is_file():  # launch warns, and leaves it out
                line += ["--params-file", str(path)]
        return line + [part for ours, theirs in self.remappings for part in ("-r", f"{ours}:={theirs}")]


def load(path: Path) -> types.ModuleType:
    """Execute a launch file as launch does: as a module that is never in ``sys.modules``."""
    loader = SourceFileLoader("python_launch_file", str(path))
    spec = spec_from_loader(loader.name, loader)
    assert spec is not None
    module = module_from_spec(spec)
    loader.exec_module(module)
    return module


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the launch file import these for launch's."""
    modules = {
        "launch": (LaunchContext, LaunchDescription),
        "launch.actions": (DeclareLaunchArgument, OpaqueFunction, Shutdown),
        "launch_ros": (),
        "launch_ros.actions": (Node,),
    }
    for name, classes in modules.items():
        module = types.ModuleType(name)
        for cls in classes:
            setattr(module, cls.__name__, cls)
        monkeypatch.setitem(sys.modules, name, module)
