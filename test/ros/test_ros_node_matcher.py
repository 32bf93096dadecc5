"""The matcher in a node: frame after frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.match.sequence import MatchSequence
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.node_params import RateParams
from uw_recon_ros.ros.node_matcher import NodeMatcher
from uw_recon_ros.types import RectificationQuality, RectifiedPair, StereoGeometry

GEOMETRY = StereoGeometry(focal_px=500.0, cx_left=0.0, cx_right=0.0, cy=0.0)
PARAMS = MatchParams(max_disparity=12, use_previous=True)
PATTERN = np.random.RandomState(0).randint(0, 256, (30, 60), np.uint8).repeat(2, axis=0).repeat(2, axis=1)


def pairs() -> list[RectifiedPair]:
    frames = []
    for number in range(3):
        left, right = (np.ascontiguousarray(PATTERN[:, u + 3 * number : u + 3 * number + 90]) for u in (0, 5))
        quality = RectificationQuality("given")
        frames.append(RectifiedPair(left, right, left, right, GEOMETRY, quality, stamp_ns=1 + number * 200_000_000))
    return frames


def test_node_starts_from_the_frame_before_where_asked_to() -> None:
    node, sequence = NodeMatcher(PARAMS, RateParams()), MatchSequence()
    for pair in pairs():
        assert node(pair).disparity.tobytes() == sequence(Match(PARAMS), pair).disparity.tobytes()


def test_by_default_a_node_gives_what_the_stage_gives() -> None:
    params = replace(PARAMS, use_previous=MatchParams().use_previous)
    node, stage = NodeMatcher(params, RateParams()), Match(params)
    for pair in pairs():
        assert node(pair).disparity.tobytes() == stage(pair).disparity.tobytes()


def test_where_an_image_shows_no_limits_those_of_the_pair_before_hold() -> None:
    node = NodeMatcher(MatchParams(), RateParams())
    seen = pairs()[0]
    gray = np.full_like(seen.left_matching, 90)
    blank = replace(seen, left=gray, right=gray, left_matching=gray, right_matching=gray, stamp_ns=seen.stamp_ns + 1)
    with pytest.raises(EstimationError) as error:
        node(blank)
    assert error.value.code == Code.MATCH_NO_RANGE
    known = node(seen)
    unknown = node(blank)
    assert (unknown.min_disparity, unknown.max_disparity) == (known.min_disparity, known.max_disparity)
    assert unknown.density == 0
    assert known.density > 0.5
