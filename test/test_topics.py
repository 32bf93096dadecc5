"""Whatever names topics elsewhere agrees with the table of topics."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

from uw_recon_ros.bags.messages import typestore
from uw_recon_ros.topics import CAMERAS, TOPICS, find_topic, published_by

ROOT = Path(__file__).parent.parent
NODES = ("preprocess_node", "rectify_node", "disparity_node", "point_cloud_node", "odometry_node", "model_node")
NODES += ("calibrate_node",)
NAMES = {topic.name for topic in TOPICS}


def test_names_are_relative_unique_and_of_real_types() -> None:
    assert len(NAMES) == len(TOPICS)
    for topic in TOPICS:
        assert re.fullmatch(r"[a-z0-9_]+(/[a-z0-9_]+)*", topic.name)
        assert topic.type in typestore().types
        assert topic.by in {CAMERAS, *NODES}
        assert re.fullmatch(r"[A-Z].*\.", topic.about)
        assert find_topic(topic.name) is topic
    assert sum(len(published_by(by)) for by in (CAMERAS, *NODES)) == len(TOPICS)


def test_readme_has_every_output_beside_its_node() -> None:
    rows = {
        line.split("|")[1].strip(" `"): line for line in (ROOT / "README.md").read_text().splitlines() if "|" in line
    }
    for node in NODES:
        cell = rows[node].replace("*/", "left/")
        for topic in published_by(node):
            short = topic.name.replace("rectified/right/", "rectified/left/")
            assert f"`{topic.name}`" in rows[node] or f"`{short}`" in cell, f"{node}: {topic.name}"


def test_launch_file_shows_topics_of_the_table() -> None:
    tree = ast.parse((ROOT / "launch" / "uw_recon.launch.py").read_text())
    shown = next(n.value for n in tree.body if isinstance(n, ast.Assign) and ast.unparse(n.targets[0]) == "SHOWN")
    names = eval(compile(ast.Expression(shown), "SHOWN", "eval"))
    assert set(names) <= NAMES


#: Came after the contract was written; they take nothing away from it.
NEWER = {"obstacles", "range", "odometry", "path", "model/submap", "model/points", "model/surface"}
NEWER |= {"calibration/coverage", "disparity/effort"}
NEWER |= {f"{side}/image_raw/{end}" for side in ("left", "right") for end in ("ffmpeg", "foxglove")}


def test_interface_file_names_them() -> None:
    """The contract with programs outside."""
    contract = ROOT.parent / "shared" / "design" / "interface.md"
    if not contract.is_file():
        pytest.skip(f"{contract} is not there")
    text = contract.read_text()
    for topic in TOPICS:
        if topic.name.endswith("/compressed") or "image_matching" in topic.name or topic.name in NEWER:
            continue
        assert f"`{topic.name}`" in text, topic.name
