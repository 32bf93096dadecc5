"""What our launch file uses of ROS 2's launch, where that is not installed: enough to execute the file.

No wheels of launch exist. Signatures and the command line made of a node follow launch 3.4 and launch_ros 0.26 (Jazzy).
"""

from __future__ import annotations

import sys
import types
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
import yaml


@dataclass
class LaunchContext:
    launch_configurations: dict[str, str] = field(default_factory=dict)


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


@dataclass
class TimerAction:
    period: float
    actions: list[Any]


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
    on_exit: Any = None

    def command(self, folder: Path) -> list[str]:
        """Arguments of the process, as launch_ros makes them; values go into a file in `folder`."""
        line = [*self.arguments, "--ros-args", *self.ros_arguments]
        if self.name:
            line += ["-r", f"__node:={self.name}"]
        if self.namespace:
            line += ["-r", f"__ns:=/{self.namespace.lstrip('/')}"]
        for number, given in enumerate(self.parameters):
            path = given
            if isinstance(given, dict):
                path = folder / f"launch_params_{self.name}_{number}.yaml"
                path.write_text(yaml.safe_dump({"/**": {"ros__parameters": given}}))
            assert Path(path).is_file(), path
            line += ["--params-file", str(path)]
        return line + [part for ours, theirs in self.remappings for part in ("-r", f"{ours}:={theirs}")]


def install(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the launch file import these for launch's."""
    modules = {
        "launch": (LaunchContext, LaunchDescription),
        "launch.actions": (DeclareLaunchArgument, OpaqueFunction, Shutdown, TimerAction),
        "launch_ros": (),
        "launch_ros.actions": (Node,),
    }
    for name, classes in modules.items():
        module = types.ModuleType(name)
        for cls in classes:
            setattr(module, cls.__name__, cls)
        monkeypatch.setitem(sys.modules, name, module)
