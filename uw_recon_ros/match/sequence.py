"""Frames in a row: each starts from the surfaces of the one before (parameter ``use_previous``)."""

from __future__ import annotations

from uw_recon_ros.match.planes.previous_frame import FrameBefore
from uw_recon_ros.match.stage import Match
from uw_recon_ros.types import DisparityMap, RectifiedPair

MOST_APART_NS = 2_000_000_000  #: frames further apart than this have nothing to do with each other


class MatchSequence:
    """Remembers the last frame's surfaces. Deterministic: the same frames in a row give the same results.

    It forgets them when the images change in size or axis, when time runs backwards (a bag that starts again), and
    when frames are more than `MOST_APART_NS` apart. What the images themselves contradict is not taken over anyway.
    """

    def __init__(self) -> None:
        self._before: FrameBefore | None = None
        self._key: tuple[object, ...] = ()
        self._stamp_ns = 0

    def __call__(self, match: Match, pair: RectifiedPair) -> DisparityMap:
        """Match the next pair.

        Parameters
        ----------
        match : Match
            May be another one, of another effort, from frame to frame. Without ``use_previous`` it is simply called.
        pair : RectifiedPair
        """
        if not match.params.use_previous:
            return match(pair)
        key = (pair.left_matching.shape[:2], pair.geometry.axis)
        if key != self._key or not 0 < pair.stamp_ns - self._stamp_ns <= MOST_APART_NS:
            self._before, self._key = None, key
        disparity, frame = match.follow(pair, self._before)
        if frame is not None:
            self._before, self._stamp_ns = frame, pair.stamp_ns
        return disparity
