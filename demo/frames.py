"""What came of one frame: messages turned back into the pipeline's own types, and compared with the truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from uw_recon_ros.bags.reader import open_bag
from uw_recon_ros.calibration import camera_from_info
from uw_recon_ros.images import to_gray
from uw_recon_ros.report.numbers import DepthErrors, depth_errors
from uw_recon_ros.ros.geometry import geometry_from_infos
from uw_recon_ros.ros.messages import disparity_from_message, float_image_from_message, image_from_message
from uw_recon_ros.ros.pairs import color_image
from uw_recon_ros.simulate.truth import rectify_depth
from uw_recon_ros.types import (
    ByteImage,
    CameraModel,
    DepthMap,
    DisparityMap,
    FloatImage,
    RectificationQuality,
    RectifiedPair,
    StereoGeometry,
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
        with open_bag(bag) as reader:
            depth = dict(reader.depth_images())
            camera = next((camera_from_info(info) for _, info in reader.messages(["/truth/left/camera_info"])), None)
        if camera is None or not depth:
            raise SystemExit(f"demo: {bag}: expected the topics /truth/depth and /truth/left/camera_info")
        return cls(camera, depth)

    def in_rectified_view(self, stamp_ns: int, geometry: StereoGeometry, shape: tuple[int, ...]) -> FloatImage:
        """True depth of the rectified left view: (H, W) float32, m along its optical axis."""
        return rectify_depth(self.depth[stamp_ns], self.camera, geometry, shape[1], shape[0])


def read_frame(stamp_ns: int, got: dict[str, Any], truth: Truth) -> Frame:
    """Put the messages of one stamp together."""
    geometry = geometry_from_infos(got["rectified/left/camera_info"], got["rectified/right/camera_info"])
    left, right = (color_image(got[f"rectified/{side}/image_rect_color"]) for side in ("left", "right"))
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
