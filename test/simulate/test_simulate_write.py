"""A dive as a bag: topics, frames, stamps, truth; and the sample bags of the repository."""

from __future__ import annotations

import dataclasses
import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from uw_recon_ros.bags import open_bag
from uw_recon_ros.bags.messages import image_from_message, stamp_ns
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.errors import BagError
from uw_recon_ros.recordings.info import bag_info
from uw_recon_ros.rigid import quaternion
from uw_recon_ros.simulate import Dive, SimulateParams, simulate
from uw_recon_ros.simulate.rig import rotation_about
from uw_recon_ros.simulate.write import rounded

BAGS = Path(__file__).parents[2] / "bags"
TINY = SimulateParams(width=80, height=60, frames=3, rate_hz=2.0)
TRUTH = {"/truth/depth", "/truth/status", "/truth/pose", "/truth/left/camera_info", "/truth/right/camera_info"}
SIDES = {"/left/image_raw", "/right/image_raw"}
INFOS = {"/left/camera_info", "/right/camera_info"}


def decoded(path: Path) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    with open_bag(path) as bag:
        for raw, message in bag.messages():
            found.setdefault(raw.topic, []).append(message)
        assert bag.damage == []
    return found


def test_topics_frames_stamps_and_content(tmp_path: Path) -> None:
    assert simulate(tmp_path / "dive", TINY) == 3
    found = decoded(tmp_path / "dive")
    assert set(found) == SIDES | INFOS | TRUTH
    dive = Dive(TINY)
    for index in range(3):
        frame = dive.frame(index)
        for topic, messages in found.items():
            assert stamp_ns(messages[index]) == frame.stamp_ns
            expected = (
                "world" if "pose" in topic else f"simulated_{'right' if 'right' in topic else 'left'}_optical_frame"
            )
            assert messages[index].header.frame_id == expected
        assert np.array_equal(image_from_message(found["/left/image_raw"][index]), frame.left)
        assert np.array_equal(image_from_message(found["/right/image_raw"][index]), frame.right)
        assert np.array_equal(image_from_message(found["/truth/status"][index]), frame.status)
        place = found["/truth/pose"][index].pose.position
        assert (place.x, place.y, place.z) == pytest.approx(tuple(frame.pose.position))
    stamps = [stamp_ns(message) for message in found["/left/image_raw"]]
    assert np.diff(stamps).tolist() == [500_000_000, 500_000_000]
    right = camera_from_info(found["/right/camera_info"][0])
    assert np.array_equal(right.p, dive.calibration.right.p)
    assert np.array_equal(right.d, dive.calibration.right.d)
    with open_bag(tmp_path / "dive") as bag:
        for (stamp, depth), index in zip(bag.depth_images(), range(3), strict=True):
            assert stamp == dive.stamp_ns(index)
            assert np.nanmax(np.abs(depth - dive.frame(index).depth)) <= 0.5 / 4096


def test_an_uncalibrated_bag_tells_the_truth_apart(tmp_path: Path) -> None:
    simulate(tmp_path / "dive", dataclasses.replace(TINY, calibrated=False, frames=1))
    assert set(decoded(tmp_path / "dive")) == SIDES | TRUTH
    info = bag_info(tmp_path / "dive")
    assert (info.calibration, info.reconstructable) == ("none", True)


def test_a_vertical_rig_has_its_baseline_in_p7(tmp_path: Path) -> None:
    simulate(tmp_path / "dive", dataclasses.replace(TINY, axis="vertical", frames=1))
    p = decoded(tmp_path / "dive")["/right/camera_info"][0].p
    assert p[3] == 0.0
    assert p[7] == pytest.approx(-p[5] * 0.12, rel=0.03)


def test_the_same_parameters_give_the_same_file(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        simulate(tmp_path / name / "dive.mcap", dataclasses.replace(TINY, frames=2))
    assert (tmp_path / "a" / "dive.mcap").read_bytes() == (tmp_path / "b" / "dive.mcap").read_bytes()


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    one = dataclasses.replace(TINY, frames=1)
    simulate(tmp_path / "dive", one)
    with pytest.raises(BagError, match="already exists"):
        simulate(tmp_path / "dive", one)
    simulate(tmp_path / "dive", dataclasses.replace(one, seed=9), overwrite=True)


def test_progress_sees_every_frame(tmp_path: Path) -> None:
    seen: list[int] = []

    def follow(frames: range) -> Any:
        for index in frames:
            seen.append(index)
            yield index

    simulate(tmp_path / "dive", dataclasses.replace(TINY, frames=2), progress=follow)
    assert seen == [0, 1]


def test_depth_is_rounded_and_holes_stay() -> None:
    depth = np.float32([[1.23456, np.nan, 0.5]])
    assert rounded(depth)[0] == pytest.approx([round(1.23456 * 4096) / 4096, np.nan, 0.5], nan_ok=True)


def test_quaternion_turns_as_the_matrix_does() -> None:
    for vector in [np.zeros(3), *np.random.default_rng(1).uniform(-3, 3, (20, 3))]:
        angle = np.linalg.norm(vector)
        x, y, z, w = quaternion(rotation_about(vector))
        expected = np.array([*(np.sin(angle / 2) * vector / max(angle, 1e-12)), np.cos(angle / 2)])
        expected *= np.sign(expected[3]) or 1.0
        assert (x, y, z, w) == pytest.approx(tuple(expected), abs=1e-9)


def sample_maker() -> ModuleType:
    spec = importlib.util.spec_from_file_location("make_bags", BAGS / "make_bags.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["make_bags"] = module
    spec.loader.exec_module(module)
    return module


def test_sample_bags_are_small() -> None:
    files = [path for path in BAGS.rglob("*") if path.is_file() and "__pycache__" not in path.parts]
    assert sum(path.stat().st_size for path in files) < 5_000_000


@pytest.mark.parametrize("name", ["amphora", "amphora_vertical"])
def test_sample_bags_are_what_make_bags_makes(name: str) -> None:
    """Grey values may differ by one here and there: exp and log differ in their last bit between machines."""
    params = sample_maker().SAMPLES[name]
    found, dive = decoded(BAGS / name), Dive(params)
    assert [len(messages) for messages in found.values()] == [params.frames] * 9
    frames = [dive.frame(index) for index in range(params.frames)]
    for index, frame in enumerate(frames):
        for topic, image in (("/left/image_raw", frame.left), ("/right/image_raw", frame.right)):
            apart = np.abs(image_from_message(found[topic][index]).astype(int) - image)
            assert (apart > 1).mean() < 1e-4
            assert (apart > 0).mean() < 1e-2
        assert (image_from_message(found["/truth/status"][index]) != frame.status).mean() < 1e-4
        assert stamp_ns(found["/truth/depth"][index]) == frame.stamp_ns
    with open_bag(BAGS / name) as bag:
        for frame, (_, depth) in zip(frames, bag.depth_images(), strict=True):
            assert np.nanpercentile(np.abs(depth - frame.depth), 99.9) <= 1.5 / 4096
    info = bag_info(BAGS / name)
    assert info.reconstructable
    assert info.calibration == "metric"
