"""Frames of simulated dives along a track, as the trajectory's rooms take them, kept in a folder between runs."""

from __future__ import annotations

import pickle
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from hashlib import sha256
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.match.subpixel import refine_below_a_pixel
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive
from uw_recon_ros.simulate.params import defaults_on
from uw_recon_ros.trajectory import pose_matrix
from uw_recon_ros.types import StereoGeometry, StereoPair


@dataclass(frozen=True, eq=False)
class DiveFrame:
    """One rectified and matched frame, and the true pose of its rectified left view."""

    stamp_ns: int
    left: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    sigma: NDArray[np.float32]
    status: NDArray[np.uint8]
    geometry: StereoGeometry
    pose: NDArray[np.float64]


def dive_frames(
    folder: Path,
    effort: str = "navigation",
    course: dict[str, Any] | None = None,
    first: int | None = None,
    **params: Any,
) -> list[DiveFrame]:
    """The arriving frames of a dive, or the `first` of them; `params`: `SimulateParams`, `course`: `CourseParams`."""
    chosen = CourseParams(**(course or {}))
    taken = SimulateParams.from_mapping(defaults_on(chosen.track) | params)
    folder.mkdir(parents=True, exist_ok=True)
    dive = SurveyDive(taken, chosen)
    name = sha256(repr((effort, chosen, taken, "refined below a pixel, sigma too")).encode()).hexdigest()[:16]
    return list(islice(_frames(folder, name, effort, dive), first))


def _frames(folder: Path, name: str, effort: str, dive: SurveyDive) -> Iterator[DiveFrame]:
    preprocess, rectify, rig = Preprocess(PreprocessParams()), Rectify(RectifyParams()), RigTracker(RectifyParams())
    match = Match(MatchParams(effort=effort))
    for index in dive.taken():
        kept = folder / f"{name}_{index:05d}.pickle"
        if not kept.exists():
            began = time.time()
            frame = _frame(dive, index, preprocess, rectify, rig, match)
            partial = kept.with_suffix(".part")
            partial.write_bytes(pickle.dumps(frame))
            partial.replace(kept)
            sys.stderr.write(f"frame {index}: {time.time() - began:.1f} s\n")
        yield pickle.loads(kept.read_bytes())


def _frame(dive: SurveyDive, index: int, preprocess: Any, rectify: Any, rig: Any, match: Any) -> DiveFrame:
    taken = dive.frame(index)
    enhanced = preprocess(
        StereoPair(taken.left, taken.right, stamp_ns=taken.stamp_ns, calibration=dive.told_calibration)
    )
    pair = rectify(enhanced, rig.update(enhanced))
    found = match(pair)
    pose = pose_matrix(taken.pose.position, taken.pose.rotation @ np.array(pair.geometry.rect_from_raw_left).T)
    # as a survey keeps it
    disparity, sigma = refine_below_a_pixel(pair.left, pair.right, found.disparity, found.sigma)
    return DiveFrame(taken.stamp_ns, pair.left, disparity, sigma, found.status, replace(found.geometry), pose)
