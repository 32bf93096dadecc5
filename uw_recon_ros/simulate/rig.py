"""The simulated rig: two lenses that are not quite alike, mounted not quite straight, and the way it swims."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import cast

import numpy as np

from uw_recon_ros.calibration.stereo_pose import rectifying_views
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.types import Axis, CameraModel, Matrix, StereoCalibration, StereoGeometry

LEFT_FRAME = "simulated_left_optical_frame"
RIGHT_FRAME = "simulated_right_optical_frame"


@dataclass(frozen=True, eq=False)
class Rig:
    """Two cameras.

    Parameters
    ----------
    calibration : StereoCalibration
        The truth, told to nobody where ``calibrated`` is false.
    right_from_left : (3, 3) float64
        Rotation: x_right = right_from_left (x_left - right_center).
    right_center : (3,) float64
        Of the right camera in the left optical frame, m.
    geometry : StereoGeometry
        Of the rectified views that the calibration defines.
    """

    calibration: StereoCalibration
    right_from_left: Matrix
    right_center: Matrix
    geometry: StereoGeometry


@dataclass(frozen=True, eq=False)
class Pose:
    """Where the left optical frame is in the world: x_world = rotation x_left + position (m)."""

    rotation: Matrix
    position: Matrix


def make_rig(params: SimulateParams) -> Rig:
    """Mount two cameras; tolerances follow from the seed."""
    rng = np.random.default_rng([params.seed, 2])
    intrinsics = [_intrinsics(params, rng) for _ in range(2)]
    distortions = [_distortion(params, rng) for _ in range(2)]
    turn = np.deg2rad(params.misalignment_deg) * rng.uniform(-1.0, 1.0, 3)
    crooked = params.misalignment_deg / 0.7 * 0.012 * params.baseline_m * rng.uniform(-1.0, 1.0, 3)
    along = np.array([1.0, 0.0, 0.0]) if params.axis == "horizontal" else np.array([0.0, 1.0, 0.0])
    center = params.baseline_m * along + crooked
    right_from_left = rotation_about(turn)
    size, axis = (params.width, params.height), cast("Axis", params.axis)
    turns, projection, baseline = rectifying_views((intrinsics[0], intrinsics[1]), turn, center, axis, size)
    cameras = [
        CameraModel(params.width, params.height, k, d, r, _projection(projection, side * baseline, params.axis),
                    "plumb_bob", frame)
        for k, d, r, side, frame in zip(intrinsics, distortions, turns, (0, 1), (LEFT_FRAME, RIGHT_FRAME), strict=True)
    ]  # fmt: skip
    geometry = _geometry(projection, baseline, params.axis, turns[0])
    return Rig(StereoCalibration(cameras[0], cameras[1]), right_from_left, center, geometry)


def _intrinsics(params: SimulateParams, rng: np.random.Generator) -> Matrix:
    focal = params.width / 2 / math.tan(math.radians(params.fov_deg) / 2) * (1.0 + 0.004 * rng.uniform(-1.0, 1.0))
    cx, cy = (params.width - 1) / 2, (params.height - 1) / 2
    off = 0.008 * params.width * rng.uniform(-1.0, 1.0, 2)
    aspect = 1.0 + 0.001 * rng.uniform(-1.0, 1.0)
    return np.array([[focal, 0.0, cx + off[0]], [0.0, focal * aspect, cy + off[1]], [0.0, 0.0, 1.0]])


def _distortion(params: SimulateParams, rng: np.random.Generator) -> Matrix:
    k1 = -params.distortion * (1.0 + 0.05 * rng.uniform(-1.0, 1.0))
    tangential = 0.006 * params.distortion * rng.uniform(-1.0, 1.0, 2)
    return np.array([k1, 0.3 * k1 * k1, tangential[0], tangential[1], 0.0])


def rotation_about(axis_angle: Matrix) -> Matrix:
    """Rodrigues' formula: the rotation by ``|axis_angle|`` rad about its direction."""
    angle = float(np.linalg.norm(axis_angle))
    if angle < 1e-15:
        return np.eye(3)
    x, y, z = axis_angle / angle
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    rotation: Matrix = np.eye(3) + math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return rotation


def _projection(common: Matrix, baseline_m: float, axis: str) -> Matrix:
    shift = np.zeros((3, 1))
    shift[0 if axis == "horizontal" else 1, 0] = -common[0, 0] * baseline_m
    return np.hstack([common, shift])


def _geometry(common: Matrix, baseline_m: float, axis: str, turn: Matrix) -> StereoGeometry:
    along, across = (common[0, 2], common[1, 2]) if axis == "horizontal" else (common[1, 2], common[0, 2])
    rows = tuple(tuple(float(x) for x in row) for row in turn)
    return StereoGeometry(
        float(common[0, 0]), float(along), float(along), float(across), baseline_m,
        "horizontal" if axis == "horizontal" else "vertical", rect_from_raw_left=rows,
    )  # fmt: skip


def distort(points: Matrix, d: Matrix) -> Matrix:
    """Plumb-bob distortion of normalised image points (..., 2)."""
    x, y = points[..., 0], points[..., 1]
    k1, k2, p1, p2, k3 = d
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    moved_x = x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x)
    moved_y = y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y
    moved: Matrix = np.stack([moved_x, moved_y], axis=-1)
    return moved


def undistort(points: Matrix, d: Matrix) -> Matrix:
    """Inverse of `distort`, by Newton's method along the radius, to 1e-12."""
    found: Matrix = points.copy()
    for _ in range(100):
        r2 = (found**2).sum(axis=-1, keepdims=True)
        slope = 1.0 + r2 * (3.0 * d[0] + r2 * (5.0 * d[1] + 7.0 * r2 * d[4]))
        step = (points - distort(found, d)) / np.maximum(slope, 0.5)
        found += step
        if np.abs(step).max() < 1e-12:
            break
    return found


def pixel_directions(camera: CameraModel) -> Matrix:
    """Where each pixel of the raw image looks: (H, W, 3) unit vectors in the camera's optical frame."""
    u, v = np.meshgrid(np.arange(camera.width, dtype=np.float64), np.arange(camera.height, dtype=np.float64))
    k = camera.k
    points = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1]], axis=-1)
    return unit_directions(undistort(points, camera.d))


def pinhole_directions(intrinsics: Matrix, width: int, height: int) -> Matrix:
    """As `pixel_directions` for an ideal camera, e.g. a rectified view."""
    u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = np.linalg.solve(intrinsics, np.stack([u.ravel(), v.ravel(), np.ones(u.size)]))
    return unit_directions((rays[:2] / rays[2]).T.reshape(height, width, 2))


def unit_directions(points: Matrix) -> Matrix:
    """Unit vectors (..., 3) towards normalised image points (..., 2)."""
    rays = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
    unit: Matrix = rays / np.linalg.norm(rays, axis=-1, keepdims=True)
    return unit


def project(points: Matrix, camera: CameraModel) -> tuple[Matrix, Matrix]:
    """Raw pixel coordinates u, v of points (..., 3) in the camera's frame; NaN behind it."""
    with np.errstate(divide="ignore", invalid="ignore"):
        ideal = np.where(points[..., 2:] > 0, points[..., :2] / points[..., 2:], np.nan)
    moved = distort(ideal, camera.d)
    return moved[..., 0] * camera.k[0, 0] + camera.k[0, 2], moved[..., 1] * camera.k[1, 1] + camera.k[1, 2]


def looking_up(params: SimulateParams) -> Matrix:
    """Turn of the optical frame by ``look_up_deg``."""
    return rotation_about(np.array([math.radians(params.look_up_deg), 0.0, 0.0]))


def pose_at(params: SimulateParams, seconds: float) -> Pose:
    """Where the rig is: it passes the scene sideways, in the swell."""
    duration = (params.frames - 1) / params.rate_hz
    track = params.speed_m_s * (seconds - duration / 2)
    swell = 2 * math.pi * seconds / 7.0
    pitch = math.radians(params.pitch_deg)
    level = np.array(
        [[1.0, 0.0, 0.0], [0.0, -math.sin(pitch), math.cos(pitch)], [0.0, -math.cos(pitch), -math.sin(pitch)]]
    )
    moving = min(params.speed_m_s / 0.08, 1.0)
    angles_deg = (1.2 * math.sin(swell), 1.6 * math.sin(0.7 * swell + 1.0), 0.8 * math.sin(1.3 * swell))
    sway = rotation_about(moving * np.deg2rad(angles_deg))
    rotation = level @ looking_up(params) @ sway
    target = np.array([track, 0.0, 0.0])
    bob = moving * np.array([0.0, 0.015 * math.sin(0.8 * swell), 0.02 * math.sin(swell + 0.5)])
    return Pose(rotation, target + bob - params.distance_m * level[:, 2])
