"""What makes up one piece of work."""

from __future__ import annotations

from collections import Counter
from typing import Any

import pytest

from uw_recon_ros.ros.diagnostics import NO_PARTNER
from uw_recon_ros.ros.message_groups import Assembler


class Bench:
    def __init__(self, streams: list[str], latest: list[str], tolerance_ns: int = 0) -> None:
        self.groups: list[dict[str, Any]] = []
        self.drops: Counter[str] = Counter()
        self.assembler = Assembler(self.groups.append, lambda reason, n: self.drops.update({reason: n}))
        self.assembler.tolerance_ns = tolerance_ns
        self.assembler.expect(streams, latest)

    def push(self, *items: tuple[str, int]) -> None:
        for name, stamp in items:
            self.assembler.push(name, stamp, f"{name}{stamp}")


def test_partners_make_a_group() -> None:
    bench = Bench(["left", "right"], [])
    bench.push(("left", 1), ("right", 1), ("right", 2), ("left", 2))
    assert bench.groups == [{"left": f"left{t}", "right": f"right{t}"} for t in (1, 2)]
    assert not bench.drops


def test_tolerance() -> None:
    exact, lenient = Bench(["left", "right"], []), Bench(["left", "right"], [], tolerance_ns=5)
    for bench in (exact, lenient):
        bench.push(("left", 10), ("right", 15))
    assert (len(exact.groups), len(lenient.groups)) == (0, 1)
    assert exact.drops[NO_PARTNER] == 1


def test_the_latest_calibration_goes_along() -> None:
    bench = Bench(["left"], ["info"])
    bench.assembler.set_latest("info", "old")
    bench.assembler.set_latest("info", "new")
    bench.push(("left", 1))
    assert bench.groups == [{"left": "left1", "info": "new"}]


def test_a_group_waits_for_a_calibration_that_will_come() -> None:
    bench = Bench(["left"], ["info"])
    bench.push(("left", 1))
    assert bench.groups == []
    assert bench.assembler.awaited == {"info"}
    bench.assembler.set_latest("info", "first")
    assert bench.groups == [{"left": "left1", "info": "first"}]


def test_of_those_that_wait_the_newest_wins_and_the_rest_are_counted() -> None:
    bench = Bench(["left"], ["info"])
    bench.push(("left", 1), ("left", 2), ("left", 3))
    bench.assembler.set_latest("info", "first")
    assert bench.groups == [{"left": "left3", "info": "first"}]
    assert bench.drops == {"no info yet": 2}


def test_a_group_goes_on_when_the_publisher_it_waits_for_is_gone() -> None:
    bench = Bench(["left"], ["info"])
    bench.push(("left", 1))
    bench.assembler.expect(["left"], [])
    assert bench.groups == [{"left": "left1"}]


def test_what_waits_is_kept_when_another_stream_joins_or_leaves() -> None:
    bench = Bench(["left", "right"], [])
    bench.push(("left", 1))
    bench.assembler.expect(["left", "right", "matching"], ["info"])
    bench.push(("right", 1), ("matching", 1))
    assert bench.groups == []  # waits for the info
    bench.assembler.set_latest("info", "first")
    whole = {"left": "left1", "right": "right1", "matching": "matching1", "info": "first"}
    assert bench.groups == [whole]
    bench.push(("left", 2), ("right", 2))
    bench.assembler.expect(["left", "right"], ["info"])
    assert bench.groups == [whole, {"left": "left2", "right": "right2", "info": "first"}]
    assert not bench.drops


def test_expecting_the_same_again_forgets_nothing() -> None:
    bench = Bench(["left", "right"], [])
    bench.push(("left", 1))
    bench.assembler.expect(["left", "right"], [])
    bench.push(("right", 1))
    assert len(bench.groups) == 1


def test_a_changed_tolerance_takes_effect() -> None:
    bench = Bench(["left", "right"], [])
    bench.assembler.tolerance_ns = 5
    bench.assembler.expect(["left", "right"], [])
    bench.push(("left", 1), ("right", 4))
    assert len(bench.groups) == 1


def test_messages_of_an_input_not_expected_are_ignored() -> None:
    bench = Bench(["left"], [])
    bench.push(("status", 1), ("left", 1))
    assert bench.groups == [{"left": "left1"}]


@pytest.mark.parametrize(("memory", "kept"), [(0, 16), (100 * 50, 50)])
def test_what_waits_is_bounded_by_memory(memory: int, kept: int) -> None:
    bench = Bench(["left", "disparity"], [])
    bench.assembler.memory_bytes = memory
    for stamp in range(200):
        bench.assembler.push("left", stamp, stamp, 100)
    assert bench.drops[NO_PARTNER] == 200 - kept
    bench.push(("disparity", 199 - kept + 1))
    assert len(bench.groups) == 1


def test_reset_forgets_calibrations_too() -> None:
    bench = Bench(["left"], ["info"])
    bench.assembler.set_latest("info", "old")
    bench.assembler.reset()
    bench.assembler.expect(["left"], ["info"])
    bench.push(("left", 1))
    assert bench.groups == []
