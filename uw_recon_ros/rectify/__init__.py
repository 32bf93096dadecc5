"""Rectification (paper 2.2): matching pixels onto common rows, with a calibration or without."""

from uw_recon_ros.lazy_import import make_callable
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.stage import Rectify
from uw_recon_ros.rectify.tie_points import TiePoints, find_tie_points
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.rectify.uncalibrated import estimate_rectification

__all__ = [
    "Rectification",
    "Rectify",
    "RectifyParams",
    "RigTracker",
    "TiePoints",
    "estimate_rectification",
    "find_tie_points",
    "rectification_from_calibration",
]

make_callable(__name__, "uw_recon_ros.api")
