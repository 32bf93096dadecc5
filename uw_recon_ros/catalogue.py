"""Which node has which parameters: for reference tables, and to tell a misspelt name from one meant for a neighbour."""

from __future__ import annotations

from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.live.params import LiveModelParams
from uw_recon_ros.match.stage import MatchParams
from uw_recon_ros.node_params import (
    CalibrateNodeParams,
    CameraParams,
    CloudParams,
    DisparityMessageParams,
    ModelNodeParams,
    NodeParams,
    OdometryNodeParams,
    RateParams,
)
from uw_recon_ros.params import Params
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.reconstruct.obstacles import ObstacleParams
from uw_recon_ros.reconstruct.stage import ReconstructParams
from uw_recon_ros.rectify.stage import RectifyParams
from uw_recon_ros.track.params import OdometryParams

#: Stage nodes by name; `NodeParams` are every node's, and pipeline_node has all but `CloudParams`.
NODES: dict[str, tuple[type[Params], ...]] = {
    "preprocess_node": (PreprocessParams, CameraParams),
    "rectify_node": (RectifyParams,),
    "disparity_node": (MatchParams, DisparityMessageParams, RateParams),
    "point_cloud_node": (ReconstructParams, ObstacleParams, MountParams, DisparityMessageParams, CloudParams),
    "calibrate_node": (CalibrateNodeParams, CameraParams),
    "odometry_node": (OdometryNodeParams, OdometryParams, MountParams, DisparityMessageParams, CloudParams),
    "model_node": (ModelNodeParams, LiveModelParams, MountParams, DisparityMessageParams, CloudParams),
}
ALL_PARAMS: tuple[type[Params], ...] = tuple(dict.fromkeys([*(c for own in NODES.values() for c in own), NodeParams]))
