"""What a survey can be told, beside the stages' parameters."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.pairing import PAIR_TOLERANCE_MS
from uw_recon_ros.params import Params, param
from uw_recon_ros.recordings.options import is_clock_offset

#: What can be written, in the order of `SurveyParams.write`.
PRODUCTS = ("disparity", "depth", "clouds", "meshes", "views", "bag", "model")


@dataclass(frozen=True)
class SurveyParams(Params):
    """Which frames are reconstructed, and what is written of each."""

    every: int = param(1, "Reconstruct every Nth pair.", low=1, high=1_000_000)
    start: float = param(0.0, "Begin this long after the input's first pair; 0: with it.", unit="s", low=0.0, high=1e9)
    end: float = param(0.0, "End this long after the input's first pair; 0: at the end.", unit="s", low=0.0, high=1e9)
    max_frames: int = param(0, "Stop after this many pairs; 0: all.", low=0, high=100_000_000)
    left_topic: str = param("", "Image topic of the left camera; empty: found by type and name.")
    right_topic: str = param("", "Image topic of the right camera; empty: found by type and name.")
    pair_tolerance_ms: float = param(
        PAIR_TOLERANCE_MS,
        "Largest difference of stamps within a pair, as the nodes' parameter of that name.",
        unit="ms",
        low=0.0,
        high=1e3,
    )
    stills_rate: float = param(2.0, "Pairs per second of stills, which carry no stamps.", unit="Hz", low=1e-6, high=1e6)
    layout: str = param(
        "auto",
        "How both views lie in one image of stills and videos; auto: found, separate: each camera has its own.",
        choices=("auto", "separate", "side-by-side", "top-bottom", "row-interleaved", "mpo"),
    )
    clock_offset: str = param(
        "auto",
        "Seconds that the right camera's clock is ahead; auto: found from the images of two videos, 0 elsewhere.",
    )
    write: str = param(
        "disparity,depth,clouds,meshes,views,bag",
        "What is written of each pair, separated by commas.",
    )
    disparity_format: str = param("pfm", "PFM (invalid = inf) or float32 TIFF (NaN), in px.", choices=("pfm", "tiff"))
    depth_format: str = param(
        "tiff",
        "Float32 TIFF or PFM in m, or 16-bit PNG in mm with 0 = invalid, as ROS's 16UC1.",
        choices=("tiff", "pfm", "png"),
    )
    cloud_format: str = param("ply", "PLY with normals, or LAZ.", choices=("ply", "laz"))
    cloud_points: str = param("all", "A point a pixel, or one a voxel of cloud_voxel.", choices=("all", "thinned"))
    bag_topics: str = param("", "Topics of the output bag, separated by commas; empty: all the nodes have.")
    rig_frames: int = param(
        24, "Pairs, spread over the survey, from which the rig is estimated if it has no calibration.", low=1, high=1000
    )

    def check_together(self) -> None:
        """The time limits must leave something, and the products must be known."""
        if self.end and self.end <= self.start:
            raise ValueError(f"start, end: expected the first below the second, got {self.start:g} and {self.end:g} s")
        if not is_clock_offset(self.clock_offset):
            raise ValueError(f"clock_offset: expected auto or a number of seconds, got {self.clock_offset[:40]!r}")
        unknown = sorted(self.products - set(PRODUCTS))
        if unknown:
            raise ValueError(f"write: expected some of {', '.join(PRODUCTS)}, got {', '.join(unknown)}")

    @property
    def products(self) -> frozenset[str]:
        """The items of `write`."""
        return frozenset(name.strip() for name in self.write.split(",") if name.strip())

    @property
    def chosen_topics(self) -> frozenset[str]:
        """The items of `bag_topics`, without leading slash."""
        return frozenset(name.strip().lstrip("/") for name in self.bag_topics.split(",") if name.strip())
