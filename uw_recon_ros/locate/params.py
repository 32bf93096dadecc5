"""What can be chosen about the whole way."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.params import Params, param


@dataclass(frozen=True)
class LocateParams(Params):
    """Loops, self-calibration, what is done without any prior."""

    loops_a_frame: int = param(3, "Loops tried for each frame at most; 0 = none.", low=0, high=50)
    loop_inliers: int = param(30, "Matches that make a loop.", low=10, high=1000)
    bundle: bool = param(True, "Whether frames that show the same places are adjusted together in the end.")
    self_calibrate: bool = param(True, "Whether a significant error of the given calibration is corrected.")
    level: bool = param(True, "Whether the bottom's plane is laid level where nothing says which way is down.")
