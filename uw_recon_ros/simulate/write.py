"""`simulate`: a dive as a bag, with the truth on topics of its own."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from pathlib import Path

import numpy as np

from uw_recon_ros.bags.messages import pose_message, stamp_ns
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.files.trajectories import write_tum
from uw_recon_ros.rigid import quaternion
from uw_recon_ros.simulate.dive import Dive, SimulatedFrame
from uw_recon_ros.simulate.navigation_sensors import sensor_messages
from uw_recon_ros.simulate.params import CourseParams, SimulateParams
from uw_recon_ros.simulate.rig import LEFT_FRAME, RIGHT_FRAME
from uw_recon_ros.simulate.survey_dive import SurveyDive, write_surface
from uw_recon_ros.types import FloatImage, StereoCalibration

_DEPTH_STEP_M = 2.0**-12  # what rounding costs is 0.02 px of disparity at 1 m; it halves the bag's share for depth


def simulate(
    path: str | Path,
    params: SimulateParams,
    *,
    overwrite: bool = False,
    level: int = 3,
    progress: Callable[[range], Iterable[int]] = iter,
) -> int:
    """Write a simulated dive.

    Topics: ``/left/image_raw``, ``/right/image_raw``; where ``params.calibrated``, ``/left/camera_info`` and
    ``/right/camera_info``; and of the raw left image ``/truth/depth`` (32FC1, m along the optical axis, NaN = nothing
    there, in steps of 1/4096 m), ``/truth/status`` (mono8, bits of `uw_recon_ros.types.Status`), ``/truth/pose`` (in
    ``world``); and always ``/truth/left/camera_info``, ``/truth/right/camera_info``.

    Parameters
    ----------
    path : path
        Folder to make; with the suffix ``.mcap`` a bare file.
    params : SimulateParams
    overwrite : bool
        Whether to replace a bag that stands there.
    level : int
        Of the zstd compression.
    progress : callable, optional
        Given the range of frame numbers, yields them one by one while it shows how far it is.

    Returns
    -------
    int
        Number of pairs.

    Raises
    ------
    BagError
        The name is taken, or it cannot be written.
    """
    with BagWriter(path, overwrite=overwrite, level=level) as writer:
        dive = Dive(params)
        for index in progress(range(params.frames)):
            _write_frame(writer, dive.frame(index), dive.calibration, params.calibrated)
    return params.frames


def simulate_survey(
    path: str | Path,
    params: SimulateParams,
    course: CourseParams,
    truth: str | Path | None = None,
    *,
    overwrite: bool = False,
    level: int = 3,
    progress: Callable[[Collection[int]], Iterable[int]] = iter,
) -> int:
    """Write a simulated dive along a track.

    Topics as in `simulate`, where the calibration is the one that is *told*; and, where ``course.sensors``,
    ``/imu/data``, ``/pressure``, ``/dvl/twist`` and ``/gnss/fix``.

    Parameters
    ----------
    path : path
        As in `simulate`.
    params : SimulateParams
    course : CourseParams
    truth : path or None
        Folder for ``trajectory.txt`` (TUM: stamp, position, quaternion of the left optical frame in the world) and
        ``surface.ply`` (what lies there, seen from above).
    overwrite, level, progress
        As in `simulate`.

    Returns
    -------
    int
        Number of pairs that arrived.

    Raises
    ------
    BagError
        The name is taken, or it cannot be written.
    ValueError
        An orbit that looks straight down.
    """
    with BagWriter(path, overwrite=overwrite, level=level) as writer:
        dive = SurveyDive(params, course)
        numbers = dive.taken()
        last = dive.seconds(numbers[-1])
        others = list(sensor_messages(dive.course, last, dive.stamp_ns(0))) if course.sensors else []
        for index in progress(numbers):
            while others and stamp_ns(others[0][1]) <= dive.stamp_ns(index):
                writer.message(*others.pop(0))
            _write_frame(writer, dive.frame(index), dive.calibration, params.calibrated, dive.told_calibration)
    if truth is not None:
        Path(truth).mkdir(parents=True, exist_ok=True)
        write_tum(Path(truth) / "trajectory.txt", dive.true_trajectory())
        write_surface(Path(truth) / "surface.ply", dive)
    return len(numbers)


def _write_frame(
    writer: BagWriter,
    frame: SimulatedFrame,
    true: StereoCalibration,
    calibrated: bool,
    told: StereoCalibration | None = None,
) -> None:
    stamp = frame.stamp_ns
    writer.image("/left/image_raw", frame.left, time_ns=stamp, frame_id=LEFT_FRAME)
    writer.image("/right/image_raw", frame.right, time_ns=stamp, frame_id=RIGHT_FRAME)
    for prefix, calibration in (("", told or true), ("/truth", true))[0 if calibrated else 1 :]:
        writer.camera_info(f"{prefix}/left/camera_info", calibration.left, time_ns=stamp, frame_id=LEFT_FRAME)
        writer.camera_info(f"{prefix}/right/camera_info", calibration.right, time_ns=stamp, frame_id=RIGHT_FRAME)
    writer.image("/truth/depth", rounded(frame.depth), time_ns=stamp, frame_id=LEFT_FRAME)
    writer.image("/truth/status", frame.status, time_ns=stamp, frame_id=LEFT_FRAME)
    turn = quaternion(frame.pose.rotation)
    writer.message("/truth/pose", pose_message(frame.pose.position, turn, time_ns=stamp, frame_id="world"))


def rounded(depth: FloatImage) -> FloatImage:
    """Depth in steps of 1/4096 m: its last bits are noise that does not compress."""
    steps: FloatImage = np.round(depth / np.float32(_DEPTH_STEP_M)) * np.float32(_DEPTH_STEP_M)
    return steps
