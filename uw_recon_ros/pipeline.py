"""The four stages in a row: what one stereo pair goes through, offline."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.catalogue import ALL_PARAMS, NODES
from uw_recon_ros.findings import Finding
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.match.subpixel import refine_below_a_pixel
from uw_recon_ros.params import read_parameter_file, unknown_names
from uw_recon_ros.preprocess.sequence import PreprocessSequence
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.stopwatch import Stopwatch
from uw_recon_ros.trajectory import DisparityFrame
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


@dataclass(frozen=True)
class Stages:
    """What makes each product from the one before.

    Parameters
    ----------
    preprocess, rectify, match : callable
        A stage, or one with a memory of earlier pairs; the first is told by ``shown`` where nobody wants a picture.
    reconstruct : Reconstruct
    """

    preprocess: Callable[..., EnhancedPair]
    rectify: Callable[[EnhancedPair], RectifiedPair]
    match: Callable[[RectifiedPair], DisparityMap]
    reconstruct: Reconstruct


class Products:
    """All that comes of one pair, each made when it is first asked for, and kept.

    Asking for one raises ``ReconError`` where the images or the calibration did not allow it or what it is made from.

    Parameters
    ----------
    raw : StereoPair
    stages : Stages
    timed : Stopwatch
    shown : bool
        Whether there shall be pictures to look at, see `preprocess.stage.Preprocess`.
    """

    def __init__(self, raw: StereoPair, stages: Stages, timed: Stopwatch | None = None, *, shown: bool = True) -> None:
        self.raw, self._stages, self._shown = raw, stages, shown
        self.timed = Stopwatch() if timed is None else timed

    @cached_property
    def enhanced(self) -> EnhancedPair:
        """The images to look at, and to match."""
        with self.timed("preprocess"):
            return self._stages.preprocess(self.raw) if self._shown else self._stages.preprocess(self.raw, shown=False)

    @cached_property
    def rectified(self) -> RectifiedPair:
        """Matching pixels on one row; a column, for a vertical rig."""
        enhanced = self.enhanced
        with self.timed("rectify"):
            return self._stages.rectify(enhanced)

    @cached_property
    def disparity(self) -> DisparityMap:
        """Of the left rectified image, with its uncertainty and reasons, px."""
        rectified = self.rectified
        with self.timed("match"):
            return self._stages.match(rectified)

    @cached_property
    def depth(self) -> DepthMap:
        """Of the left rectified image; m where the scale is known."""
        disparity = self.disparity
        with self.timed("depth"):
            return self._stages.reconstruct.depth(disparity)

    @cached_property
    def cloud(self) -> PointCloud:
        """A point a pixel."""
        depth = self.depth
        with self.timed("cloud"):
            return self._stages.reconstruct.cloud(depth, self._stages.reconstruct.texture(self.rectified))

    @cached_property
    def thinned(self) -> PointCloud:
        """A point a voxel."""
        cloud = self.cloud
        with self.timed("cloud"):
            return self._stages.reconstruct.thin(cloud)

    @cached_property
    def surface(self) -> Surface:
        """The textured mesh."""
        depth = self.depth
        with self.timed("surface"):
            return self._stages.reconstruct.surface(depth, self._stages.reconstruct.texture(self.rectified))

    @property
    def kept(self) -> DisparityFrame:
        """What is measured in: disparities that the depth filter left."""
        found = self.disparity
        there = np.isfinite(self.depth.depth) & np.isfinite(found.disparity)
        disparity, sigma = (np.where(there, x, np.float32(np.nan)) for x in (found.disparity, found.sigma))
        return DisparityFrame(self.depth.stamp_ns, self.rectified.left, disparity, sigma, self.depth.geometry)

    @property
    def modelled(self) -> DisparityFrame:
        """What models are made of: `kept`, by parts of a pixel as the images have it."""
        kept, pair = self.kept, self.rectified
        if pair.geometry.axis != "horizontal":
            return kept
        disparity, _ = refine_below_a_pixel(pair.left, pair.right, kept.disparity, kept.sigma)
        return replace(kept, disparity=disparity)  # the correction's own sigma is too small behind a codec and in mud

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What is to be known of the images and their rows."""
        return self.enhanced.findings + self.rectified.quality.warnings

    @property
    def stages_seconds(self) -> dict[str, float]:
        """Wall time of each stage so far, s."""
        return self.timed.seconds


class Pipeline:
    """All four stages; the last pair, and the rig's rectification, are remembered from pair to pair.

    Parameters
    ----------
    params : PipelineParams
    """

    def __init__(self, params: PipelineParams) -> None:
        rig, rectify = RigTracker(params.rectify), Rectify(params.rectify)
        self._stages = Stages(
            PreprocessSequence(params.preprocess),
            lambda pair: rectify(pair, rig.update(pair)),
            Match(params.match),
            Reconstruct(params.reconstruct),
        )

    def begin(self, pair: StereoPair, announce: Announce | None = None) -> Products:
        """Take a pair, and make nothing of it yet.

        What is remembered is what was asked for, in the order in which it was: ask for `Products.rectified` before the
        next pair begins.

        Parameters
        ----------
        pair : StereoPair
        announce : callable or None
            Told the name of each stage as it begins.
        """
        return Products(pair, self._stages, Stopwatch(announce))

    def __call__(self, pair: StereoPair) -> Products:
        """Enhance and rectify the next pair; what follows is made when it is asked for.

        Raises
        ------
        ReconError
            What the images or the calibration did not allow, with the numbers.
        """
        products = self.begin(pair)
        _ = products.rectified
        return products
