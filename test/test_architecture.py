"""Imports point down only, and what is declared elsewhere agrees with the code."""

from __future__ import annotations

import ast
import importlib
import re
import subprocess
import sys
from pathlib import Path

import pytest

import uw_recon_ros
from uw_recon_ros import executables
from uw_recon_ros.catalogue import ALL_PARAMS
from uw_recon_ros.params import read_parameter_file
from uw_recon_ros.pipeline import PipelineParams, read_values

ROOT = Path(__file__).parent.parent
PACKAGE = ROOT / "uw_recon_ros"
NOUNS = {"", "types", "params", "errors", "images", "calibration", "pairing", "jit", "blas", "progress"}
NOUNS |= {"files", "lazy_import", "stopwatch", "bounds", "image_pair", "system_errors"}
NOUNS |= {
    "evaluate",
    "stop_signals",
    "findings",
    "topics",
    "trajectory",
    "rigid",
    "connected_pieces",
    "unseen_pixels",
    "masks",
    "medians",
    "camera_sides",
    "boards",
    "board_kinds",
    "lenses",
    "camera_mount",
}
NOUNS |= {"evaluate_trajectory", "evaluate_surface"}
STAGE_ROOMS = {"preprocess", "rectify", "match", "reconstruct"}
NODE_PARAMS = {"node_params", "catalogue"}
OFFLINE = NOUNS | STAGE_ROOMS | NODE_PARAMS | {"pipeline"}
MAY_IMPORT = {
    **dict.fromkeys(NOUNS, NOUNS),
    "": OFFLINE | {"api"},
    "api": OFFLINE
    | {"rectified_input", "bags", "recordings", "measure", "measure_files", "calibrate", "calibrate_files"},
    **{room: NOUNS | {room} for room in STAGE_ROOMS},
    "node_params": NOUNS,
    "catalogue": NOUNS | STAGE_ROOMS | NODE_PARAMS | {"track", "live"},
    "pipeline": OFFLINE,
    "rectified_input": NOUNS | STAGE_ROOMS,
    "kernel_warmup": NOUNS | STAGE_ROOMS,
    "messages": NOUNS | {"messages"},
    "bags": NOUNS | {"bags", "messages"},
    "recordings": NOUNS | {"recordings", "bags", "messages"},
    "simulate": NOUNS | {"simulate", "bags", "messages"},
    "track": NOUNS | {"track"},
    "align": NOUNS | {"track", "align"},
    "locate": NOUNS | {"track", "align", "locate"},
    "fuse": NOUNS | {"fuse"},
    "texturing": NOUNS | {"fuse", "texturing"},
    "live": NOUNS | {"track", "align", "fuse", "texturing", "live"},
    "georeference": NOUNS | {"georeference"},
    "report": NOUNS | {"report"},
    "calibrate": NOUNS | {"rectify", "calibrate"},
    "measure": NOUNS | {"measure"},
    "measure_files": NOUNS | {"measure", "survey"},
    "calibrate_files": NOUNS | {"calibrate", "recordings", "bags", "report"},
    "calibrate_live": NOUNS | {"calibrate", "calibrate_files"},
    "pair": OFFLINE | {"rectified_input", "recordings", "report", "kernel_warmup"},
    "doctor": NOUNS | {"rectify", "node_params", "doctor"},
    "ros": NOUNS | STAGE_ROOMS | NODE_PARAMS | {"ros", "doctor", "messages"},
    "nodes": OFFLINE
    | {"ros", "nodes", "bags", "track", "fuse", "live", "model", "calibrate", "calibrate_files", "calibrate_live"}
    | {"report"},
    "survey": OFFLINE | {"survey", "recordings", "bags", "report", "messages", "kernel_warmup"},
    "model": OFFLINE
    | {"survey", "recordings", "report", "bags", "track", "locate", "fuse", "texturing", "georeference", "model"},
    "executables": {"", "stop_signals", "blas"},
    "cli": OFFLINE
    | {"cli", "pair", "kernel_warmup", "bags", "recordings", "simulate", "report", "survey", "model", "doctor", "ros"}
    | {"calibrate", "calibrate_files", "measure_files", "nodes"},
}
ROS_PACKAGES = re.compile(r"rclpy|rcl_interfaces|builtin_interfaces|ament_index_python|\w+_msgs|std_srvs|launch(_ros)?")
MODULES = sorted(PACKAGE.rglob("*.py"))


def imports(path: Path) -> set[str]:
    """Every module imported anywhere in a file, in full."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names.add(str(node.module))
            names |= {f"{node.module}.{alias.name}" for alias in node.names if node.module == "uw_recon_ros"}
    return names


def room(path: Path) -> str:
    first = path.relative_to(PACKAGE).parts[0]
    return first.removesuffix(".py") if first != "__init__.py" else ""


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(PACKAGE)))
def test_imports_point_down(path: Path) -> None:
    here, found = room(path), imports(path)
    rooms = {name.split(".")[1] for name in found if name.startswith("uw_recon_ros.")} - {"__version__"}
    assert rooms <= MAY_IMPORT[here], f"{here} may not import {rooms - MAY_IMPORT[here]}"
    tops = {name.split(".")[0] for name in found}
    ros = {top for top in tops if ROS_PACKAGES.fullmatch(top)}
    assert not ros or here in {"ros", "nodes"}, f"{here} may not import {ros}"
    assert not tops & {"rosbags", "mcap"} or here == "bags", f"{here} may not read bags itself"


def test_offline_use_needs_no_ros() -> None:
    code = "import sys, uw_recon_ros.cli, uw_recon_ros.pair, uw_recon_ros.pipeline; print('rclpy' in sys.modules)"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert out.stdout.strip() == "False"


def test_parameter_names_are_unique_over_all_nodes() -> None:
    names = [spec.name for cls in ALL_PARAMS for spec in cls.specs()]
    assert sorted(names) == sorted(set(names))


def test_every_parameter_has_a_sentence() -> None:
    for cls in ALL_PARAMS:
        for spec in cls.specs():
            assert re.fullmatch(r"[A-Z].*\.", spec.doc, re.DOTALL), f"{spec.name}: {spec.doc!r}"


def console_scripts() -> dict[str, str]:
    source = (ROOT / "setup.py").read_text(encoding="utf-8")
    nodes = ast.literal_eval(re.search(r"^NODES = (\[.*?\])$", source, re.MULTILINE | re.DOTALL)[1])  # type: ignore[index]
    return {node: f"uw_recon_ros.nodes.{node}" for node in nodes} | {"uw_recon": "uw_recon_ros.cli"}


def test_the_version_is_that_of_package_xml() -> None:
    told = re.search(r"<version>(.*?)</version>", (ROOT / "package.xml").read_text(encoding="utf-8"))[1]  # type: ignore[index]
    assert uw_recon_ros.__version__ == told, "make anew: pip install -e ."
    assert f"version: {told}" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")


def test_entry_points_exist() -> None:
    pytest.importorskip("rclpy", reason="nodes need ROS 2")
    for name, module in console_scripts().items():
        assert callable(importlib.import_module(module).main)
        assert name == "uw_recon" or callable(getattr(executables, name))


def test_every_node_has_an_entry_point() -> None:
    nodes = {path.stem for path in (PACKAGE / "nodes").glob("*_node.py")}
    assert nodes == set(console_scripts()) - {"uw_recon"}


def test_launch_file_names_our_executables() -> None:
    for path in (ROOT / "launch").glob("*.launch.py"):
        named = set(re.findall(r"\"(\w+_node)\"", path.read_text(encoding="utf-8")))
        assert named
        assert named <= set(console_scripts())


@pytest.mark.parametrize("path", sorted((ROOT / "config").glob("*.yaml")), ids=lambda p: p.name)
def test_parameter_files_are_understood(path: Path) -> None:
    PipelineParams.from_mapping(read_values(path))


def test_default_file_holds_every_default() -> None:
    values = read_parameter_file(ROOT / "config" / "default.yaml", [])
    assert values == {spec.name: spec.default for cls in ALL_PARAMS for spec in cls.specs()}


@pytest.mark.parametrize("tool", ["write_parameters.py", "write_topics.py"])
def test_generated_files_are_up_to_date(tool: str) -> None:
    code = subprocess.run([sys.executable, str(ROOT / "tools" / tool), "--check"], check=False)
    assert code.returncode == 0, "run 'make docs'"
