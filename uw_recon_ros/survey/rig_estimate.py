"""One rectification a rig for the whole survey: from its calibration, or estimated from frames spread over it.

The tie points are kept in ``state/``, so that a survey that is taken up again rectifies as it began.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from uw_recon_ros.errors import CalibrationError, EstimationError
from uw_recon_ros.recordings.pair_index import Frame
from uw_recon_ros.rectify.calibrated import judged, rectification_from_calibration, unjudged
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.stereo_info import has_baseline
from uw_recon_ros.rectify.tie_points import TiePoints, gathered
from uw_recon_ros.rectify.uncalibrated import estimate_rectification
from uw_recon_ros.survey.executor import Executor, Lost
from uw_recon_ros.survey.plan import FrameTask
from uw_recon_ros.survey.worker import tie_points_of
from uw_recon_ros.types import StereoCalibration

Hand = Callable[[Frame], FrameTask]

_CALIBRATED_FRAMES = 5  # enough to judge a rig that needs no estimate
_NO_BASELINE = "CameraInfo describes two single cameras (P[3] = P[7] = 0): rectified without calibration"


def sort_rigs(
    frames: list[Frame], calibrations: list[StereoCalibration], params: RectifyParams
) -> tuple[list[Frame], list[str]]:
    """Give frames whose calibration is not to be used the rig -1; also say why, where that is not what was asked for.

    Raises
    ------
    CalibrationError
        A calibration is required and missing.
    """
    use = params.calibration_use
    usable = [use != "ignore" and (use == "require" or has_baseline(c)) for c in calibrations]
    sorted_out = [f if f.rig >= 0 and usable[f.rig] else replace(f, rig=-1) for f in frames]
    missing = sum(f.rig < 0 for f in sorted_out)
    if use == "require" and missing:
        raise CalibrationError(f"calibration: expected one (calibration_use = require), {missing} pairs have none")
    return sorted_out, [_NO_BASELINE] if use == "auto" and not all(usable) else []


def spread(frames: list[Frame], count: int) -> list[Frame]:
    """At most `count` of the frames, evenly, first and last included."""
    if len(frames) <= count:
        return frames
    return [frames[i] for i in np.linspace(0, len(frames) - 1, count).round().astype(int)]


def rectify_rigs(
    frames: list[Frame],
    calibrations: list[StereoCalibration],
    params: RectifyParams,
    rig_frames: int,
    executor: Executor,
    hand: Hand,
    state: Path,
) -> tuple[dict[int, Rectification], list[str]]:
    """Find the rectification of every rig that occurs.

    Parameters
    ----------
    frames : list of Frame
    calibrations : list of StereoCalibration
    params : RectifyParams
    rig_frames : int
        Frames to look at for an estimate.
    executor : Executor
    hand : callable
        Makes a task of a frame.
    state : path
        Where tie points are kept.

    Returns
    -------
    rectifications : dict of int to Rectification
    notes : list of str
        Rigs that cannot be rectified, and why: their frames will fail.

    Raises
    ------
    EstimationError, CalibrationError
        No rig can be rectified.
    """
    found: dict[int, Rectification] = {}
    errors: list[EstimationError | CalibrationError] = []
    for rig in sorted({frame.rig for frame in frames}):
        count = rig_frames if rig < 0 else min(rig_frames, _CALIBRATED_FRAMES)
        chosen = spread([frame for frame in frames if frame.rig == rig], count)
        try:
            points = _tie_points(chosen, executor, hand, state / f"tie_points_{rig}.npz")
            found[rig] = rectification_of(points, calibrations[rig] if rig >= 0 else None, params)
        except (EstimationError, CalibrationError) as error:
            errors.append(error)
    if not found:
        raise errors[0]
    return found, [f"some frames cannot be rectified: {error}" for error in errors]


def rectification_of(
    points: TiePoints | str, calibration: StereoCalibration | None, params: RectifyParams
) -> Rectification:
    """A rig's, by its calibration, or by its tie points; these may be the reason why there are none.

    Raises
    ------
    CalibrationError
        The calibration cannot be true, or is of another size than the images.
    EstimationError
        The tie points do not allow it.
    """
    if calibration is None:
        if isinstance(points, str):
            raise EstimationError(points)
        return estimate_rectification(points, params)
    size = None if isinstance(points, str) else (points.width, points.height)
    rectification = rectification_from_calibration(calibration, params, image_size=size)
    if isinstance(points, str):
        return unjudged(rectification, points)
    return judged(rectification, points, params)


def _tie_points(frames: list[Frame], executor: Executor, hand: Hand, path: Path) -> TiePoints | str:
    """Of all the frames together, or why there are none; remembered in `path`."""
    if path.is_file():
        return _load(path)
    found = dict(_find(frames, executor, hand))
    together = _of_one_size([found[number] for number in sorted(found)])
    _save(together, path)
    return together


def _find(frames: list[Frame], executor: Executor, hand: Hand) -> Iterator[tuple[int, TiePoints | str]]:
    for task, value in executor.run(tie_points_of, map(hand, frames)):
        yield task.frame.number, value.reason if isinstance(value, Lost) else value


def _of_one_size(found: list[TiePoints | str]) -> TiePoints | str:
    """Frames of the size that most have; where no frame has any, the reasons."""
    points = [p for p in found if isinstance(p, TiePoints)]
    if not points:
        reasons = list(dict.fromkeys(reason for reason in found if isinstance(reason, str)))
        return f"none of {len(found)} frames gives tie points: {'; '.join(reasons[:3])}"
    [(size, _)] = Counter((p.width, p.height) for p in points).most_common(1)
    return gathered([p for p in points if (p.width, p.height) == size])


def _save(points: TiePoints | str, path: Path) -> None:
    partial = path.with_name(f".{path.name}")
    with partial.open("wb") as stream:
        if isinstance(points, str):
            np.savez(stream, reason=np.array(points))
        else:
            np.savez(stream, left=points.left, right=points.right, size=np.array([points.width, points.height]))
    partial.replace(path)


def _load(path: Path) -> TiePoints | str:
    with np.load(path, allow_pickle=False) as kept:
        if "reason" in kept:
            return str(kept["reason"])
        return TiePoints(kept["left"], kept["right"], int(kept["size"][0]), int(kept["size"][1]))
