"""A dive along a track: the frames that arrive, the rig as it is told, the surface as it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.simulate.bottom import make_bottom, moved, without_movers
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import CourseParams, SimulateParams
from uw_recon_ros.simulate.ray_casting import cast
from uw_recon_ros.simulate.rig import Pose
from uw_recon_ros.simulate.scene import Scene
from uw_recon_ros.simulate.tracks import Course
from uw_recon_ros.trajectory import Trajectory, pose_matrix, trajectory_of
from uw_recon_ros.types import FloatImage, Matrix, StereoCalibration

_SURFACE_STEP_M = 0.01


class SurveyDive(Dive):
    """All frames of a dive along a track.

    Parameters
    ----------
    params : SimulateParams
    course : CourseParams
    """

    def __init__(self, params: SimulateParams, course: CourseParams) -> None:
        self.course = Course(params, course)
        super().__init__(params, make_bottom(self.course))

    def pose_after(self, seconds: float) -> Pose:
        """Of the left optical frame, `seconds` after the first frame."""
        return self.course.pose(seconds)

    def still_scene(self, seconds: float) -> Scene:
        """The scene, things that crawl where they are by then."""
        return moved(self.scene, self.course.course.movers, seconds)

    def gain(self, index: int) -> float:
        """Exposure of a frame relative to the first."""
        return self.course.gain(index)

    def smear(self, light: FloatImage, index: int) -> FloatImage:
        """Motion blur of the frames that have one."""
        length = self.course.blur_px(index)
        return light if length < 1 else _smeared(light, length, 0.7 * index)

    def taken(self) -> list[int]:
        """Numbers of the frames that arrive."""
        return self.course.taken()

    @property
    def told_calibration(self) -> StereoCalibration:
        """What the bag says of the rig: the truth, with the errors that were asked for."""
        c = self.course.course
        return with_calibration_errors(
            self.calibration, self.params.axis, c.told_disparity_offset_px, c.told_focal_percent
        )

    def true_trajectory(self) -> Trajectory:
        """Of the left optical frame, at the frames that arrive."""
        poses = [self.pose(k) for k in self.taken()]
        stack = np.array([pose_matrix(pose.position, pose.rotation) for pose in poses])
        return trajectory_of([self.stamp_ns(k) for k in self.taken()], stack)


def _smeared(light: FloatImage, length_px: float, angle: float) -> FloatImage:
    half = math.ceil(length_px / 2)
    line = np.zeros((2 * half + 1, 2 * half + 1), np.float32)
    for t in np.linspace(-length_px / 2, length_px / 2, 8 * half):
        line[round(half + t * math.sin(angle)), round(half + t * math.cos(angle))] += 1
    return np.asarray(cv2.filter2D(light, -1, line / line.sum(), borderType=cv2.BORDER_REFLECT), np.float32)


def with_calibration_errors(
    true: StereoCalibration, axis: str, offset_px: float, focal_percent: float
) -> StereoCalibration:
    """The calibration with errors: every disparity `offset_px` too large, the focal lengths wrong."""
    share = 1 + focal_percent / 100
    cameras = []
    for camera, moves in ((true.left, 0.0), (true.right, offset_px)):
        k, p = camera.k.copy(), camera.p.copy()
        k[0, 0], k[1, 1] = k[0, 0] * share, k[1, 1] * share
        p[0, 0], p[1, 1], p[:2, 3] = p[0, 0] * share, p[1, 1] * share, p[:2, 3] * share
        k[(0, 2) if axis == "horizontal" else (1, 2)] += moves
        cameras.append(replace(camera, k=k, p=p))
    return StereoCalibration(cameras[0], cameras[1])


def write_surface(path: str | Path, dive: SurveyDive, step_m: float = _SURFACE_STEP_M) -> None:
    """Write what lies below the track as it is seen from above: a PLY mesh, world coordinates, without movers."""
    mesh = trimesh.Trimesh(*surface_mesh(dive, step_m), process=False)
    write_bytes(path, bytes(mesh.export(file_type="ply")))


def surface_mesh(dive: SurveyDive, step_m: float) -> tuple[Matrix, NDArray[np.int64]]:
    """(N, 3) vertices, m, and (M, 3) triangles of what lies below the track, as it is seen from above."""
    x, y, z = surface_grid(dive, step_m)
    rows, columns = z.shape
    corner = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    faces = np.concatenate([
        np.stack([corner, corner + 1, corner + columns], axis=1),
        np.stack([corner + 1, corner + columns + 1, corner + columns], axis=1),
    ])  # fmt: skip
    return np.stack([*np.meshgrid(x, y), z], axis=-1).reshape(-1, 3), faces


def surface_grid(dive: SurveyDive, step_m: float) -> tuple[Matrix, Matrix, Matrix]:
    """Places x (W,), y (H,) and height z (H, W) below everything a camera of the dive may see, m."""
    p = dive.params
    track = dive.true_trajectory().positions
    margin = 1.2 * p.distance_m
    low, high = track[:, :2].min(axis=0) - margin, track[:, :2].max(axis=0) + margin
    x, y = (np.arange(low[k], high[k], step_m) for k in (0, 1))
    scene = without_movers(dive.scene, dive.course.course.movers)
    top = float(max(scene.grid[3], 0.0)) + 1.5
    return x, y, np.stack(list(_profiles(scene, x, y, top)))


def _profiles(scene: Scene, x: Matrix, y: Matrix, top: float) -> Iterator[Matrix]:
    """Heights along x, for each y: rays that fall straight down."""
    down, limit = np.array([[0.0, 0.0, -1.0]]), np.array([top + 10.0])
    for north in y:
        row = np.empty(len(x))
        for column, east in enumerate(x):
            origin = np.array([east, north, top])
            row[column] = top - cast(scene.heights, scene.grid, scene.blocks, scene.objects, origin, down, limit)[0]
        yield row
