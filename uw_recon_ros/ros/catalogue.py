"""The parameters of every node, to tell a misspelt name from one meant for a neighbour."""

from __future__ import annotations

from uw_recon_ros.match.stage import MatchParams
from uw_recon_ros.params import Params
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.reconstruct.stage import ReconstructParams
from uw_recon_ros.rectify.stage import RectifyParams
from uw_recon_ros.ros.node_params import CameraParams, CloudParams, DisparityMessageParams, NodeParams

ALL_PARAMS: tuple[type[Params], ...] = (
    PreprocessParams,
    RectifyParams,
    MatchParams,
    ReconstructParams,
    NodeParams,
    CameraParams,
    DisparityMessageParams,
    CloudParams,
)
