"""The launch file executed: what it starts, with every argument; and what it starts is started."""

from __future__ import annotations

import importlib.util
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from helpers import launch_double
from helpers.launch_double import LaunchContext, Node, ProcessExited, Shutdown
from helpers.ros_bench import banded_pair, calibration
from sensor_msgs.msg import PointCloud2

from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.catalogue import ALL_PARAMS
from uw_recon_ros.params import read_parameter_file

ROOT = Path(__file__).parents[2]
FILE = ROOT / "launch" / "uw_recon.launch.py"
FOUR = ["preprocess_node", "rectify_node", "disparity_node", "point_cloud_node"]
SECOND = 1_000_000_000


@pytest.fixture
def launch(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """Execute the file with arguments; return the nodes it would start."""
    launch_double.install(monkeypatch)
    index = tmp_path / "prefix" / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "uw_recon_ros").touch()
    (tmp_path / "prefix" / "share" / "uw_recon_ros").symlink_to(ROOT)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))

    def execute(**given: str) -> list[Node]:
        *arguments, start = launch_double.load(FILE).generate_launch_description().entities
        declared = {argument.name: argument for argument in arguments}
        assert given.keys() <= declared.keys()
        for name, value in given.items():
            assert declared[name].choices is None or value in declared[name].choices
        values = {name: argument.default_value for name, argument in declared.items()}
        nodes: list[Node] = start.function(LaunchContext({**values, **given}))
        return nodes

    return execute


def values(node: Node) -> dict[str, Any]:
    """All parameters a node gets, later ones winning."""
    merged: dict[str, Any] = {}
    for given in node.parameters:
        merged |= given if isinstance(given, dict) else read_parameter_file(given, [str(node.name)])
    return merged


def test_the_graph_by_default(launch: Any) -> None:
    nodes = launch()
    assert [node.executable for node in nodes] == [node.name for node in nodes] == FOUR
    defaults = {spec.name: spec.default for cls in ALL_PARAMS for spec in cls.specs()}
    for node in nodes:
        assert values(node) == {**defaults, "use_sim_time": False, "autostart": True}
        assert node.remappings == []


def test_every_argument_is_described_and_used() -> None:
    text = FILE.read_text()
    names = re.findall(r'Argument\("(\w+)"', text)
    assert len(names) == len(set(names)) >= 18
    for name in names:
        side = re.sub(r"^(left|right)", "{side}", name)
        assert f'given["{name}"]' in text or f'given[f"{side}"]' in text


def test_one_process_in_a_name_space(launch: Any) -> None:
    (node,) = launch(composed="true", namespace="rov", autostart="false", respawn="true", log_level="warn")
    assert (node.executable, node.namespace, node.respawn) == ("pipeline_node", "rov", True)
    assert values(node)["autostart"] is False
    assert node.ros_arguments == ["--log-level", "warn"]


def test_odometry_goes_along_where_asked(launch: Any) -> None:
    assert [node.executable for node in launch(odometry="true")] == [*FOUR, "odometry_node"]
    assert [node.executable for node in launch(odometry="true", composed="true")] == ["pipeline_node", "odometry_node"]
    assert [node.executable for node in launch(model="true")] == [*FOUR, "odometry_node", "model_node"]


def test_the_page_goes_along_where_asked(launch: Any) -> None:
    *stages, web = launch(web="true", namespace="rov")
    assert [node.executable for node in stages] == FOUR
    assert (web.executable, web.namespace) == ("web_node", "rov")


def test_parameters_later_ones_win(launch: Any, tmp_path: Path) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**:\n  ros__parameters: {cloud_voxel: 0.5, max_disparity: 10, effort: quality}\n")
    node = launch(params_file=str(mine), preset="navigation", overrides="{max_disparity: 63, cloud_voxel: 0.07}")[2]
    preset = yaml.safe_load((ROOT / "config" / "navigation.yaml").read_text())["/**"]["ros__parameters"]
    assert values(node).items() >= {**preset, "max_disparity": 63, "cloud_voxel": 0.07}.items()
    assert values(launch(effort="balanced", params_file=str(mine))[2])["effort"] == "balanced"
    for text in ("7", "{a: ["):
        with pytest.raises(RuntimeError, match=r"^overrides: expected a YAML mapping.*$"):
            launch(overrides=text)


@pytest.mark.parametrize("name", [spec.name for cls in ALL_PARAMS for spec in cls.specs()])
def test_every_parameter_can_be_overridden(launch: Any, name: str) -> None:
    default = {spec.name: spec.default for cls in ALL_PARAMS for spec in cls.specs()}[name]
    if name != "autostart":  # an argument of its own
        assert values(launch(overrides=yaml.safe_dump({name: default}))[0])[name] == default


def test_where_the_cameras_topics_are(launch: Any) -> None:
    node = launch(left_image="/cam/l/image", right_image="/cam/r/image/compressed", left_camera_info="/cam/l/info")[0]
    assert dict(node.remappings) == {
        "left/image_raw": "/cam/l/image",
        **{f"left/image_raw/{end}": f"/cam/l/image/{end}" for end in ("compressed", "ffmpeg", "foxglove")},
        "left/camera_info": "/cam/l/info",
        "right/image_raw": "/cam/r/image",
        **{f"right/image_raw/{end}": f"/cam/r/image/{end}" for end in ("compressed", "ffmpeg", "foxglove")},
    }


def test_a_bag(launch: Any) -> None:
    *stages, player = launch(bag=str(ROOT / "bags" / "amphora"), rate="0.5", loop="true")
    assert player.executable == "bag_player_node"
    waiting = ["--wait-for-subscribers", "--wait-limit", "30.0"]
    assert player.arguments == [str(ROOT / "bags" / "amphora"), "--rate", "0.5", *waiting, "--loop"]
    assert player.on_exit(ProcessExited(0), LaunchContext()) is None
    assert all(values(node)["use_sim_time"] is True for node in stages)
    assert values(launch(bag=str(ROOT), use_sim_time="false")[0])["use_sim_time"] is False
    assert values(launch(use_sim_time="true")[0])["use_sim_time"] is True


def test_all_ends_with_the_bag_where_asked(launch: Any) -> None:
    player = launch(bag=str(ROOT), shutdown_after_bag="true", drain_limit="7")[-1]
    assert player.arguments[-2:] == ["--drain-limit", "7"]
    assert isinstance(player.on_exit(ProcessExited(0), LaunchContext()), Shutdown)


def test_what_cannot_be_played_or_taken_ends_everything_in_one_line(launch: Any, tmp_path: Path) -> None:
    stage, *_, player = launch(bag=str(ROOT), respawn="true")
    with pytest.raises(RuntimeError, match=r"^the bag could not be played: .* exit code 1$"):
        player.on_exit(ProcessExited(1), LaunchContext())
    with pytest.raises(RuntimeError, match=r"^a_node-1: the node refused its parameters"):
        stage.on_exit(ProcessExited(2), LaunchContext())
    for code in (0, 1, -9):  # its neighbours live on, and it comes back where asked to
        assert stage.on_exit(ProcessExited(code), LaunchContext()) is None
    stopped = LaunchContext(is_shutdown=True)
    assert stage.on_exit(ProcessExited(2), stopped) is player.on_exit(ProcessExited(-2), stopped) is None


BROKEN = {
    "invalid YAML": "a: [",
    "a list": "[1, 2]",
    "no section": "cloud_voxel: 0.5",
    "nothing of ours": "/**/another_node:\n  ros__parameters: {effort: quality}",
    "bytes": "\xff\x00",
}


@pytest.mark.parametrize("text", BROKEN.values(), ids=BROKEN)
def test_nodes_never_start_on_defaults_that_nobody_asked_for(launch: Any, tmp_path: Path, text: str) -> None:
    """The real launch only warns of a file that is missing, and goes on without."""
    for name, value in (("params_file", tmp_path / "missing"), ("params_file", tmp_path), ("bag", tmp_path / "no")):
        with pytest.raises(RuntimeError, match=rf"^{name}: expected .*, got {value}: ") as refusal:
            launch(**{name: str(value)})
        assert "\n" not in str(refusal.value)
    broken = tmp_path / "broken.yaml"
    broken.write_bytes(text.encode("latin-1"))
    with pytest.raises(RuntimeError, match=r"^params_file: expected a ROS parameter file") as refusal:
        launch(params_file=str(broken))
    assert "\n" not in str(refusal.value)


def test_rviz(launch: Any) -> None:
    *_, viewer = launch(rviz="true", namespace="rov", fixed_frame="cam", left_image="/cam/image_raw")
    assert (viewer.package, viewer.executable, viewer.namespace) == ("rviz2", "rviz2", "rov")
    assert viewer.arguments[0] == "-d"
    assert Path(viewer.arguments[1]).is_file()
    assert viewer.arguments[2:] == ["-f", "cam"]
    moved = dict(viewer.remappings)
    assert moved["/left/image_raw"] == "/cam/image_raw"
    assert moved["/points2"] == "points2"
    shown = set(re.findall(r"Value: (/\S+)", Path(viewer.arguments[1]).read_text()))
    assert set(moved) == {
        topic for topic in shown if not topic.startswith(("/tf", "/initialpose", "/goal", "/clicked"))
    }


@pytest.mark.skipif(importlib.util.find_spec("launch_ros") is None, reason="needs ROS 2's launch, which is no wheel")
@pytest.mark.parametrize(
    "given",
    [
        {},
        {"composed": "true", "namespace": "rov"},
        {"preset": "navigation", "left_image": "/cam/l"},
        {"bag": str(ROOT), "loop": "true"},
    ],
)
def test_the_double_is_as_the_real_launch(launch: Any, tmp_path: Path, given: dict[str, str]) -> None:
    """Loaded by the real launch: the same arguments, and of each node the same command line."""
    nodes = launch(**given)
    script = tmp_path / "real.py"
    script.write_text(REAL)
    told = subprocess.run(
        [sys.executable, str(script), str(FILE), json.dumps(given)], capture_output=True, text=True, check=True
    )
    for node, command in zip(nodes, json.loads(told.stdout), strict=True):
        assert with_contents(command) == with_contents(node.command(tmp_path)), node.name


REAL = """
import json, sys
from launch import LaunchContext
from launch.launch_description_sources import get_launch_description_from_python_launch_file as load
from launch.utilities import perform_substitutions
*arguments, start = load(sys.argv[1]).entities
context = LaunchContext()
for argument in arguments:
    default = perform_substitutions(context, argument.default_value)
    context.launch_configurations[argument.name] = json.loads(sys.argv[2]).get(argument.name, default)
commands = []
for node in start.execute(context):
    node._perform_substitutions(context)
    names = {"name": "__node:=" + node.node_name.split("/")[-1], "ns": "__ns:=" + node.expanded_node_namespace}
    context.extend_locals({"ros_specific_arguments": names})
    commands.append([perform_substitutions(context, part) for part in node.cmd[1:]])
print(json.dumps(commands))
"""


def with_contents(command: list[str]) -> list[str]:
    """A command line with the contents of parameter files in place of their names."""
    return [json.dumps(yaml.safe_load(Path(part).read_text())) if Path(part).is_file() else part for part in command]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Ten seconds of a rig whose topics have names of their own."""
    rig = calibration()
    with BagWriter(tmp_path / "bag") as writer:
        for frame in range(100):
            stamp = SECOND + frame * SECOND // 10
            for side, image in zip(("left", "right"), banded_pair(), strict=True):
                writer.image(f"/cam/{side}", image, time_ns=stamp, frame_id="cam")
                writer.camera_info(f"/cam/{side}_info", getattr(rig, side), time_ns=stamp, frame_id="cam")
    return tmp_path / "bag"


@pytest.mark.graph
@pytest.mark.timeout(3600)
@pytest.mark.parametrize("composed", ["false", "true"], ids=["four nodes", "one process"])
def test_what_is_launched_brings_clouds(graph: Any, launch: Any, bag: Path, tmp_path: Path, composed: str) -> None:
    nodes = launch(
        namespace="rov", composed=composed, bag=str(bag), loop="true", preset="navigation",
        overrides="{min_disparity: 0, max_disparity: 24}",
        left_image="cam/left", right_image="cam/right",
        left_camera_info="cam/left_info", right_camera_info="cam/right_info",
    )  # fmt: skip
    clouds = graph.bench.listen(PointCloud2, "/rov/points2")
    for node in nodes:
        graph.start(node.executable, *node.command(tmp_path))
    graph.spin_until(lambda: clouds, "a cloud")
    assert clouds[0].header.frame_id == "cam"
    found = graph.bench.outsider.get_node_names_and_namespaces
    graph.spin_until(lambda: {(node.name, "/rov") for node in nodes} <= set(found()), "all nodes in the name space")
