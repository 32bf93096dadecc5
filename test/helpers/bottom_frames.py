"""Views of a flat bottom from straight above, exact by construction: a picture moved, turned and scaled."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.trajectory import DisparityFrame, pose_matrix
from uw_recon_ros.types import ByteImage, Matrix, StereoGeometry

WIDTH, HEIGHT, FOCAL, BASELINE = 320, 240, 250.0, 0.1
GEOMETRY = StereoGeometry(FOCAL, (WIDTH - 1) / 2, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, BASELINE)
HEIGHT_M = 1.2
METRE_PX = 250.0  # of the picture of the bottom
SECOND = 1_000_000_000


def bottom(size: int = 1600, seed: int = 0) -> ByteImage:
    """A gray bottom with structure at every scale."""
    random = np.random.default_rng(seed)
    image = np.zeros((size, size), np.float32)
    for blur in (1.2, 3.0, 9.0):
        noise = cv2.GaussianBlur(random.normal(size=image.shape).astype(np.float32), (0, 0), blur)
        image += noise / noise.std()
    return np.clip(128 + 35 * image, 1, 255).astype(np.uint8)


def tiled_bottom(tile_px: int = 60, size: int = 1600) -> ByteImage:
    """The same tile over and over."""
    tile = bottom(tile_px)
    tile[:3], tile[:, :3] = 20, 20
    count = -(-size // tile_px)
    return np.tile(tile, (count, count))[:size, :size]


def pose_at(x: float, y: float, height: float = HEIGHT_M, yaw: float = 0.0) -> Matrix:
    """World (z up, zero on the bottom) <- camera that looks straight down, `yaw` radians about its line of sight."""
    c, s = np.cos(yaw), np.sin(yaw)
    down = np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, -1.0]])
    return pose_matrix(np.array([x, y, height]), down @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]))


def view(picture: ByteImage, pose: Matrix, stamp_ns: int, geometry: StereoGeometry = GEOMETRY) -> DisparityFrame:
    """What a camera at `pose` sees: pixel (u, v) to the bottom's point, to the picture (its middle is x = y = 0)."""
    k = geometry.intrinsics_left
    rotation, place = pose[:3, :3], pose[:3, 3]
    onto = np.array([[METRE_PX, 0, picture.shape[1] / 2], [0, -METRE_PX, picture.shape[0] / 2], [0, 0, 1.0]])
    # a ray meets the bottom at place - place_z / ray_z ray
    ground = np.array([[1, 0, -place[0] / place[2]], [0, 1, -place[1] / place[2]], [0, 0, -1 / place[2]]])
    homography = onto @ ground @ rotation @ np.linalg.inv(k)
    left = cv2.warpPerspective(
        picture, homography, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderValue=0
    )
    disparity = np.full((HEIGHT, WIDTH), geometry.focal_times_baseline / place[2], np.float32)
    return DisparityFrame(
        stamp_ns, np.repeat(left[..., None], 3, axis=2), disparity, np.full_like(disparity, 0.1), geometry
    )
