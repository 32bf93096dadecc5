"""What Dockerfile and pixi.toml say agrees with the package; neither can be built where tests run."""

from __future__ import annotations

import json
import re
import sys
from importlib.metadata import requires
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def test_pixi_asks_for_what_the_package_needs() -> None:
    if sys.version_info < (3, 11):
        pytest.skip("tomllib comes with Python 3.11")
    import tomllib

    asked = tomllib.loads((ROOT / "pixi.toml").read_text())
    wanted = asked["dependencies"] | asked["pypi-dependencies"]
    for line in requires("uw_recon_ros") or []:
        if "extra ==" in line:
            continue
        name, bound = re.match(r"([A-Za-z0-9_-]+)\s*(.*)", line).groups()  # type: ignore[union-attr]
        assert name.lower() in wanted, name
        assert name == "setuptools" or wanted[name.lower()] == (bound or "*"), name


def test_the_labels_of_the_image_are_json() -> None:
    text = (ROOT / "Dockerfile").read_text()
    for label in ("authors", "company", "links", "permissions"):
        json.loads(re.search(rf"{label}='(.*)'", text)[1])  # type: ignore[index]
    version = re.search(r"<version>(.*?)</version>", (ROOT / "package.xml").read_text())
    assert version
    assert f'version="{version[1]}"' in text


def test_the_image_may_be_of_any_ros_2_that_is_named() -> None:
    text = (ROOT / "Dockerfile").read_text()
    assert "FROM ros:${ROS_DISTRO}-ros-base" in text
    assert not re.search(r"ros-(jazzy|kilted|lyrical)-", text)
    assert "web:=true" in text


def test_the_image_starts_a_launch_file_that_is_there() -> None:
    for name in ("Dockerfile", "pixi.toml"):
        found = re.search(r"[a-z_]+\.launch\.py", (ROOT / name).read_text())
        assert found
        assert (ROOT / "launch" / found[0]).is_file()
