"""What came of one frame: messages turned back into the pipeline's own types, and compared with the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uw_recon_ros.bags.messages import decode
from uw_recon_ros.bags.reader import open_bag
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.images import to_gray
from uw_recon_ros.report.numbers import DepthErrors, depth_errors
from uw_recon_ros.ros.disparity import disparity_from_message
from uw_recon_ros.ros.geometry import geometry_from_infos
from uw_recon_ros.ros.messages import float_image_from_message, image_from_message
from uw_recon_ros.ros.pairs import color_image
from uw_recon_ros.types import (
    ByteImage,
    CameraModel,
    DepthMap,
    DisparityMap,
    FloatImage,
    RectificationQuality,
    RectifiedPair,
)


@dataclass(frozen=True, eq=False)
class Frame:
    """One frame as the graph published it.

    Parameters
    ----------
    stamp_ns : int
    enhanced : (left, right)
        (H, W, 3) uint8 RGB.
    rectified : RectifiedPair
    disparity : DisparityMap
    depth : DepthMap
    truth : (H, W) float32
        True depth of the left rectified view, m; NaN = unknown.
    """

    stamp_ns: int
    enhanced: tuple[ByteImage, ByteImage]
    rectified: RectifiedPair
    disparity: DisparityMap
    depth: DepthMap
    truth: FloatImage

    @property
    def errors(self) -> DepthErrors:
        """Depth against the truth."""
        return depth_errors(self.depth, self.truth)


@dataclass(frozen=True, eq=False)
class Truth:
    """The true depth of every raw left image of a simulated bag, by stamp."""

    camera: CameraModel
    depth: dict[int, FloatImage]

    @classmethod
    def read(cls, bag: Path) -> Truth:
        """Read the truth topics of a bag made by ``uw_recon simulate``."""
        depth: dict[int, FloatImage] = {}
        camera = None
        with open_bag(bag) as reader:
            for raw in reader.raw_messages(["/truth/depth", "/truth/left/camera_info"]):
                message = decode(raw)
                if raw.topic == "/truth/depth":
                    shape = message.height, message.width
                    depth[_stamp_ns(message)] = np.frombuffer(message.data, "<f4").reshape(shape)
                else:
                    camera = camera_from_info(message)
        if camera is None or not depth:
            raise SystemExit(f"demo: {bag}: expected the topics /truth/depth and /truth/left/camera_info")
        return cls(camera, depth)

    def in_rectified_view(self, stamp_ns: int, geometry: Any, shape: tuple[int, ...]) -> FloatImage:
        """Look the truth up along the rays of the rectified left view: (H, W) float32, m along its optical axis."""
        v, u = np.indices(shape[:2], np.float64)
        pixels = np.stack([u.ravel(), v.ravel(), np.ones(u.size)])
        turned = np.array(geometry.rect_from_raw_left).T @ np.linalg.solve(geometry.intrinsics_left, pixels)
        rays = turned / turned[2]
        raw, _ = cv2.projectPoints(rays.T, np.zeros(3), np.zeros(3), self.camera.k, self.camera.d)
        raw_map = raw.reshape(*shape[:2], 2).astype(np.float32)
        depth = cv2.remap(self.depth[stamp_ns], raw_map, None, cv2.INTER_NEAREST, borderValue=float("nan"))
        along: FloatImage = (depth / turned[2].reshape(shape[:2])).astype(np.float32)
        return along


def _stamp_ns(message: Any) -> int:
    return int(message.header.stamp.sec) * 1_000_000_000 + int(message.header.stamp.nanosec)


def read_frame(stamp_ns: int, got: dict[str, Any], truth: Truth) -> Frame:
    """Put the messages of one stamp together."""
    geometry = geometry_from_infos(got["rectified/left/camera_info"], got["rectified/right/camera_info"])
    left, right = (color_image(got[f"rectified/{eye}/image_rect_color"]) for eye in ("left", "right"))
    disparity = disparity_from_message(
        got["disparity"], geometry, sigma=got["disparity/sigma"], status=got["disparity/status"]
    )
    depth = DepthMap(
        float_image_from_message(got["depth/image_rect"]),
        float_image_from_message(got["depth/sigma"]),
        disparity.status,
        geometry,
        stamp_ns,
        got["depth/image_rect"].header.frame_id,
    )
    quality = RectificationQuality("calibrated")
    rectified = RectifiedPair(left, right, to_gray(left), to_gray(right), geometry, quality, stamp_ns=stamp_ns)
    enhanced = (image_from_message(got["left/image_enhanced"]), image_from_message(got["right/image_enhanced"]))
    return Frame(
        stamp_ns, enhanced, rectified, disparity, depth, truth.in_rectified_view(stamp_ns, geometry, left.shape)
    )
