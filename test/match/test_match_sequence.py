"""Frames in a row: planes that move along, fewer moves, no memory where there must be none."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from uw_recon_ros.match.planes import matcher as module
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.planes.previous_frame import FrameBefore, move_planes
from uw_recon_ros.match.sequence import MOST_APART_NS, MatchSequence
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import DisparityMap, RectificationQuality, RectifiedPair, StereoGeometry

Image = NDArray[np.uint8]
GEOMETRY = StereoGeometry(focal_px=500.0, cx_left=0.0, cx_right=0.0, cy=0.0)
HEIGHT, WIDTH = 96, 140
SECOND = 1_000_000_000


def scene(seed: int = 0) -> NDArray[np.float32]:
    """Texture of fine and coarse grain."""
    random = np.random.RandomState(seed)
    total = np.zeros((200, 400), np.float32)
    for grain in (1.3, 4.0, 10.0):
        smooth = cv2.GaussianBlur(random.normal(0, 1, total.shape).astype(np.float32), (0, 0), grain)
        total += smooth / smooth.std()
    return np.asarray(np.clip(128 + 26 * total, 0, 255), np.float32)


def truth(u0: float, v0: float, nearer: float = 0.0) -> NDArray[np.float32]:
    """A floor that comes nearer downwards, seen through a window at (u0, v0) of it."""
    v, u = np.indices((HEIGHT, WIDTH), np.float32)
    return 6 + 0.02 * (u + u0) + 0.05 * (v + v0) + np.float32(nearer)


def sides(u0: float, v0: float, nearer: float = 0.0, seed: int = 0) -> tuple[Image, Image]:
    """Both views: the left one is the window, and the right one what that surface shows the other camera."""
    v, u = np.indices((HEIGHT, WIDTH), np.float32)
    pattern = scene(seed)
    left = cv2.remap(pattern, u + np.float32(u0 + 60), v + np.float32(v0 + 30), cv2.INTER_CUBIC)
    # the surface point that the right camera sees at x lies at u = x + d(u): solved for u, d being linear
    at = (u + truth(u0, v0, nearer) - np.float32(0.02) * u) / np.float32(0.98)
    right = cv2.remap(pattern, at + np.float32(u0 + 60), v + np.float32(v0 + 30), cv2.INTER_CUBIC)
    first, second = (np.clip(np.round(i), 0, 255).astype(np.uint8) for i in (left, right))
    return first, second


def pair(stamp_ns: int, *window: float) -> RectifiedPair:
    left, right = sides(*window)
    return RectifiedPair(left, right, left, right, GEOMETRY, RectificationQuality("given"), stamp_ns=stamp_ns)


def planes_of(disparity: NDArray[np.float32], a: float = 0.0, b: float = 0.0) -> NDArray[np.float32]:
    v, u = np.indices(disparity.shape, np.float32)
    return np.stack([np.full_like(u, a), np.full_like(u, b), disparity - a * u - b * v]).astype(np.float32)


@pytest.mark.parametrize("motion", [(0.0, 0.0), (9.0, -4.0), (-23.0, 11.0)])
@pytest.mark.parametrize("nearer", [0.0, 0.8])
def test_planes_move_with_their_surface(motion: tuple[float, float], nearer: float) -> None:
    before = FrameBefore(sides(0, 0)[0], planes_of(truth(0, 0), 0.02, 0.05))
    now = truth(*motion, nearer)
    rough = now + np.random.RandomState(1).normal(0, 0.3, now.shape).astype(np.float32)
    moved = move_planes(before, sides(*motion)[0], rough, np.ones(now.shape, bool))
    assert moved is not None
    v, u = np.indices(now.shape, np.float32)
    found = moved[0] * u + moved[1] * v + moved[2]
    known = np.isfinite(found)
    assert known.mean() > 0.6
    assert np.median(np.abs(found - now)[known]) < 0.03
    assert np.percentile(np.abs(found - now)[known], 95) < 0.3
    assert np.allclose(moved[0][known], 0.02)


def test_each_plane_goes_where_its_pixel_goes() -> None:
    v, u = np.indices((HEIGHT, WIDTH), np.float32)
    marked = planes_of(truth(0, 0))
    marked[:2] = 0.001 * u, 0.002 * v  # slopes that say which pixel they belong to
    marked[2] -= marked[0] * u + marked[1] * v
    now = truth(9, -4)
    moved = move_planes(FrameBefore(sides(0, 0)[0], marked), sides(9, -4)[0], now, np.ones(now.shape, bool))
    assert moved is not None
    inner = np.s_[20:-20, 20:-20]
    assert np.median(np.abs(moved[0] - 0.001 * (u + 9))[inner]) < 0.001
    assert np.median(np.abs(moved[1] - 0.002 * (v - 4))[inner]) < 0.002


def test_nothing_is_taken_from_a_frame_of_something_else() -> None:
    before = FrameBefore(sides(0, 0, seed=5)[0], planes_of(truth(0, 0)))
    assert move_planes(before, np.full((HEIGHT, WIDTH), 80, np.uint8), truth(0, 0), np.ones((96, 140), bool)) is None
    left, right = sides(0, 0)
    flat = FrameBefore(np.full_like(left, 80), planes_of(truth(0, 0)))
    alone, after = (graph_cut(left, right, 0, 24, before=b) for b in (None, flat))
    assert same(alone.disparity, after.disparity)


def test_tiny_frames_have_no_motion() -> None:
    small = np.zeros((20, 30), np.uint8)
    assert move_planes(FrameBefore(small, planes_of(small)), small, small, small == 0) is None


def same(one: NDArray[np.float32], other: NDArray[np.float32]) -> bool:
    return one.tobytes() == other.tobytes()


@pytest.mark.parametrize("effort", ["balanced", "quality"])
def test_a_frame_that_follows_is_as_accurate_for_fewer_planes(effort: str) -> None:
    left, right = sides(0, 0)
    first = graph_cut(left, right, 0, 24, effort=effort)
    moved_left, moved_right = sides(12, 5, 0.5)
    second = graph_cut(moved_left, moved_right, 0, 24, effort=effort, before=first.frame)
    error = np.abs(second.disparity - truth(12, 5, 0.5))
    assert np.nanmedian(error) < 0.06
    assert (error[:, 30:] < 0.5).mean() > 0.97
    schedule = module.SCHEDULES[effort]
    spent = [sum(p.planes * (1 + 2 * p.cut) for p in passes) for passes in (schedule.passes, schedule.following)]
    assert spent[1] < 0.8 * spent[0]


def test_wrong_planes_do_no_harm() -> None:
    left, right = sides(0, 0)
    wrong = FrameBefore(left, planes_of(24 - truth(0, 0)))
    error = np.abs(graph_cut(left, right, 0, 24, before=wrong).disparity - truth(0, 0))
    assert np.nanmedian(error) < 0.06
    assert (error[:, 30:] < 0.5).mean() > 0.95


MATCH = Match(MatchParams(max_disparity=24, use_previous=True))


def run(frames: list[RectifiedPair], match: Match = MATCH) -> list[DisparityMap]:
    sequence = MatchSequence()
    return [sequence(match, frame) for frame in frames]


def test_the_same_frames_give_the_same_bits_whatever_the_threads() -> None:
    frames = [pair(i * SECOND // 5 + 1, 4.0 * i, 2.0 * i) for i in range(3)]
    one, two = (run(frames, Match(replace(MATCH.params, match_threads=n))) for n in (1, 2))
    for a, b in zip(one, two, strict=True):
        assert same(a.disparity, b.disparity)
    assert same(one[0].disparity, MATCH(frames[0]).disparity)
    assert not same(one[1].disparity, MATCH(frames[1]).disparity)  # it did start from the frame before


def test_switched_off_every_frame_stands_for_itself() -> None:
    frames = [pair(i * SECOND // 5 + 1, 4.0 * i, 0.0) for i in range(2)]
    off = Match(replace(MATCH.params, use_previous=False))
    for found, frame in zip(run(frames, off), frames, strict=True):
        assert same(found.disparity, off(frame).disparity)


@pytest.mark.parametrize("stamp_ns", [SECOND, SECOND - 1, SECOND + MOST_APART_NS + 1])
def test_memory_ends_where_time_does_not_go_on(stamp_ns: int) -> None:
    later = pair(stamp_ns, 4.0, 0.0)
    assert same(run([pair(SECOND, 0.0, 0.0), later])[1].disparity, MATCH(later).disparity)


def test_memory_ends_with_another_size() -> None:
    later = pair(2 * SECOND, 4.0, 0.0)
    images = [i[:-16] for i in (later.left, later.right, later.left_matching, later.right_matching)]
    later = replace(later, left=images[0], right=images[1], left_matching=images[2], right_matching=images[3])
    assert same(run([pair(SECOND, 0.0, 0.0), later])[1].disparity, MATCH(later).disparity)


@pytest.mark.parametrize("choice", [{"method": "kz2"}, {"effort": "navigation"}])
def test_what_has_no_planes_hands_none_on(choice: dict[str, str]) -> None:
    match = Match(replace(MATCH.params, **choice))  # type: ignore[arg-type]
    frames = [pair(SECOND, 0.0, 0.0), pair(SECOND + SECOND // 2, 4.0, 0.0)]
    assert match.follow(frames[0], None)[1] is None
    assert same(run(frames, match)[1].disparity, match(frames[1]).disparity)


def test_a_change_of_effort_keeps_the_memory() -> None:
    frames = [pair(SECOND + i * SECOND // 4, 3.0 * i, 0.0) for i in range(3)]
    sequence, quick = MatchSequence(), Match(replace(MATCH.params, effort="navigation"))
    sequence(MATCH, frames[0])
    sequence(quick, frames[1])
    assert not same(sequence(MATCH, frames[2]).disparity, MATCH(frames[2]).disparity)
