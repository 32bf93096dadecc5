"""Calibrations in the forms people have: recognised by content, read by one function each; five are written."""

from uw_recon_ros.files.calibrations.read import FORMS, Paths, read_calibration
from uw_recon_ros.files.calibrations.write import WRITERS, write_calibration

__all__ = ["FORMS", "WRITERS", "Paths", "read_calibration", "write_calibration"]
