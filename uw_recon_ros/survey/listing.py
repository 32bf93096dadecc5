"""The first pass over a recording: which pairs there are and where, without decoding a single image."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, field, replace
from pathlib import Path

from uw_recon_ros.bags import open_bag
from uw_recon_ros.errors import BagError, CalibrationError
from uw_recon_ros.survey.pair_index import Frame, Place, Rigs, Walk
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.sources import Source, list_stills
from uw_recon_ros.types import StereoCalibration


@dataclass
class Listing:
    """What the first pass found.

    Parameters
    ----------
    frames : list of Frame
    calibrations : list of StereoCalibration
        Each different one.
    notes : list of str
        What was damaged, missing or odd, a sentence each.
    unreadable : list of str
        Sources of which nothing can be used, with the reason.
    pairs : int
        How many there are in the input; `frames` are those chosen.
    """

    frames: list[Frame] = field(default_factory=list)
    calibrations: list[StereoCalibration] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    unreadable: list[str] = field(default_factory=list)
    pairs: int = 0


def list_frames(
    sources: list[Source],
    params: SurveyParams,
    given: StereoCalibration | None = None,
    images_rectified: str = "auto",
) -> Listing:
    """Find the pairs of all sources and choose those asked for.

    Parameters
    ----------
    sources : list of Source
    params : SurveyParams
    given : StereoCalibration, optional
        Instead of what the recordings say.
    images_rectified : {'auto', 'yes', 'no'}

    Raises
    ------
    BagError
        There is no pair at all, or none is chosen; the text says why.
    """
    listing, rigs = Listing(), Rigs(given, images_rectified)
    for index, source in enumerate(sources):
        try:
            found = _list_source(source, index, params, rigs, listing.notes)
        except (BagError, CalibrationError) as error:
            listing.unreadable.append(str(error))
            continue
        _note_backward_steps(source, found, listing.notes)
        listing.frames += found
    listing.frames = _numbered(listing.frames)
    listing.pairs = len(listing.frames)
    if not listing.frames:
        raise BagError("no stereo pairs: " + "; ".join([*listing.unreadable, *listing.notes]))
    listing.frames = choose(listing.frames, params)
    listing.calibrations = rigs.calibrations
    return listing


def _numbered(frames: list[Frame]) -> list[Frame]:
    """The frames with their numbers, each knowing the one before it."""
    befores = [None, *frames][: len(frames)]
    return [
        replace(
            frame,
            number=number,
            before=(before.left, before.right) if before is not None and before.source == frame.source else None,
        )
        for number, (frame, before) in enumerate(zip(frames, befores, strict=True))
    ]


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
    chosen = within[:: params.every][: params.max_frames or None]
    if not chosen:
        lasts = (max(frame.stamp_ns for frame in frames) - first) / 1e9
        raise BagError(f"start {params.start:g} s: expected pairs there, the input lasts {lasts:g} s")
    return chosen


def _list_source(source: Source, index: int, params: SurveyParams, rigs: Rigs, notes: list[str]) -> list[Frame]:
    if source.kind == "stills":
        return [
            Frame(0, index, stamp_ns, Place(left, stamp_ns), Place(right, stamp_ns), rig)
            for stamp_ns, left, right, rig in list_stills(source, params, rigs, notes)
        ]
    with open_bag(Path(source.path)) as bag:
        topics = bag.stereo_topics(params.left_topic or None, params.right_topic or None)
        walk = Walk(bag, topics, index, round(params.pair_tolerance_ms * 1e6), rigs)
        frames = list(walk)
        notes += [f"{source.name}: {sentence}" for sentence in [*bag.damage, *walk.notes()]]
    if not frames:
        raise BagError(f"{source.name}: no pair within {params.pair_tolerance_ms:g} ms: {walk.nearest()}")
    return frames


def _note_backward_steps(source: Source, frames: list[Frame], notes: list[str]) -> None:
    steps = [(a, b) for a, b in itertools.pairwise(frames) if b.stamp_ns < a.stamp_ns]
    if steps:
        before, after = steps[0]
        back = (before.stamp_ns - after.stamp_ns) / 1e9
        notes.append(
            f"{source.name}: stamps go back {len(steps)} times, first by {back:g} s (a looped or spliced bag?)"
        )
