"""The numbers of a bundle as a calibration, and depths computed with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np

from uw_recon_ros.calibrate.optics import EXTRINSIC, PROJECTIONS, SIDES, intrinsic_matrix, shape_of
from uw_recon_ros.calibration.stereo_pose import Lens, Parts
from uw_recon_ros.lenses import PLUMB_BOB
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, undistorted
from uw_recon_ros.types import Axis, Mask, Matrix, StereoCalibration

_GRID = 5  # directions across the image, each way
FRAMES = ("stereo_left_optical_frame", "stereo_right_optical_frame")


def at_range(k: Matrix, size: tuple[int, int], range_m: float) -> Matrix:
    """(25, 3) places at a depth, evenly over the view of a pinhole camera (3, 3), m."""
    width, height = size
    u, v = np.meshgrid(np.linspace(0, width - 1, 2 * _GRID + 1)[1::2], np.linspace(0, height - 1, 2 * _GRID + 1)[1::2])
    places: Matrix = range_m * np.linalg.solve(k, np.stack([u.ravel(), v.ravel(), np.ones(u.size)])).T
    return places


def inside(pixels: Matrix, size: tuple[int, int]) -> Mask:
    """(N,) which pixels an image has."""
    with np.errstate(invalid="ignore"):
        return np.asarray(np.all((pixels >= 0) & (pixels <= np.array(size) - 1), axis=1), np.bool_)


@dataclass(frozen=True, eq=False)
class RigNumbers:
    """A rig's numbers, read.

    Parameters
    ----------
    numbers : (24,) float64
        See `calibrate.optics`.
    size : (width, height)
        Of both images, px.
    lens : {'plumb_bob', 'equidistant'}
    """

    numbers: Matrix
    size: tuple[int, int]
    lens: str = PLUMB_BOB

    @property
    def right_center(self) -> Matrix:
        """Of the right camera in the left one's frame, (3,) m."""
        centre: Matrix = -self._turn.T @ self.numbers[EXTRINSIC][3:]
        return centre

    @property
    def _turn(self) -> Matrix:
        return np.asarray(cv2.Rodrigues(self.numbers[EXTRINSIC][:3])[0], np.float64)

    @property
    def baseline_m(self) -> float:
        """Distance between the cameras, m."""
        return float(np.linalg.norm(self.right_center))

    @property
    def axis(self) -> Axis:
        """Direction of the baseline in the images."""
        along = np.abs(self.right_center)
        return "horizontal" if along[0] >= along[1] else "vertical"

    @property
    def exchanged(self) -> bool:
        """Whether the right camera stands on the left; a vertical rig may have its second camera on either side."""
        return self.axis == "horizontal" and self.right_center[0] < 0

    @cached_property
    def calibration(self) -> StereoCalibration:
        """As ROS has it: K and D of both, R and P that rectify."""
        left, right = (
            Lens(self.size, intrinsic_matrix(camera), shape_of(camera, self.lens), self.lens, frame)
            for camera, frame in zip((self.numbers[side] for side in SIDES), FRAMES, strict=True)
        )
        return Parts(left, right, self._turn, self.numbers[EXTRINSIC][3:]).rig()

    def moved(self, by: Matrix) -> RigNumbers:
        """The rig of numbers that differ by (24,)."""
        return replace(self, numbers=self.numbers + by)

    def common_view(self, range_m: float) -> tuple[Matrix, Matrix, Matrix]:
        """Places at a depth that both cameras see: points (N, 3) m in the left frame, and their pixels (N, 2)."""
        points, nowhere = at_range(self.calibration.left.k, self.size, range_m), np.zeros(6)
        left, right = (project(self.numbers, nowhere, points)[0] for project in PROJECTIONS[self.lens])
        seen = inside(left, self.size) & inside(right, self.size)
        return points[seen], left[seen], right[seen]

    def located(self, left: Matrix, right: Matrix) -> Matrix:
        """Points seen by both cameras, by the disparity of their rectified pixels, as a matcher would.

        Parameters
        ----------
        left, right : (N, 2) float64
            Raw px.

        Returns
        -------
        (N, 3) float64
            In the left camera's frame, m; NaN where pixels lead nowhere.
        """
        rays = []
        for camera, pixels in zip((self.calibration.left, self.calibration.right), (left, right), strict=True):
            view = RectifiedCamera.of_camera(camera)
            rays.append(np.c_[undistorted(view, pixels), np.ones(len(pixels))] @ camera.r.T)
        along = 0 if self.axis == "horizontal" else 1
        one, other = (ray[:, :2] / ray[:, 2:] for ray in rays)
        signed = -self.calibration.right.p[along, 3] / self.calibration.right.p[along, along]
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = signed / (one[:, along] - other[:, along])
        points: Matrix = (depth[:, None] * np.c_[one, np.ones(len(one))]) @ self.calibration.left.r
        return points
