"""What is asked of a survey, and how it ended."""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from uw_recon_ros.params import Params
from uw_recon_ros.pipeline import PipelineParams
from uw_recon_ros.progress import Progress
from uw_recon_ros.recordings.sources import Source, digests, fingerprint, source_files
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.plan import versions
from uw_recon_ros.survey.store import SurveyError

_INERT = {"match_threads"}  # the output does not depend on it
_SAY_EVERY_S = 5.0


@dataclass(frozen=True)
class SurveyRequest:
    """What was asked for.

    Parameters
    ----------
    inputs : sequence of str
        Bags, folders of bags, folders of stills.
    output : str
        Directory.
    pipeline : PipelineParams
    survey : SurveyParams
    calibration : tuple of str
        Files to take instead of what the inputs say.
    overwrite : bool
        Whether to clear what another survey left in `output`.
    """

    inputs: Sequence[str]
    output: str
    pipeline: PipelineParams
    survey: SurveyParams
    calibration: tuple[str, ...] = ()
    overwrite: bool = False

    def check_extras(self) -> None:
        """Raise `SurveyError` where an optional library is wanted and not there."""
        if self.survey.cloud_format == "laz" and not importlib.util.find_spec("laspy"):
            raise SurveyError("cloud_format laz: expected the extra 'laz': pip install '.[laz]' in the sources' folder")


@dataclass(frozen=True)
class Outcome:
    """How a survey ended.

    Parameters
    ----------
    output : str
    frames, ok, failed : int
        Chosen pairs, and what became of them.
    resumed : int
        How many of these were there before this run.
    unreadable : tuple of str
        Inputs of which nothing could be used, with the reason.
    notes : tuple of str
        What was damaged or odd, a sentence each.
    seconds : float
        Of this run.
    unreliable : int
        Frames that were reconstructed and are not to be measured by.
    doubts : tuple of str
        Codes of why.
    """

    output: str
    frames: int
    ok: int
    failed: int
    resumed: int
    unreadable: tuple[str, ...]
    notes: tuple[str, ...]
    seconds: float
    unreliable: int = 0
    doubts: tuple[str, ...] = ()

    @property
    def complete(self) -> bool:
        """Whether every chosen pair of every input was reconstructed."""
        return not self.failed and not self.unreadable


def settings_of(request: SurveyRequest, sources: list[Source], progress: Progress) -> dict[str, Any]:
    """Everything the output depends on: the same settings give the same bytes.

    Raises
    ------
    BagError
        An input cannot be read.
    """
    meter = _Meter(progress, sum(file.stat().st_size for source in sources for file in source_files(source)))
    names: dict[str, dict[str, str]] = {}
    for source in sources:
        name = source.name if source.name not in names else f"{source.name} ({len(names)})"
        names[name] = fingerprint(source, meter)
    pipeline = request.pipeline
    stages: tuple[Params, ...] = (pipeline.preprocess, pipeline.rectify, pipeline.match, pipeline.reconstruct)
    parameters = {name: value for stage in stages for name, value in _values(stage).items()}
    return {
        "input": names,
        "calibration": [digest for path in request.calibration for digest in digests(path)] or None,
        "survey": _values(request.survey),
        "parameters": {name: value for name, value in parameters.items() if name not in _INERT},
        "versions": versions(),
    }


def _values(params: Params) -> dict[str, Any]:
    return {spec.name: getattr(params, spec.name) for spec in params.specs()}


class _Meter:
    """Says now and then how much of the input is read."""

    def __init__(self, progress: Progress, total: int) -> None:
        self._progress, self._total, self._read, self._said = progress, total, 0, time.monotonic()

    def __call__(self, count: int) -> None:
        self._read += count
        if time.monotonic() - self._said > _SAY_EVERY_S:
            self._said = time.monotonic()
            self._progress.line(f"checking input: {self._read / 1e9:.1f} of {self._total / 1e9:.1f} GB")
