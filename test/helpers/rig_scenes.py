"""Stereo rigs of known truth: cameras, points in front of them, and what they see of those points."""

from __future__ import annotations

import functools
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial.transform import Rotation

from uw_recon_ros.rectify import TiePoints
from uw_recon_ros.types import CameraModel, EnhancedPair, StereoCalibration

Array = NDArray[np.float64]
NO_DISTORTION = np.zeros(5)
_WATER_INDEX = 1.333


@dataclass(frozen=True, eq=False)
class Camera:
    """``x_camera = rotation @ x_world + translation``, then `k`, with the distortion written out by hand here."""

    k: Array
    rotation: Array
    translation: Array
    d: Array = field(default_factory=NO_DISTORTION.copy)
    model: str = "plumb_bob"

    def project(self, points: Array) -> Array:
        x, y, z = (points @ self.rotation.T + self.translation).T
        x, y = distort(x / z, y / z, self.d, self.model)
        return np.column_stack([self.k[0, 0] * x + self.k[0, 2], self.k[1, 1] * y + self.k[1, 2]])


def distort(x: Array, y: Array, d: Array, model: str) -> tuple[Array, Array]:
    r2 = x * x + y * y
    if model == "equidistant":
        r = np.maximum(np.sqrt(r2), 1e-12)
        theta = np.arctan(r)
        scale = theta * (1 + d[0] * theta**2 + d[1] * theta**4 + d[2] * theta**6 + d[3] * theta**8) / r
        return x * scale, y * scale
    k1, k2, p1, p2, k3, k4, k5, k6 = [*d, *np.zeros(8 - len(d))]
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    return (
        x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
        y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
    )


@dataclass(frozen=True, eq=False)
class Rig:
    """A pair of cameras; the world is the left optical frame."""

    left: Camera
    right: Camera
    width: int
    height: int

    def see(self, points: Array, noise: float = 0.0, seed: int = 0) -> tuple[Array, Array, Array]:
        """Pixels in both images and the points, of those points that both images show."""
        left, right = self.left.project(points), self.right.project(points)
        rng = np.random.default_rng(seed)
        left, right = left + rng.normal(0, noise, left.shape), right + rng.normal(0, noise, right.shape)
        size = np.array([self.width - 1, self.height - 1])
        inside = ((left >= 0) & (left <= size) & (right >= 0) & (right <= size)).all(axis=1)
        return left[inside], right[inside], points[inside]


def intrinsics(width: int, height: int, focal: float) -> Array:
    return np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])


def make_rig(
    *,
    width: int = 640,
    height: int = 480,
    focal: float = 620.0,
    angles_deg: tuple[float, float, float] = (0.0, 0.0, 0.0),
    center: tuple[float, float, float] = (0.15, 0.0, 0.0),
    d: Array = NO_DISTORTION,
    model: str = "plumb_bob",
) -> Rig:
    """The right camera stands at `center`, m, in the left optical frame, turned by `angles_deg` about x, y, z."""
    k = intrinsics(width, height, focal)
    rotation = Rotation.from_euler("xyz", angles_deg, degrees=True).as_matrix()
    right = Camera(k, rotation, -rotation @ np.array(center), d, model)
    return Rig(Camera(k, np.eye(3), np.zeros(3), d, model), right, width, height)


def random_rig(seed: int, *, angle_deg: float = 2.0, vertical: bool = False) -> Rig:
    """A rig as divers build them: cameras nearly side by side (or one above the other), nearly parallel."""
    rng = np.random.default_rng(seed)
    width, height = (640, 480) if rng.random() < 0.5 else (1280, 720)
    along, small = rng.uniform(0.08, 0.25), rng.normal(0, 0.03, 2)
    center = along * (np.array([small[0], 1, small[1]]) if vertical else np.array([1, small[0], small[1]]))
    angles = tuple(rng.normal(0, angle_deg, 3))
    return make_rig(
        width=width, height=height, focal=width * rng.uniform(0.7, 1.3), angles_deg=angles, center=tuple(center)
    )


def scatter(rig: Rig, count: int, near: float, far: float, seed: int = 0) -> Array:
    """`count` points spread over the left image, inverse depth uniform between `near` and `far`, m."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((0, 0), (rig.width - 1, rig.height - 1), (count, 2))
    depth = 1 / rng.uniform(1 / far, 1 / near, count)
    rays = np.column_stack([pixels, np.ones(count)]) @ np.linalg.inv(rig.left.k).T
    return rays * depth[:, None]


def tie_points(
    rig: Rig, count: int = 300, near: float = 1.0, far: float = 3.0, noise: float = 0.3, seed: int = 0
) -> TiePoints:
    left, right, _ = rig.see(scatter(rig, count, near, far, seed), noise, seed)
    return TiePoints(left, right, rig.width, rig.height)


def tie_points_of(rig: Rig, points: Array, noise: float = 0.0, seed: int = 0) -> TiePoints:
    left, right, _ = rig.see(points, noise, seed)
    return TiePoints(left, right, rig.width, rig.height)


def rotated(points: TiePoints, quarter_turns: int) -> TiePoints:
    """As ``np.rot90(image, quarter_turns)`` moves them."""
    left, right, width, height = points.left, points.right, points.width, points.height
    for _ in range(quarter_turns % 4):
        left, right = (np.column_stack([p[:, 1], width - 1 - p[:, 0]]) for p in (left, right))
        width, height = height, width
    return TiePoints(left, right, width, height)


_TEXTURE_PX_PER_M = 300.0


@functools.cache
def _texture() -> NDArray[np.float32]:
    rng = np.random.default_rng(0)
    texture = np.zeros((1024, 1024), np.float32)
    for sigma in (1.2, 3.0, 9.0):
        layer = gaussian_filter(rng.normal(0, 1, texture.shape).astype(np.float32), sigma, mode="wrap")
        texture += layer / layer.std()
    return np.clip(128 + 35 * texture, 0, 255).astype(np.float32)


@dataclass(frozen=True, eq=False)
class Board:
    """A textured square, or a whole plane: ``normal @ x = distance``."""

    normal: Array
    distance: float
    middle: Array
    half_width: float
    shift: float


def boards(seed: int, count: int) -> list[Board]:
    """A back plane and `count` squares in front of it, 1 to 2 m away."""
    rng = np.random.default_rng(seed)
    scene = [Board(np.array([0.1, -0.05, 1.0]), 2.5, np.zeros(2), np.inf, rng.uniform(0, 1000))]
    for _ in range(count):
        normal = np.array([*rng.normal(0, 0.2, 2), 1.0])
        middle, half_width = rng.uniform((-1.0, -0.8), (1.0, 0.8)), rng.uniform(0.15, 0.35)
        scene.append(Board(normal, rng.uniform(1.1, 2.0), middle, half_width, rng.uniform(0, 1000)))
    return scene


def render(rig: Rig, *, count: int = 8, seed: int = 0) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """RGB images of textured boards by casting a ray a pixel; ``count = 0``: a flat scene. No distortion."""
    scene = boards(seed, count)
    return _render_camera(rig.left, rig, scene), _render_camera(rig.right, rig, scene)


def _render_camera(camera: Camera, rig: Rig, scene: list[Board]) -> NDArray[np.uint8]:
    v, u = np.mgrid[0 : rig.height, 0 : rig.width]
    rays = np.stack([u, v, np.ones_like(u)], axis=-1) @ np.linalg.inv(camera.k).T @ camera.rotation
    origin = -camera.rotation.T @ camera.translation
    depth, gray = np.full(u.shape, np.inf), np.zeros(u.shape, np.float32)
    for board in scene:
        along = (board.distance - board.normal @ origin) / (rays @ board.normal)
        hit = origin[:2] + along[..., None] * rays[..., :2]
        off = np.abs(hit - board.middle)
        seen = (along > 0) & (along < depth) & (off[..., 0] < board.half_width) & (off[..., 1] < board.half_width)
        place = ((hit * _TEXTURE_PX_PER_M + board.shift) % 1024).astype(np.float32)
        shade = cv2.remap(_texture(), place[..., 0], place[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        depth, gray = np.where(seen, along, depth), np.where(seen, shade, gray)
    return np.repeat(np.rint(gray).astype(np.uint8)[..., None], 3, axis=2)


def enhanced(
    left: NDArray[np.uint8], right: NDArray[np.uint8], calibration: StereoCalibration | None = None
) -> EnhancedPair:
    left, right = np.ascontiguousarray(left), np.ascontiguousarray(right)
    grays = [np.ascontiguousarray(image[..., 1]) for image in (left, right)]
    return EnhancedPair(left, right, *grays, stamp_ns=123, frame_id="left_optical_frame", calibration=calibration)


def calibration_of(rig: Rig, *, alpha: float = 0.0) -> StereoCalibration:
    """What a calibration program would write for a rig: rectified by OpenCV, the oracle."""
    left, right, size = rig.left, rig.right, (rig.width, rig.height)
    d = [NO_DISTORTION if side.model == "equidistant" else side.d for side in (left, right)]  # R, P do not depend on it
    r1, r2, p1, p2, *_ = cv2.stereoRectify(
        left.k, d[0], right.k, d[1], size, right.rotation, right.translation[:, None],
        flags=cv2.CALIB_ZERO_DISPARITY, alpha=alpha,
    )  # fmt: skip
    cameras = [
        CameraModel(rig.width, rig.height, side.k, np.asarray(side.d), r, p, side.model)
        for side, r, p in ((left, r1, p1), (right, r2, p2))
    ]
    return StereoCalibration(*cameras)


def through_flat_ports(rig: Rig, points: Array, noise: float = 0.2) -> TiePoints:
    """Snell's law at a thin port in front of each pinhole: ``sin(air) = 1.333 sin(water)``."""
    pixels = []
    rng = np.random.default_rng(0)
    for camera in (rig.left, rig.right):
        x, y, z = (points @ camera.rotation.T + camera.translation).T
        radius = np.hypot(x, y)
        air = np.arcsin(_WATER_INDEX * np.sin(np.arctan2(radius, z)))
        scale = np.tan(air) / radius
        pixels.append(np.column_stack([x * scale, y * scale]) * rig.left.k[0, 0] + camera.k[:2, 2])
        pixels[-1] += rng.normal(0, noise, pixels[-1].shape)
    inside = np.all([(p >= 0).all(axis=1) & (p <= [rig.width, rig.height]).all(axis=1) for p in pixels], axis=0)
    return TiePoints(pixels[0][inside], pixels[1][inside], rig.width, rig.height)
