"""Every executable alone: starting, refusing, ending."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from typing import Any

import pytest
from helpers.process_watch import mapped_segments
from helpers.ros_bench import banded_pair
from sensor_msgs.msg import CompressedImage, Image

from uw_recon_ros.bags.writer import BagWriter

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
STAGE_NODES = ["preprocess_node", "rectify_node", "disparity_node", "point_cloud_node", "pipeline_node"]
STAGE_NODES += ["odometry_node", "model_node", "calibrate_node"]
SECOND = 1_000_000_000


def lines(executable: Any) -> list[str]:
    return [line for line in executable.output.splitlines() if line.strip()]


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    left, right = banded_pair()
    with BagWriter(tmp_path / "bag") as writer:
        for frame in range(40):
            for side, image in (("left", left), ("right", right)):
                writer.image(f"/{side}/image_raw", image, time_ns=frame * SECOND // 10, frame_id=side)
    return tmp_path / "bag"


@pytest.mark.parametrize("name", [*STAGE_NODES, "bag_player_node", "web_node"])
def test_help(graph: Any, name: str) -> None:
    helper = graph.start(name, "--help")
    assert helper.wait() == 0
    assert name in helper.output


@pytest.mark.parametrize("name", [*STAGE_NODES, "bag_player_node", "web_node"])
def test_wrong_usage(graph: Any, name: str) -> None:
    wrong = graph.start(name, "--no-such-option")
    assert wrong.wait() == 2
    assert "Traceback" not in wrong.output


@pytest.mark.parametrize("name", STAGE_NODES)
def test_a_refused_parameter_is_one_line_and_exit_code_2(graph: Any, name: str) -> None:
    refused = graph.start(name, "--ros-args", "-p", "pair_tolerance_ms:=-1.0")
    assert refused.wait() == 2
    assert lines(refused) == ["error: pair_tolerance_ms: expected a float in [0, 1000] ms, got -1.0"]


@pytest.mark.parametrize(
    "text", ["preprocess_node: [\n", "# A page\n\n- of text: [", None], ids=["cut", "page", "missing"]
)
@pytest.mark.parametrize("name", ["preprocess_node", "bag_player_node"])
def test_a_parameter_file_that_is_none_is_one_line(graph: Any, tmp_path: Path, name: str, text: str | None) -> None:
    """And no node on defaults that nobody asked for."""
    if text is not None:
        (tmp_path / "params.yaml").write_text(text)
    refused = graph.start(name, "--ros-args", "--params-file", tmp_path / "params.yaml")
    assert refused.wait() == 2
    (line,) = lines(refused)
    assert line.startswith("error: ")
    assert str(tmp_path / "params.yaml") in line
    assert ".c:" not in line  # no source lines of a library


def test_a_file_for_all_nodes_and_a_misspelt_name(graph: Any, tmp_path: Path) -> None:
    (tmp_path / "params.yaml").write_text(
        "/**:\n  ros__parameters:\n    diffusion_iterations: 2\n    lock_frames: 3\n    homomorfic_cutoff: 0.1\n"
    )
    node = graph.start("preprocess_node", "--ros-args", "--params-file", tmp_path / "params.yaml")
    graph.ready("preprocess_node")
    graph.spin_until(lambda: "homomorfic_cutoff" in node.output)
    assert "lock_frames" not in node.output


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
def test_the_player_ends_well_and_says_what_it_sent(graph: Any, bag: Path, number: int) -> None:
    player = graph.start("bag_player_node", bag, "--loop")
    heard = graph.bench.listen(Image, "left/image_raw")
    graph.spin_until(lambda: heard)
    player.signal(number)
    assert player.wait() == 0
    assert "Traceback" not in player.output
    assert lines(player)[-1].startswith("sent ")


def test_the_player_plays_to_the_end(graph: Any, bag: Path) -> None:
    heard = graph.bench.listen(Image, "right/image_raw")
    player = graph.start("bag_player_node", bag, "--rate", "10", "--wait-for", "/right/image_raw")
    graph.spin_until(lambda: len(heard) == 40)
    assert player.wait() == 0
    assert "sent 80 messages" in player.output
    assert "/left/image_raw 40, /right/image_raw 40" in player.output


def test_the_player_names_a_bag_that_is_none(graph: Any, tmp_path: Path) -> None:
    (tmp_path / "rubbish.mcap").write_bytes(b"not a bag at all")
    for path in (tmp_path / "nothing", tmp_path / "rubbish.mcap"):
        player = graph.start("bag_player_node", path)
        assert player.wait() == 1
        (line,) = lines(player)
        assert line.startswith(f"error: {path}")


def test_a_bag_cut_short_is_played_as_far_as_it_goes(graph: Any, bag: Path, tmp_path: Path) -> None:
    (whole,) = bag.glob("*.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 6 // 10])
    player = graph.start("bag_player_node", cut, "--rate", "20")
    assert player.wait() == 0
    assert "Traceback" not in player.output
    assert any(line.startswith("sent ") for line in lines(player))


def test_another_type_on_a_topic_is_named(graph: Any) -> None:
    node = graph.start("preprocess_node", "--ros-args", "-p", "stall_warning_s:=0.3")
    graph.bench.listen(Image, "left/image_enhanced")
    graph.bench.talk(CompressedImage, "left/image_raw")
    graph.spin_until(lambda: "expected sensor_msgs/msg/Image" in node.output)
    assert "outsider publishes sensor_msgs/msg/CompressedImage" in node.output


def test_nothing_is_left_in_shared_memory(graph: Any) -> None:
    before = set(os.listdir("/dev/shm"))
    node = graph.start("preprocess_node")
    graph.ready("preprocess_node")
    own = {name for name in mapped_segments(node.process.pid) - before if "port" not in name}
    assert max(os.stat(f"/dev/shm/{name}").st_size for name in own) >= 4 << 20  # the profile has taken effect
    node.signal(signal.SIGINT)
    assert node.wait() == 0
    assert not own & set(os.listdir("/dev/shm"))
