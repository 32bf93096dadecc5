"""Which pairs of the input a survey takes, and how it asks for them."""

from __future__ import annotations

from uw_recon_ros.errors import BagError
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.pair_index import Frame
from uw_recon_ros.survey.params import SurveyParams


def options_of(params: SurveyParams) -> Options:
    """What the parameters say of the recordings."""
    return Options(
        params.left_topic, params.right_topic, params.pair_tolerance_ms, params.stills_rate, params.layout,
        params.clock_offset,
    )  # fmt: skip


def _apart(frame: Frame) -> int:
    """How far a pair's images are from each other, ms: of those that are left to choose from, the least."""
    return round(abs(frame.lag_ns) / 1e6)


def choose(frames: list[Frame], params: SurveyParams) -> list[Frame]:
    """Apply `start`, `end`, `every` and `max_frames`.

    Raises
    ------
    BagError
        Nothing is left.
    """
    first = frames[0].stamp_ns
    start, end = params.start or float("-inf"), params.end or float("inf")  # stamps may go back before the first
    within = [frame for frame in frames if start <= (frame.stamp_ns - first) / 1e9 <= end]
    groups = (within[n : n + params.every] for n in range(0, len(within), params.every))
    chosen = [min(group, key=_apart) for group in groups][: params.max_frames or None]
    if not chosen:
        lasts = (max(frame.stamp_ns for frame in frames) - first) / 1e9
        raise BagError(f"start {params.start:g} s: expected pairs there, the input lasts {lasts:g} s")
    return chosen
