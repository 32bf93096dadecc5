"""Calibrations of a stereo rig: read, written, and judged in one place for every door."""

from uw_recon_ros.calibration.camera_info import camera_from_info, read_calibration, write_calibration
from uw_recon_ros.calibration.model import as_imaged, make_camera

__all__ = ["as_imaged", "camera_from_info", "make_camera", "read_calibration", "write_calibration"]
