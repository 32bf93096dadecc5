"""Write the pages of the reference that follow from the code, for ``docs/conf.py``: commands, Python, ..."""

from __future__ import annotations

import argparse
import ast
import contextlib
import importlib
import inspect
import os
import tokenize
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from types import ModuleType
from unittest import mock

import uw_recon_ros
from uw_recon_ros import findings
from uw_recon_ros.cli import VERBS, make_parser
from uw_recon_ros.findings import Code

COMMANDS = "Generated from the argument parsers: what `--help` prints.\n"
LAUNCH_FILE = Path(__file__).resolve().parent.parent / "launch" / "uw_recon.launch.py"
LAUNCH = """# Launch arguments

Generated from `launch/uw_recon.launch.py`. `ros2 launch uw_recon_ros uw_recon.launch.py NAME:=VALUE ...`

| name | default | what it is |
| --- | --- | --- |
"""
PYTHON = """# Python

What `import uw_recon_ros` offers, and the modules of the nouns with what they have beside it.
Examples: [from Python](../python.md). All codes: [codes of findings and errors](codes.md).

"""
MORE_MODULES = ("types", "calibration", "calibration.judge", "trajectory", "findings", "errors")
CODES = """What is found, and every error, has a code. A text may change, a code may not: programs go by codes.
In Python `Code.IMAGE_IDENTICAL` is `image.identical`, and so on. Generated from `uw_recon_ros.findings.Code`.

| code | |
| --- | --- |
"""


def parsers() -> dict[str, argparse.ArgumentParser]:
    """The parser of each subcommand by name."""
    (action,) = (action for action in make_parser()._actions if isinstance(action, argparse._SubParsersAction))
    return dict(action.choices)


def _command(name: str, text: str) -> str:
    return f"\n## uw_recon {name}\n\n{VERBS[name].HELP[:1].upper()}{VERBS[name].HELP[1:]}.\n\n```\n{text}```\n"


def commands_page() -> str:
    """All subcommands with their arguments."""
    with mock.patch.dict(os.environ, {"COLUMNS": "100", "NO_COLOR": "1"}):
        return "# Commands\n\n" + COMMANDS + "".join(_command(name, p.format_help()) for name, p in parsers().items())


def _launch_arguments() -> Iterator[list[str]]:
    """Name, default and text of each argument; read, not imported: `launch` need not be there."""
    for node in ast.walk(ast.parse(LAUNCH_FILE.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "Argument":
            yield [ast.literal_eval(argument) for argument in node.args[:3]]


def launch_page() -> str:
    """All arguments of the launch file."""
    rows = (
        f"| `{name}` | {f'`{default}`' if default else ''} | {about} |\n"
        for name, default, about in _launch_arguments()
    )
    return LAUNCH + "".join(rows)


def _section(title: str, directives: Iterable[str]) -> str:
    return f"## {title}\n\n```{{eval-rst}}\n" + "\n".join(directives) + "```\n\n"


def offered(name: str) -> object:
    """What the front door gives by a name: of a verb that is a room as well, the verb."""
    return getattr(importlib.import_module("uw_recon_ros.api"), name, None) or getattr(uw_recon_ros, name)


def _front_door(kind: Callable[[object], bool], directive: str) -> Iterator[str]:
    for name in uw_recon_ros.__all__:
        if kind(offered(name)):
            few = "   :no-members:\n" if name == "Code" else ""  # its members have a page of their own
            room = isinstance(getattr(uw_recon_ros, name), ModuleType)
            yield f".. {directive}:: uw_recon_ros.{'api.' if room else ''}{name}\n{few}"


def _module(name: str) -> str:
    """A module without what the front door has of it."""
    front = {offered(name) for name in uw_recon_ros.__all__}
    module = importlib.import_module(f"uw_recon_ros.{name}")
    told = [key for key, found in vars(module).items() if inspect.isroutine(found) or inspect.isclass(found)]
    told = [key for key in told if vars(module)[key] in front]
    without = f"   :exclude-members: {', '.join(told)}\n" if told else ""
    return _section(f"uw_recon_ros.{name}", [f".. automodule:: uw_recon_ros.{name}\n{without}"])


def python_page() -> str:
    """The front door, and the nouns behind it."""
    functions = _section("Functions", _front_door(inspect.isroutine, "autofunction"))
    classes = _section("Classes", _front_door(inspect.isclass, "autoclass"))
    return PYTHON + functions + classes + "".join(map(_module, MORE_MODULES))


def _remarks() -> Iterator[tuple[int, str]]:
    """Comments ``#:`` of the module of codes, by line."""
    with tokenize.open(str(findings.__file__)) as source:
        for token in tokenize.generate_tokens(source.readline):
            if token.type == tokenize.COMMENT and token.string.startswith("#:"):
                yield token.start[0], token.string[2:].strip()


def _lines_of_codes() -> dict[str, int]:
    lines = Path(str(findings.__file__)).read_text(encoding="utf-8").splitlines()
    return {line.split("=")[0].strip(): number for number, line in enumerate(lines, 1) if " = " in line}


def codes_page() -> str:
    """All codes, with what is remarked beside them."""
    remarks, lines = dict(_remarks()), _lines_of_codes()
    rows = (f"| `{code.value}` | {remarks.get(lines[code.name], '')} |\n" for code in Code)
    return "# Codes of findings and errors\n\n" + CODES + "".join(rows)


def write(folder: Path) -> None:
    """Write all pages; those that are as they were keep their time, so that a second build is quick."""
    folder.mkdir(exist_ok=True)
    pages = {"commands.md": commands_page(), "launch.md": launch_page(), "codes.md": codes_page()}
    pages["python.md"] = python_page()
    for name, text in pages.items():
        with contextlib.suppress(FileNotFoundError):
            if (folder / name).read_text(encoding="utf-8") == text:
                continue
        (folder / name).write_text(text, encoding="utf-8")
