"""The integration page: its YAML is YAML, its topics, nodes and parameters are ours."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from uw_recon_ros.catalogue import ALL_PARAMS, NODES
from uw_recon_ros.params import read_parameter_file
from uw_recon_ros.pipeline import PipelineParams

PAGE = (Path(__file__).parent.parent / "docs" / "integration.md").read_text(encoding="utf-8")
BLOCKS = [yaml.safe_load(text) for text in re.findall(r"```yaml\n(.*?)```", PAGE, re.DOTALL)]


def our_topics() -> set[str]:
    pytest.importorskip("rclpy")
    from uw_recon_ros.nodes.pipeline_node import OUTPUTS

    return {output.topic for output in OUTPUTS}


def leaves(block: Any, name: str) -> list[Any]:
    """Values of a key, at any depth."""
    if not isinstance(block, dict):
        return []
    return [value for key, value in block.items() if key == name] + [
        found for value in block.values() for found in leaves(value, name)
    ]


def values(name: str) -> list[Any]:
    return [value for block in BLOCKS for value in leaves(block, name)]


def test_every_block_is_a_mapping() -> None:
    assert len(BLOCKS) >= 5
    assert all(isinstance(block, dict) for block in BLOCKS)


def test_topics_are_published() -> None:
    named = [topic for key in ("topic", "image_topic", "point_cloud_topic") for topic in values(key)]
    assert len(named) >= 2
    ours = our_topics()
    assert {topic.removeprefix("/") for topic in named} <= ours
    remapped = re.findall(r"-r [\w/]+:=([\w/]+)|`[\w/]+:=([\w/]+)`", PAGE)
    targets = {a or b for a, b in remapped} - {"points_again"}
    assert len(targets) >= 4
    assert targets <= ours


def test_topics_of_the_table_are_published() -> None:
    table = [line for line in PAGE.splitlines() if line.startswith("| ") and "`" in line.split("|")[2]]
    ours = our_topics()
    for topic in {name for line in table for name in re.findall(r"`([\w/*]+)`", line.split("|")[2])}:
        pattern = re.compile(topic.replace("*", r"\w+"))
        assert any(pattern.match(own) for own in ours), topic


def test_our_parameters_are_known(tmp_path: Path) -> None:
    (ours,) = [block for block in BLOCKS if "/**" in block]
    (tmp_path / "ours.yaml").write_text(yaml.safe_dump(ours))
    given = read_parameter_file(tmp_path / "ours.yaml", [*NODES])
    assert set(given) <= {spec.name for cls in ALL_PARAMS for spec in cls.specs()}
    PipelineParams.from_mapping(given)


def test_the_lifecycle_manager_knows_our_nodes() -> None:
    off = ("odometry_node", "model_node", "calibrate_node")
    assert values("node_names") == [[name for name in NODES if name not in off]]
    assert values("bond_timeout") == [0.0]


def test_heights_reach_below_zero_everywhere() -> None:
    (layer,) = values("voxel_layer")
    heights = [*leaves(layer, "min_obstacle_height"), layer["origin_z"]]
    assert len(heights) == 3
    assert max(heights) < 0
    top = layer["origin_z"] + layer["z_voxels"] * layer["z_resolution"]
    assert layer["z_voxels"] <= 16
    assert all(top >= high for high in leaves(layer, "max_obstacle_height"))


def test_words_in_backticks_that_look_like_parameters_are_some() -> None:
    """Those of ours that the text names: a renamed parameter must not live on here."""
    own = {spec.name for cls in ALL_PARAMS for spec in cls.specs()}
    for name in ("image_frame", "cloud_frame", "cloud_voxel", "cloud_max_points", "cloud_min_range", "cloud_max_range",
                 "assumed_sigma_px", "disparity_adjusted", "baseline_m", "focal_px"):  # fmt: skip
        assert name in PAGE
        assert name in own
