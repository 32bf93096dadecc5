"""Calibrations of a stereo rig: one camera's numbers, and the one judge of a rig for every door."""

from uw_recon_ros.calibration.camera_info import camera_from_info
from uw_recon_ros.calibration.model import as_imaged, make_camera, scaled

__all__ = ["as_imaged", "camera_from_info", "make_camera", "scaled"]
