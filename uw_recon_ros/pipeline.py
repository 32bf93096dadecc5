"""The four stages in a row: what one stereo pair goes through, offline."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from uw_recon_ros.catalogue import ALL_PARAMS, NODES
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.params import read_parameter_file, unknown_names
from uw_recon_ros.preprocess.sequence import PreprocessSequence
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.types import DepthMap, DisparityMap, EnhancedPair, PointCloud, RectifiedPair, StereoPair, Surface

Announce = Callable[[str], None]


@dataclass(frozen=True)
class PipelineParams:
    """The parameters of all stages."""

    preprocess: PreprocessParams = field(default_factory=PreprocessParams)
    rectify: RectifyParams = field(default_factory=RectifyParams)
    match: MatchParams = field(default_factory=MatchParams)
    reconstruct: ReconstructParams = field(default_factory=ReconstructParams)

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> PipelineParams:
        """Build from one flat mapping of names to values; names that only nodes know are passed over.

        Raises
        ------
        TypeError, ValueError
            A value is refused, or nobody knows the name.
        """
        unknown = unknown_names(values, ALL_PARAMS)
        if unknown:
            raise ValueError(f"parameters: expected names of config/PARAMETERS.md, got {', '.join(unknown)}")
        return cls(
            PreprocessParams.from_mapping(values),
            RectifyParams.from_mapping(values),
            MatchParams.from_mapping(values),
            ReconstructParams.from_mapping(values),
        )


def read_values(path: str | Path) -> dict[str, Any]:
    """Read the stages' values from a ROS parameter file, as the nodes would.

    Raises
    ------
    ValueError
        The file cannot be read, or is no parameter file.
    """
    values = read_parameter_file(path, [*NODES, "pipeline_node"])
    values.pop("use_sim_time", None)
    return values


@dataclass(frozen=True, eq=False)
class Result:
    """Everything that came of one pair.

    Parameters
    ----------
    raw, enhanced, rectified, disparity, depth, cloud, surface
        In the order they were made.
    stages_seconds : dict of str to float
        Wall time of each stage, s.
    """

    raw: StereoPair
    enhanced: EnhancedPair
    rectified: RectifiedPair
    disparity: DisparityMap
    depth: DepthMap
    cloud: PointCloud
    surface: Surface
    stages_seconds: dict[str, float]


class _Stopwatch:
    def __init__(self, announce: Announce) -> None:
        self.seconds: dict[str, float] = {}
        self._announce = announce

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        self._announce(stage)
        started = time.perf_counter()
        yield
        self.seconds[stage] = time.perf_counter() - started


class Pipeline:
    """All four stages; the last pair, and the rig's rectification, are remembered from pair to pair.

    Parameters
    ----------
    params : PipelineParams
    """

    def __init__(self, params: PipelineParams) -> None:
        self._preprocess = PreprocessSequence(params.preprocess)
        self._rig = RigTracker(params.rectify)
        self._rectify = Rectify(params.rectify)
        self._match = Match(params.match)
        self._reconstruct = Reconstruct(params.reconstruct)

    def __call__(self, pair: StereoPair, announce: Announce = lambda stage: None) -> Result:
        """Reconstruct one pair.

        Parameters
        ----------
        pair : StereoPair
        announce : callable
            Told the name of each stage as it begins.

        Raises
        ------
        ReconError
            What the images or the calibration did not allow, with the numbers.
        """
        timed = _Stopwatch(announce)
        with timed("preprocess"):
            enhanced = self._preprocess(pair)
        with timed("rectify"):
            rectified = self._rectify(enhanced, self._rig.update(enhanced))
        with timed("match"):
            disparity = self._match(rectified)
        with timed("depth"):
            depth = self._reconstruct.depth(disparity)
        with timed("cloud"):
            cloud = self._reconstruct.cloud(depth, rectified.left)
        with timed("surface"):
            surface = self._reconstruct.surface(depth, rectified.left)
        return Result(pair, enhanced, rectified, disparity, depth, cloud, surface, timed.seconds)
