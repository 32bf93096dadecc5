"""A simulated dive as action cameras film it: each camera with a clock and a rate of its own."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from helpers.dives import table
from helpers.videos import write_video
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.cli import main
from uw_recon_ros.files.calibrations.write import write_calibration
from uw_recon_ros.files.trajectories import write_tum
from uw_recon_ros.model.evaluate import evaluate_model
from uw_recon_ros.simulate.params import CourseParams, SimulateParams
from uw_recon_ros.simulate.rig import LEFT_FRAME, RIGHT_FRAME
from uw_recon_ros.simulate.survey_dive import SurveyDive, write_surface
from uw_recon_ros.trajectory import pose_matrix, trajectory_of

FIRST_S = 1.0  # the stamp of a video's first frame


class FilmedDive(SurveyDive):
    """A dive seen at any rate and from any moment on: `begin_s` after the dive's first."""

    begin_s = 0.0

    def __init__(self, params: SimulateParams, course: CourseParams, rate_hz: float, lasts_s: float) -> None:
        super().__init__(replace(params, rate_hz=rate_hz, frames=int(lasts_s * rate_hz)), course)

    def seconds(self, index: int) -> float:
        """Of the dive, at a frame."""
        return self.begin_s + super().seconds(index)

    def view(self, side: int, index: int) -> NDArray[np.uint8]:
        """What one camera takes."""
        return np.asarray(self._take(self._cameras[side], index)[1], np.uint8)


def film(dive: FilmedDive, side: int, seconds: float) -> Iterator[NDArray[np.uint8]]:
    """The frames of one camera."""
    for index in range(int(seconds * dive.params.rate_hz)):
        yield dive.view(side, index)


@dataclass(frozen=True)
class Filming:
    """How a dive is filmed.

    Parameters
    ----------
    params : SimulateParams
    course : CourseParams
    seconds : float
    rates : (left, right)
        Of the two cameras without sync, Hz.
    offset_s : float
        What the right camera's clock is ahead: it began so much earlier.
    every : int
        Pairs are every so-many-th frame of the left camera.
    quality : int
        Constant rate factor of x264; lower is better.
    """

    params: SimulateParams
    course: CourseParams
    seconds: float
    rates: tuple[float, float]
    offset_s: float
    every: int
    quality: int = 16

    def cameras(self) -> tuple[FilmedDive, FilmedDive]:
        """What the left and the right camera see, exposed alike."""
        lasts_s = self.seconds + abs(self.offset_s)
        left, right = (FilmedDive(self.params, self.course, rate, lasts_s) for rate in self.rates)
        right.scene = left.scene
        left.begin_s = max(0.0, self.offset_s)
        right.begin_s = left.begin_s - self.offset_s
        right.__dict__["_exposure"] = left._exposure
        return left, right


def write_forms(folder: Path, filming: Filming) -> None:
    """Write one dive as ``bag``, as ``sbs/dive.mp4`` and as ``two/left.mp4`` and ``two/right.mp4``.

    Bag and ``sbs`` have the pairs, the bag's bits as taken; in ``two`` the cameras run for themselves.
    """
    left, right = filming.cameras()
    images = list(film(left, 0, filming.seconds))
    pairs = [(image, left.view(1, n)) for n, image in enumerate(images) if n % filming.every == 0]
    for name in ("sbs", "two"):
        (folder / name).mkdir()
        write_calibration(left.calibration, folder / name / "calibration.yaml")
    with BagWriter(folder / "bag") as bag:
        for number, pair in enumerate(pairs):
            _into_bag(bag, left, pair, round((FIRST_S + number * filming.every / filming.rates[0]) * 1e9))
    joined = (np.concatenate(pair, axis=1) for pair in pairs)
    write_video(folder / "sbs" / "dive.mp4", joined, filming.rates[0] / filming.every, quality=filming.quality)
    write_video(folder / "two" / "left.mp4", images, filming.rates[0], quality=filming.quality)
    others = film(right, 1, filming.seconds + max(0.0, filming.offset_s))
    write_video(folder / "two" / "right.mp4", others, filming.rates[1], quality=filming.quality)


def _into_bag(
    bag: BagWriter, dive: FilmedDive, images: tuple[NDArray[np.uint8], NDArray[np.uint8]], stamp: int
) -> None:
    for side, image, camera, frame in (
        ("left", images[0], dive.calibration.left, LEFT_FRAME),
        ("right", images[1], dive.calibration.right, RIGHT_FRAME),
    ):
        bag.image(f"/{side}/image_raw", image, time_ns=stamp, frame_id=frame)
        bag.camera_info(f"/{side}/camera_info", camera, time_ns=stamp, frame_id=frame)


def write_truth(folder: Path, dive: FilmedDive, stamps_ns: list[int]) -> None:
    """The way at moments of the left camera's clock, and the surface."""
    folder.mkdir()
    poses = [dive.course.pose(dive.begin_s + stamp / 1e9 - FIRST_S) for stamp in stamps_ns]
    stack = np.array([pose_matrix(pose.position, pose.rotation) for pose in poses])
    write_tum(folder / "trajectory.txt", trajectory_of(stamps_ns, stack))
    write_surface(folder / "surface.ply", dive)


@dataclass(frozen=True)
class Made:
    """A model held against the truth: its way and its surface, and what was said of the recording."""

    ate_mm: float
    median_mm: float
    p95_mm: float
    completeness_percent: float
    pairs: int
    notes: tuple[str, ...]


def modelled(folder: Path, name: str, filming: Filming, params: str) -> Made:
    """``uw_recon survey --model`` of one form, and what ``evaluate-model`` finds."""
    source, out = folder / name, folder / f"{name}_out"
    (folder / "params.yaml").write_text(params)
    every = filming.every if name == "two" else 1
    arguments = ["survey", str(source), "-o", str(out), "--params", str(folder / "params.yaml"), "--model"]
    code = main([*arguments, "--write", "model", "--every", str(every), "--jobs", "1", "--quiet"])
    if code != 0:
        raise AssertionError(f"survey of {name}: exit code {code}")
    stamps = sorted(int(row["stamp_ns"]) for row in table(out / "frames.csv"))
    write_truth(folder / f"{name}_truth", filming.cameras()[0], stamps)
    found = evaluate_model(out, folder / f"{name}_truth")
    notes = tuple(json.loads((out / "report.json").read_text())["notes"])
    way = max(found["trajectory"]["segments"], key=lambda segment: segment["frames"])
    surface = max(found["surface"], key=lambda model: model["completeness_percent"])
    return Made(
        1e3 * way["ate_m"], surface["median_mm"], surface["p95_mm"], surface["completeness_percent"], len(stamps), notes
    )
