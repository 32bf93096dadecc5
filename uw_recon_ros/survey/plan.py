"""What every process needs to know before its first frame, as a file beside the output.

A task carries the file's path and digest, so it is small, and what is unpickled is what this very run has written.
"""

from __future__ import annotations

import hashlib
import pickle
import platform
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from uw_recon_ros import __version__
from uw_recon_ros.pipeline import PipelineParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.survey.listing import Frame
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.sources import Source
from uw_recon_ros.survey.store import SurveyError, compare, describe, write_durably
from uw_recon_ros.types import StereoCalibration

#: Packages whose version may change a bit of the output.
_DEPENDENCIES = (
    "numpy", "scipy", "opencv-python-headless", "numba", "llvmlite", "PyWavelets", "trimesh", "pillow", "rosbags",
    "mcap", "zstandard", "laspy", "lazrs",
)  # fmt: skip


def versions() -> dict[str, str | None]:
    """Of the project, Python, and what it computes with."""
    return {"uw_recon_ros": __version__, "python": platform.python_version()} | {n: _version(n) for n in _DEPENDENCIES}


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
class Task:
    """One frame for one process.

    Parameters
    ----------
    plan : str
        File of the pickled `Plan`.
    digest : str
        SHA-256 of that file.
    frame : Frame
    """

    plan: str
    digest: str
    frame: Frame


def save_plan(plan: Plan, state: Path) -> Callable[[Frame], Task]:
    """Write the plan; return what makes a task of a frame."""
    path = (state / "plan.pickle").absolute()
    data = pickle.dumps(plan)
    write_durably(path, data)
    digest = hashlib.sha256(data).hexdigest()
    return lambda frame: Task(str(path), digest, frame)


def load_plan(task: Task) -> Plan:
    """Read a task's plan.

    Raises
    ------
    SurveyError
        It is not the one the task names, or this process has other versions installed than the one that wrote it.
    """
    data = Path(task.plan).read_bytes()
    if hashlib.sha256(data).hexdigest() != task.digest:
        raise SurveyError(f"{task.plan}: expected the plan of this run, got another")
    plan: Any = pickle.loads(data)
    differences = compare(plan.versions, versions())
    if differences:
        raise SurveyError(
            f"worker {platform.node()}: expected the versions of the survey's start: {describe(differences)}"
        )
    assert isinstance(plan, Plan)
    return plan
