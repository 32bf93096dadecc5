"""The graph, live or with a bag.

ros2 launch uw_recon_ros uw_recon.launch.py --show-args
ros2 launch uw_recon_ros uw_recon.launch.py namespace:=rov left_image:=/stereo/left/image_raw ...
ros2 launch uw_recon_ros uw_recon.launch.py bag:=/path/bag rviz:=true overrides:='{effort: navigation}'
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription
from uw_recon_ros.files import strict_yaml
from uw_recon_ros.params import read_parameter_file

PACKAGE = "uw_recon_ros"
STAGES = ("preprocess_node", "rectify_node", "disparity_node", "point_cloud_node")
COMPOSED, PLAYER, ODOMETRY, MODEL, WEB = "pipeline_node", "bag_player_node", "odometry_node", "model_node", "web_node"
TRANSPORTS = ("/compressed", "/ffmpeg", "/foxglove")
#: What is shown, for RViz in a name space: its configuration names them absolute.
SHOWN = (
    *(f"{side}/image_{kind}" for side in ("left", "right") for kind in ("raw", "enhanced", "matching")),
    *(f"rectified/{side}/{image}" for side in ("left", "right") for image in ("image_rect_color", "image_rect")),
    "disparity/status",
    "disparity/sigma",
    "disparity/confidence",
    "depth/image_rect",
    "depth/sigma",
    "points2",
    "points2_filtered",
    "obstacles",
    "range",
    "points_unscaled",
    "surface",
    "odometry",
    "path",
    "model/submap",
    "model/points",
    "model/surface",
    "calibration/coverage",
)
REFUSED = 2  # exit code of a node that does not take its parameters


class Argument(NamedTuple):
    """A launch argument: name, default, what it is for, and what it may be.

    No dataclass: launch executes this file as a module that is never in ``sys.modules``, where none can be made.
    """

    name: str
    default: str
    about: str
    choices: tuple[str, ...] = ()

    def declare(self) -> DeclareLaunchArgument:
        more = {"choices": list(self.choices)} if self.choices else {}
        return DeclareLaunchArgument(self.name, default_value=self.default, description=self.about, **more)


YES_OR_NO = ("true", "false")
ARGUMENTS = (
    Argument("namespace", "", "Name space of all nodes and topics."),
    Argument("composed", "false", "One process (pipeline_node) instead of four.", YES_OR_NO),
    Argument("odometry", "false", "Whether odometry_node follows the bottom too.", YES_OR_NO),
    Argument("model", "false", "Whether model_node makes one model of it all, with odometry_node.", YES_OR_NO),
    Argument("autostart", "true", "Whether the nodes activate themselves; false: a lifecycle manager does.", YES_OR_NO),
    Argument("params_file", "", "ROS parameter file for all nodes; none: the defaults."),
    Argument("preset", "none", "A file of config/ to start from.", ("none", "navigation", "quality", "paper")),
    Argument("overrides", "{}", "Any parameters, as YAML, over file and preset: '{max_disparity: 63}'."),
    Argument("effort", "", "Of the matcher, over file and preset.", ("", "navigation", "balanced", "quality")),
    Argument("left_image", "left/image_raw", "Topic of the left camera's images, or .../compressed and such."),
    Argument("right_image", "right/image_raw", "Topic of the right camera's images."),
    Argument("left_camera_info", "left/camera_info", "Topic of the left camera's calibration."),
    Argument("right_camera_info", "right/camera_info", "Topic of the right camera's calibration."),
    Argument("use_sim_time", "auto", "Whether /clock is the time; auto: with a bag.", ("auto", *YES_OR_NO)),
    Argument("bag", "", "Bag to replay (rosbag2 folder or .mcap); none: live cameras."),
    Argument("rate", "1.0", "Speed of the replay."),
    Argument("loop", "false", "Whether the replay begins again at its end.", YES_OR_NO),
    Argument("wait_limit", "30.0", "Seconds the replay waits for a listener before it begins anyway; 0: for ever."),
    Argument("shutdown_after_bag", "false", "Whether all ends once the bag's last pair has come through.", YES_OR_NO),
    Argument("drain_limit", "300.0", "Seconds that the last pair may take with shutdown_after_bag."),
    Argument("web", "false", "Whether web_node shows state and pictures on a page, port 8011.", YES_OR_NO),
    Argument("respawn", "false", "Whether a node that died is started again.", YES_OR_NO),
    Argument("rviz", "false", "Whether RViz shows it all.", YES_OR_NO),
    Argument("fixed_frame", "", "RViz's fixed frame, e.g. the camera's; none: the configuration's."),
    Argument("log_level", "info", "Of all nodes.", ("debug", "info", "warn", "error", "fatal")),
)


def config(name: str) -> str:
    return str(Path(get_package_share_directory(PACKAGE)) / "config" / name)


def check(given: dict[str, str]) -> None:
    """Refuse, in one line, a file or bag that is not there: launch itself would start nodes on other values."""
    if path := given["params_file"]:
        try:
            if not read_parameter_file(path, (*STAGES, COMPOSED, ODOMETRY, MODEL)):
                raise ValueError("no parameter in it is for a node of this graph")
        except (OSError, ValueError) as error:
            reason = " ".join(str(getattr(error, "strerror", None) or error).split())
            raise RuntimeError(f"params_file: expected a ROS parameter file, got {path}: {reason}") from error
    if given["bag"] and not Path(given["bag"]).exists():
        raise RuntimeError(f"bag: expected a rosbag2 folder or .mcap file, got {given['bag']}: no such file")


def overrides(text: str) -> dict[str, Any]:
    try:
        values = strict_yaml.load(text) or {}
    except strict_yaml.YamlError:
        values = None
    if not isinstance(values, dict):
        raise RuntimeError(f"overrides: expected a YAML mapping, e.g. '{{max_disparity: 63}}', got {text!r}")
    return values


def parameters(given: dict[str, str]) -> list[Any]:
    """Parameter files and values, later ones win: defaults or file, preset, single ones."""
    values = overrides(given["overrides"])
    if given["effort"]:
        values["effort"] = given["effort"]
    values["use_sim_time"] = given["use_sim_time"] == "true" or (given["use_sim_time"] == "auto" and bool(given["bag"]))
    values["autostart"] = given["autostart"] == "true"
    preset = [] if given["preset"] == "none" else [config(f"{given['preset']}.yaml")]
    return [given["params_file"] or config("default.yaml"), *preset, values]


def remappings(given: dict[str, str]) -> list[tuple[str, str]]:
    """Where the cameras' topics really are."""
    rules = []
    for side in ("left", "right"):
        told = given[f"{side}_image"]
        image = told.removesuffix(next((end for end in TRANSPORTS if told.endswith(end)), ""))
        rules += [(f"{side}/image_raw{end}", image + end) for end in ("", *TRANSPORTS)]
        rules += [(f"{side}/camera_info", given[f"{side}_camera_info"])]
    return [(ours, theirs) for ours, theirs in rules if ours != theirs]


def player(given: dict[str, str], common: dict[str, Any]) -> Node:
    """The bag player, which has the topics of the bag."""
    ends = given["shutdown_after_bag"] == "true"
    waiting = ["--wait-for-subscribers", "--wait-limit", given["wait_limit"]]
    loop = ["--loop"] if given["loop"] == "true" else []
    drain = ["--drain-limit", given["drain_limit"]] if ends else []
    return Node(
        executable=PLAYER,
        name=PLAYER,
        arguments=[given["bag"], "--rate", given["rate"], *waiting, *loop, *drain],
        on_exit=when_player_ends(ends),
        **common,
    )


def when_player_ends(everything_ends: bool) -> Callable[[Any, LaunchContext], Any]:
    def handle(event: Any, context: LaunchContext) -> Any:
        if event.returncode and not context.is_shutdown:
            raise RuntimeError(f"the bag could not be played: {PLAYER} ended with exit code {event.returncode}")
        return Shutdown(reason="the bag has ended") if everything_ends else None

    return handle


def when_stage_ends(event: Any, context: LaunchContext) -> None:
    """End everything where a node refuses its parameters: half a graph, or the same again and again, helps nobody."""
    if event.returncode == REFUSED and not context.is_shutdown:
        raise RuntimeError(f"{event.process_name}: the node refused its parameters or arguments, see above")


def rviz(given: dict[str, str]) -> Node:
    frame = ["-f", given["fixed_frame"]] if given["fixed_frame"] else []
    moved = dict(remappings(given))
    return Node(
        package="rviz2",
        executable="rviz2",
        namespace=given["namespace"],
        arguments=["-d", config("rviz/uw_recon.rviz"), *frame],
        parameters=[{"use_sim_time": parameters(given)[-1]["use_sim_time"]}],
        remappings=[(f"/{topic}", moved.get(topic, topic)) for topic in SHOWN],
        output="screen",
    )


def chosen(given: dict[str, str]) -> tuple[str, ...]:
    stages = (COMPOSED,) if given["composed"] == "true" else STAGES
    model = given["model"] == "true"
    odometry = model or given["odometry"] == "true"
    return (*stages, *([ODOMETRY] if odometry else []), *([MODEL] if model else []))


def start(context: LaunchContext) -> list[Node]:
    given = {argument.name: context.launch_configurations[argument.name] for argument in ARGUMENTS}
    check(given)
    common = {
        "package": PACKAGE,
        "namespace": given["namespace"],
        "ros_arguments": ["--log-level", given["log_level"]],
        "output": "screen",
    }
    nodes = [
        Node(
            executable=stage,
            name=stage,
            parameters=parameters(given),
            remappings=remappings(given),
            respawn=given["respawn"] == "true",
            respawn_delay=1.0,
            on_exit=when_stage_ends,
            **common,
        )
        for stage in chosen(given)
    ]
    if given["bag"]:
        nodes.append(player(given, common))
    if given["web"] == "true":
        nodes.append(Node(executable=WEB, name=WEB, respawn=True, respawn_delay=1.0, **common))
    if given["rviz"] == "true":
        nodes.append(rviz(given))
    return nodes


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([*(argument.declare() for argument in ARGUMENTS), OpaqueFunction(function=start)])
