"""Where the left camera sits on the vehicle."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.params import Params, param
from uw_recon_ros.types import Matrix

#: Columns: the optical frame's x (right), y (down), z (ahead) in a body's x ahead, y left, z up (REP 103).
BODY_FROM_OPTICAL = np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])


@dataclass(frozen=True)
class MountParams(Params):
    """The vehicle's frame, and the left camera in it."""

    base_frame: str = param(
        "", "The vehicle's frame, x ahead, y left, z up (REP 103): of obstacles, range and odometry; empty: not known."
    )
    camera_x_m: float = param(0.0, "Left camera in base_frame, ahead.", unit="m", low=-100.0, high=100.0)
    camera_y_m: float = param(0.0, "Left camera in base_frame, to the left.", unit="m", low=-100.0, high=100.0)
    camera_z_m: float = param(0.0, "Left camera in base_frame, up.", unit="m", low=-100.0, high=100.0)
    camera_roll_deg: float = param(
        0.0,
        "Left camera turned about its line of sight, clockwise seen from behind.",
        unit="deg",
        low=-180.0,
        high=180.0,
    )
    camera_pitch_deg: float = param(
        0.0, "Left camera looking down by this; 0 looks ahead, 90 straight down.", unit="deg", low=-90.0, high=90.0
    )
    camera_yaw_deg: float = param(0.0, "Left camera turned to the left by this.", unit="deg", low=-180.0, high=180.0)

    @property
    def place(self) -> Matrix:
        """(3,) of the left camera in `base_frame`, m."""
        return np.array([self.camera_x_m, self.camera_y_m, self.camera_z_m])

    @property
    def base_from_optical(self) -> Matrix:
        """(3, 3) rotation from the left optical frame to `base_frame`: yaw, pitch, roll, each about the turned axis."""
        angles = [self.camera_yaw_deg, self.camera_pitch_deg, self.camera_roll_deg]
        rotation: Matrix = Rotation.from_euler("ZYX", angles, degrees=True).as_matrix() @ BODY_FROM_OPTICAL
        return rotation
