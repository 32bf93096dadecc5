"""Messages are paired by stamp, the same whether they come at once or one by one."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.pairing import Synchronizer, align


def test_a_lost_message_costs_one_pair_only() -> None:
    groups, consumed = align([[0, 10, 20, 30], [0, 20, 30]])
    assert groups == [(0, 0), (2, 1), (3, 2)]
    assert consumed == (4, 3)


def test_tolerance_is_inclusive() -> None:
    assert align([[0], [5]], 5)[0] == [(0, 0)]
    assert align([[0], [5]], 4)[0] == []
    with pytest.raises(ValueError, match="tolerance_ns"):
        align([[0]], -1)


STAMPS = st.lists(st.integers(0, 60), max_size=14, unique=True).map(sorted)


@settings(max_examples=80)
@given(STAMPS, STAMPS, st.integers(0, 4), st.randoms(use_true_random=False))
def test_arrival_order_does_not_matter(left: list[int], right: list[int], tolerance: int, random: object) -> None:
    expected = [(left[i], right[j]) for i, j in align([left, right], tolerance)[0]]
    sync: Synchronizer[int] = Synchronizer(2, tolerance, depth=100)
    queues, got = [list(left), list(right)], []
    while any(queues):
        side = random.choice([i for i in (0, 1) if queues[i]])  # type: ignore[attr-defined]
        stamp = queues[side].pop(0)
        got += sync.push(side, stamp, stamp)
    assert got == expected
    assert all(abs(a - b) <= tolerance for a, b in got)


@settings(max_examples=60)
@given(STAMPS, STAMPS)
def test_exact_pairs_are_the_common_stamps(left: list[int], right: list[int]) -> None:
    assert [left[i] for i, _ in align([left, right])[0]] == sorted(set(left) & set(right))


def test_time_set_back_begins_another_round() -> None:
    sync: Synchronizer[str] = Synchronizer(2)
    assert sync.push(0, 100, "l100") == []
    assert sync.push(0, 0, "l0") == []
    assert sync.push(1, 0, "r0") == [("l0", "r0")]
    assert sync.dropped == 1


def test_what_comes_after_the_jump_back_finds_its_partner_from_before() -> None:
    """A stage that takes longer than a round."""
    sync: Synchronizer[str] = Synchronizer(3)
    for name in ("3 first", "1 second", "4 second", "2 third"):
        for stream in (0, 1):
            assert sync.push(stream, int(name[0]), name) == []
    assert sync.push(2, 3, "late") == [("3 first", "3 first", "late")]
    assert sync.push(2, 4, "late") == [("4 second", "4 second", "late")]
    assert sync.push(2, 2, "in time") == [("2 third", "2 third", "in time")]


@settings(max_examples=40, derandomize=True, deadline=None)
@given(st.integers(2, 8), st.integers(2, 4), st.integers(1, 60), st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_whatever_the_load_something_right_comes_out_of_a_looped_bag(
    frames: int, streams: int, latency: int, takes: int, seed: int
) -> None:
    """The last stream comes `latency` frames after the others, and only every `takes` frames: a slow stage.

    The load changes all the time: frames are lost in front of both.
    """
    random = Random(seed)
    sync: Synchronizer[int] = Synchronizer(streams, depth=16)
    under_way: list[tuple[int, int]] = []
    got: list[tuple[int, ...]] = []
    sent = 0
    for tick in range(20 * max(latency, frames, takes)):
        if random.random() < 0.3:
            continue
        stamp = tick % frames
        for stream in range(streams - 1):
            got += sync.push(stream, stamp, stamp)
        if not under_way or tick >= under_way[-1][0] - latency + takes:
            under_way.append((tick + latency, stamp))
        while under_way and under_way[0][0] <= tick:
            sent += 1
            got += sync.push(streams - 1, under_way[0][1], under_way[0][1])
            under_way.pop(0)
    assert all(len(set(group)) == 1 for group in got)  # nothing but equal stamps
    assert len(got) > 0.4 * sent > 0


def test_what_is_kept_aside_is_bounded_and_fades() -> None:
    sync: Synchronizer[int] = Synchronizer(2, depth=8)
    for round_ in range(50):
        for stamp in range(5, 0, -1):
            sync.push(0, stamp + 10 * round_, stamp)
    assert sum(map(len, sync._earlier)) + sum(map(len, sync.waiting)) <= 8
    for stamp in range(1000, 1010):
        for stream in (0, 1):
            sync.push(stream, stamp, stamp)
    assert not any(sync._earlier)
    assert not any(sync.waiting)


def test_one_camera_alone_is_bounded_and_counted() -> None:
    sync: Synchronizer[int] = Synchronizer(2, depth=4)
    for stamp in range(10):
        sync.push(0, stamp, stamp)
    assert sync.dropped == 6
    assert sync.push(1, 9, 9) == [(9, 9)]
    assert sync.dropped == 9


def test_what_is_kept_aside_is_replaced_by_its_like_and_counted():
    s = Synchronizer(2)
    for stamp, item in ((100, "a"), (50, "b"), (100, "c"), (60, "d")):  # set back twice: c takes the place of a
        s.push(0, stamp, item)
    assert s.dropped == 1


def test_what_is_kept_aside_stays_within_the_depth():
    s = Synchronizer(3, tolerance_ns=10, depth=2)
    s.push(1, 100, "partner")
    s.push(1, 50, "next round")
    for k in range(5):  # each finds a partner aside; the third stream says nothing
        assert s.push(0, 100 + k, k) == []
    assert s.dropped == 3
