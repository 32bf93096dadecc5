"""What every process needs to know before its first frame, as a file beside the output.

A task carries the file's path and digest, so it is small, and what is read is what this very run has written.
"""

from __future__ import annotations

import hashlib
import platform
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from importlib.resources import files
from pathlib import Path
from typing import Any

from uw_recon_ros import __version__
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.files.packed import pack, unpack
from uw_recon_ros.findings import Finding
from uw_recon_ros.match.stage import MatchParams
from uw_recon_ros.pipeline import PipelineParams
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.reconstruct.stage import ReconstructParams
from uw_recon_ros.recordings.pair_index import Frame
from uw_recon_ros.recordings.sources import Source
from uw_recon_ros.rectify.port import FlatPort, PortCamera
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.rectify.stage import RectifyParams
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.store import SurveyError, compare, describe
from uw_recon_ros.types import (
    CalibrationOrigin,
    CameraModel,
    FlatPorts,
    RectificationQuality,
    StereoCalibration,
    StereoGeometry,
    Window,
)

#: Packages whose version may change a bit of the output.
_DEPENDENCIES = (
    "numpy", "scipy", "opencv-python-headless", "numba", "llvmlite", "PyWavelets", "trimesh", "pillow", "rosbags",
    "mcap", "zstandard", "laspy", "lazrs",
)  # fmt: skip
_SOURCES = {".py", ".js", ".css", ".html"}


def versions() -> dict[str, str | None]:
    """Of the project, Python, and what it computes with; a checkout changes without its number doing so."""
    own = {"uw_recon_ros": __version__, "uw_recon_ros sources": _sources(), "python": platform.python_version()}
    return own | {name: _version(name) for name in _DEPENDENCIES}


@cache
def _sources() -> str:
    """Digest of the package's files."""
    package = files("uw_recon_ros")
    assert isinstance(package, Path)
    digest = hashlib.sha256()
    for path in sorted(path for path in package.rglob("*") if path.suffix in _SOURCES):
        digest.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _version(name: str) -> str | None:
    try:
        return version(name)
    except PackageNotFoundError:
        return None


@dataclass(frozen=True)
class Plan:
    """All of a survey but its frames.

    Parameters
    ----------
    root : str
        Output directory, absolute.
    sources : list of Source
    calibrations : list of StereoCalibration
    survey : SurveyParams
    pipeline : PipelineParams
    rectifications : dict of int to Rectification
        By rig; -1: no calibration.
    versions : dict
    """

    root: str
    sources: list[Source]
    calibrations: list[StereoCalibration]
    survey: SurveyParams
    pipeline: PipelineParams
    rectifications: dict[int, Rectification] = field(default_factory=dict)
    versions: dict[str, str | None] = field(default_factory=versions)

    def with_rectifications(self, rectifications: dict[int, Rectification]) -> Plan:
        """The same, the rigs being known."""
        return replace(self, rectifications=rectifications)


@dataclass(frozen=True)
class FrameTask:
    """One frame for one process.

    Parameters
    ----------
    plan : str
        File of the packed `Plan`.
    digest : str
        SHA-256 of that file.
    frame : Frame
    """

    plan: str
    digest: str
    frame: Frame


_CLASSES = (
    Plan, Source, StereoCalibration, CameraModel, SurveyParams, PipelineParams, PreprocessParams, RectifyParams,
    MatchParams, ReconstructParams, Rectification, RectifiedCamera, PortCamera, FlatPort, FlatPorts, CalibrationOrigin,
    StereoGeometry, RectificationQuality, Finding, Window,
)  # fmt: skip


def save_plan(plan: Plan, state: Path) -> Callable[[Frame], FrameTask]:
    """Write the plan; return what makes a task of a frame."""
    path = (state / "plan.npz").absolute()
    data = pack(plan)
    write_bytes(path, data, durable=True)
    digest = hashlib.sha256(data).hexdigest()
    return lambda frame: FrameTask(str(path), digest, frame)


def load_plan(task: FrameTask) -> Plan:
    """Read a task's plan.

    Raises
    ------
    SurveyError
        It is not the one the task names, or this process has other versions installed than the one that wrote it.
    """
    data = Path(task.plan).read_bytes()
    if hashlib.sha256(data).hexdigest() != task.digest:
        raise SurveyError(f"{task.plan}: expected the plan of this run, got another")
    plan: Any = unpack(data, _CLASSES)
    differences = compare(plan.versions, versions())
    if differences:
        raise SurveyError(
            f"worker {platform.node()}: expected the versions of the survey's start: {describe(differences)}"
        )
    assert isinstance(plan, Plan)
    return plan
