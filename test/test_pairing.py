"""Messages are paired by stamp, the same whether they come at once or one by one."""

from __future__ import annotations

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


@settings(max_examples=80, derandomize=True, deadline=None)
@given(STAMPS, STAMPS, st.integers(0, 4), st.randoms(use_true_random=False))
def test_arrival_order_does_not_matter(left: list[int], right: list[int], tolerance: int, random: object) -> None:
    expected = [(left[i], right[j]) for i, j in align([left, right], tolerance)[0]]
    sync: Synchronizer[int] = Synchronizer(2, tolerance, depth=100)
    queues, got = [list(left), list(right)], []
    while any(queues):
        eye = random.choice([i for i in (0, 1) if queues[i]])  # type: ignore[attr-defined]
        stamp = queues[eye].pop(0)
        got += sync.push(eye, stamp, stamp)
    assert got == expected
    assert all(abs(a - b) <= tolerance for a, b in got)


@settings(max_examples=60, derandomize=True, deadline=None)
@given(STAMPS, STAMPS)
def test_exact_pairs_are_the_common_stamps(left: list[int], right: list[int]) -> None:
    assert [left[i] for i, _ in align([left, right])[0]] == sorted(set(left) & set(right))


def test_time_set_back_forgets_what_waits() -> None:
    sync: Synchronizer[str] = Synchronizer(2)
    assert sync.push(0, 100, "l100") == []
    assert sync.push(0, 0, "l0") == []
    assert sync.push(1, 0, "r0") == [("l0", "r0")]
    assert sync.dropped == 1


def test_one_eye_alone_is_bounded_and_counted() -> None:
    sync: Synchronizer[int] = Synchronizer(2, depth=4)
    for stamp in range(10):
        sync.push(0, stamp, stamp)
    assert sync.dropped == 6
    assert sync.push(1, 9, 9) == [(9, 9)]
    assert sync.dropped == 9
