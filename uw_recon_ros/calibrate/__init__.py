"""From pictures of a board to the calibration of a rig, and to what that calibration is worth."""

from uw_recon_ros.lazy_import import make_callable

make_callable(__name__, "uw_recon_ros.api")
