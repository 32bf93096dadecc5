"""What a live model can be told."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param


@dataclass(frozen=True)
class LiveModelParams(Params):
    """How finely the dive is modelled while it goes on."""

    model_voxel_m: float = param(0.02, "Side of a voxel.", unit="m", low=0.001, high=10.0)
    model_keyframe_m: float = param(0.1, "Way after which a frame is fused again.", unit="m", low=0.0, high=100.0)
    model_keyframe_deg: float = param(5.0, "Turn after which one is.", unit="deg", low=0.0, high=180.0)
    model_submap_frames: int = param(15, "Fused frames of a submap, which stays rigid.", low=2, high=1000)
    model_loop_m: float = param(
        0.3, "Way between frames whose place is recognised when it is seen again; 0: no loops.", unit="m", low=0.0,
        high=100.0,
    )  # fmt: skip
    model_most_points: int = param(200_000, "Points of model/points at most.", low=1000, high=10_000_000)
    model_most_triangles: int = param(30_000, "Triangles of model/surface at most.", low=100, high=1_000_000)
