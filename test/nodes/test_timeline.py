"""Recorded time against a wall clock that the test winds."""

from __future__ import annotations

import pytest

from uw_recon_ros.nodes.timeline import Timeline

SECOND = 1_000_000_000


def running(rate: float = 1.0) -> Timeline:
    timeline = Timeline(5 * SECOND, rate)
    timeline.resume(100.0)
    return timeline


@pytest.mark.parametrize(("rate", "due"), [(1.0, 103.0), (2.0, 101.5), (0.5, 106.0)])
def test_rate(rate: float, due: float) -> None:
    timeline = running(rate)
    assert timeline.due_s(8 * SECOND) == pytest.approx(due)
    assert timeline.now_ns(due) == 8 * SECOND


def test_it_begins_paused() -> None:
    timeline = Timeline(5 * SECOND, 1.0)
    assert timeline.paused
    assert timeline.now_ns(1234.0) == 5 * SECOND


def test_a_pause_shifts_what_follows() -> None:
    timeline = running()
    timeline.pause(101.0)
    assert timeline.now_ns(150.0) == 6 * SECOND
    timeline.resume(200.0)
    assert timeline.due_s(8 * SECOND) == pytest.approx(202.0)


def test_resuming_twice_changes_nothing() -> None:
    timeline = running()
    timeline.resume(102.0)
    assert timeline.due_s(8 * SECOND) == pytest.approx(103.0)


def test_another_round_begins_now() -> None:
    timeline = running()
    timeline.jump(5 * SECOND, 110.0)
    assert timeline.now_ns(110.0) == 5 * SECOND
    assert timeline.due_s(6 * SECOND) == pytest.approx(111.0)


def test_a_step_is_one_message_of_each_topic() -> None:
    timeline = Timeline(0, 1.0)
    assert not timeline.take_step("left", 1)
    timeline.begin_step()
    taken = [timeline.take_step(topic, stamp) for topic, stamp in (("left", 1), ("right", 1), ("left", 2))]
    assert taken == [True, True, False]
    assert timeline.now_ns(0.0) == 1
    assert not timeline.take_step("left", 2)  # over until the next
    timeline.begin_step()
    assert timeline.take_step("left", 2)


def test_resuming_ends_a_step() -> None:
    timeline = Timeline(0, 1.0)
    timeline.begin_step()
    timeline.resume(10.0)
    timeline.pause(11.0)
    assert not timeline.take_step("left", 5)


def test_a_step_begins_until_its_first_message() -> None:
    timeline = Timeline(0, 1.0)
    assert not timeline.step_begins
    timeline.begin_step()
    assert timeline.step_begins
    assert timeline.take_step("left", 1)
    assert not timeline.step_begins
