"""The calibrating node: pairs from topics, what they cover, a calibration by service and at the end."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.calibration_scenes import BOARD, NEAR_M, rig_of
from helpers.ros_bench import Bench, array, meet, mono
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger

from uw_recon_ros.files.calibrations import read_calibration
from uw_recon_ros.nodes.calibrate_node import CalibrateNode
from uw_recon_ros.ros.parameters import ParameterError
from uw_recon_ros.simulate.boards import Shot, hold_boards, photograph

SECOND = 1_000_000_000
TOLD = {"board_columns": 9, "board_rows": 6, "board_square_mm": 40.0, "board_medium": "water"}


@cache
def shots() -> list[Shot]:
    rig = rig_of(1)
    return list(photograph(rig, BOARD, hold_boards(rig, BOARD, 6, 1, distances_m=NEAR_M), 1))


@pytest.fixture
def show(bench: Bench) -> Callable[[Any, int], None]:
    """Shows shots to a node, each when it has done with the one before."""
    sides = [bench.talk(Image, f"{side}/image_raw") for side in ("left", "right")]
    stamps = iter(range(SECOND, 1000 * SECOND, SECOND))

    def to(node: Any, *numbers: int) -> None:
        bench.connected(*sides)
        for number in numbers:
            stamp, looked = next(stamps), node.looked
            for publisher, image in zip(sides, (shots()[number].left, shots()[number].right), strict=True):
                publisher.publish(mono(image, stamp))
            bench.spin_until(lambda looked=looked: node.looked > looked)

    return to


def values(said: list[DiagnosticArray]) -> list[Any]:
    return list(said[-1].status[0].values) if said else []


def ask(bench: Bench) -> Trigger.Response:
    client = bench.outsider.create_client(Trigger, "/calibrate_node/calibrate")
    meet(bench.outsider, "/calibrate_node", bench.spin_until)
    bench.spin_until(client.service_is_ready)
    answer = client.call_async(Trigger.Request())
    bench.spin_until(answer.done)
    return answer.result()


def test_pairs_are_gathered_shown_and_solved(bench: Bench, show: Any, tmp_path: Path) -> None:
    node = bench.start(CalibrateNode, calibration_dir=str(tmp_path / "out"), **TOLD)
    pictures, said = bench.listen(Image, "calibration/coverage"), bench.listen(DiagnosticArray, "/diagnostics")
    show(node, 0, 0, 1)
    assert not ask(bench).success, "two pairs are too few"
    show(node, 2, 3, 4, 5)
    bench.spin_until(lambda: len(pictures) == 7)
    picture = array(pictures[-1])
    assert picture.shape == (480 + 28, 1280, 3)
    assert (np.abs(picture.astype(int) - [255, 220, 60]).sum(axis=2) < 30).sum() > 500, "the board's points are drawn"

    def told() -> dict[str, str]:
        return {pair.key: pair.value for pair in values(said)}

    bench.spin_until(lambda: told().get("pairs") == "6")
    assert 0.3 < float(told()["coverage_left"]) <= 1
    assert ask(bench).success
    bench.spin_until(
        lambda: (tmp_path / "out" / "index.html").exists() and "reprojection" in told().get("calibration", "")
    )
    found = read_calibration(tmp_path / "out" / "calibration.json")
    assert found.origin.medium == "water"
    assert found.right.p[0, 3] == pytest.approx(rig_of(1).calibration.right.p[0, 3], rel=0.05)


def test_what_was_not_written_is_written_at_the_end(bench: Bench, show: Any, tmp_path: Path) -> None:
    node = bench.start(CalibrateNode, calibration_dir=str(tmp_path / "out"), board_square_mm=40.0)
    show(node, 0, 1, 2, 3)
    node.stop()
    told = json.loads((tmp_path / "out" / "calibration.json").read_text())
    assert len(told["pairs"]) == 4
    assert {told["board"]["columns"], told["board"]["rows"]} == {6, 9}, "found by the node"


def test_files_of_others_are_not_replaced(bench: Bench, show: Any, tmp_path: Path) -> None:
    said = bench.listen(DiagnosticArray, "/diagnostics")
    node = bench.start(CalibrateNode, calibration_dir=str(tmp_path), **TOLD)
    (tmp_path / "mine.txt").write_text("mine")  # after the start
    show(node, 0, 1, 2, 3)
    assert ask(bench).success
    bench.spin_until(lambda: any("empty or new folder" in pair.value for pair in values(said)))
    node.stop()
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_folder_that_is_taken_is_refused_at_once(bench: Bench, tmp_path: Path) -> None:
    """Not after half an hour in the pool."""
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(ParameterError, match="calibration_overwrite"):
        bench.start(CalibrateNode, calibration_dir=str(tmp_path), **TOLD)
    bench.start(CalibrateNode, calibration_dir=str(tmp_path), calibration_overwrite=True, **TOLD)
