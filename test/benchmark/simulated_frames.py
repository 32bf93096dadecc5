"""Simulated dives, enhanced and rectified as the pipeline does it, with the truth about each pair."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import StereoPair


@dataclass(frozen=True, eq=False)
class Frame:
    """What the matcher is shown, and the true disparity, px; `seen`: where the right camera sees the same."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    disparity: NDArray[np.float32]
    seen: NDArray[np.bool_]


def rectified_frames(count: int, **choice: Any) -> list[Frame]:
    """The first frames of a dive; `choice` are fields of `SimulateParams`."""
    dive = Dive(SimulateParams(frames=count, **choice))
    preprocess, rectify, rig = Preprocess(PreprocessParams()), Rectify(RectifyParams()), RigTracker(RectifyParams())
    frames = []
    for number in range(count):
        taken = dive.frame(number)
        raw = StereoPair(taken.left, taken.right, stamp_ns=taken.stamp_ns, calibration=dive.calibration)
        enhanced = preprocess(raw)
        pair = rectify(enhanced, rig.update(enhanced))
        truth = dive.true_disparity(number, pair.geometry, *pair.left.shape[1::-1])
        frames.append(Frame(pair.left_matching, pair.right_matching, truth, _seen_by_both(truth)))
    return frames


def _seen_by_both(truth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Whether nothing nearer falls onto the same pixel of the right view."""
    v, u = np.indices(truth.shape)
    x = np.round(u - np.nan_to_num(truth, nan=-1e4)).astype(int)
    known = np.isfinite(truth) & (x >= 0) & (x < truth.shape[1])
    nearest = np.full(truth.shape, -np.inf)
    np.maximum.at(nearest, (v[known], x[known]), truth[known])
    seen = np.zeros(truth.shape, np.bool_)
    seen[known] = truth[known] >= nearest[v[known], x[known]] - 1
    return seen
