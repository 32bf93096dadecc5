"""`point_cloud_node`: disparity in; depth, clouds and surface out. Any matcher's DisparityImage will do.

| topic | type | |
| --- | --- | --- |
| `disparity` | stereo_msgs/DisparityImage | in |
| `disparity/sigma`, `disparity/status` | Image | in, where published |
| `disparity/confidence` | Image | in, where published, while obstacles or range are read |
| `rectified/left/image_rect_color` or `rectified/left/image_rect` | Image | in, while coloured outputs are read |
| `rectified/left/camera_info`, `rectified/right/camera_info` | CameraInfo | in, of the same stamp |
| `depth/image_rect`, `depth/sigma` | Image 32FC1 | out: m along the optical axis, NaN invalid |
| `depth/camera_info` | CameraInfo | out |
| `points2` | PointCloud2 | out: organised |
| `points2_filtered` | PointCloud2 | out: range-limited, thinned |
| `obstacles` | LaserScan | out, with `base_frame`: nearest trusted surface in each direction |
| `range` | Range | out, with `base_frame`: distance along one axis |
| `points_unscaled` | PointCloud2 | out instead of all of these, where no metric scale is known |
| `surface` | visualization_msgs/Marker | out: triangles, transient local |
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from uw_recon_ros.calibration.judge import judge_depths
from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.node_params import CloudParams, DisparityMessageParams
from uw_recon_ros.reconstruct.obstacles import FindObstacles, ObstacleParams
from uw_recon_ros.reconstruct.stage import TEXTURES, Reconstruct, ReconstructParams
from uw_recon_ros.ros.autopilot_report import TOPICS as FOR_AUTOPILOTS
from uw_recon_ros.ros.autopilot_report import AutopilotReport
from uw_recon_ros.ros.declared_topics import Input, input_topic, outputs_of
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.geometry import check_size, geometry_from_infos
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import (
    cloud_message,
    depth_messages,
    disparity_from_message,
    range_message,
    scan_message,
    surface_message,
)
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.pairs import color_image, expect_size
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.topics import SIDES, published_by
from uw_recon_ros.types import ByteImage, DepthMap, DisparityMap

_PICTURE = "rectified/left/image_rect_color"
INPUTS = (
    Input("status", (input_topic("disparity/status"),), "optional"),
    Input("sigma", (input_topic("disparity/sigma"),), "optional"),
    Input("confidence", (input_topic("disparity/confidence"),), "optional"),
    Input("left", (input_topic(_PICTURE), input_topic("rectified/left/image_rect"))),
    *(Input(f"{side}_info", (input_topic(f"rectified/{side}/camera_info"),)) for side in SIDES),
    Input("disparity", (input_topic("disparity"),)),
)
METRIC = tuple(topic.name for topic in published_by("point_cloud_node") if topic.metric)
COLORED = ("points2", "points2_filtered", "points_unscaled", "surface")
UNSCALED = "points_unscaled"
OUTPUTS = outputs_of("point_cloud_node")
_NO_SCALE = f"metric scale unknown: {UNSCALED} instead of depth and points2 (calibrate, or set baseline_m and focal_px)"
_NO_METRES = (
    "not published: no metric scale, the rig is not calibrated or metres are withheld; why stands in the diagnostics "
    "of what rectifies, under rectification, uncalibrated and codes"
)
_NO_BASE = (
    "not published: expected base_frame, got none; set it and where the left camera sits in it (camera_x_m to "
    "camera_yaw_deg)"
)


class CloudStage(NamedTuple):
    """The stage, and what is assumed of an outsider's disparities."""

    reconstruct: Reconstruct
    obstacles: FindObstacles
    assumed_sigma_px: float
    adjusted: bool


def obstacle_finder(params: ParameterSet) -> FindObstacles:
    """What finds obstacles, within the filtered cloud's limits."""
    cloud = params[ReconstructParams]
    return FindObstacles(params[ObstacleParams], params[MountParams], cloud.cloud_min_range, cloud.cloud_max_range)


def publish_obstacles(
    outputs: Outputs, report: AutopilotReport, find: FindObstacles, depth: DepthMap, disparity: DisparityMap
) -> None:
    """Tell an autopilot of what is trusted, and of nothing else."""
    if not outputs.wanted(*FOR_AUTOPILOTS):
        return
    if not find.mount.base_frame:
        report.frame(obstacles=_NO_BASE, range=_NO_BASE)  # no warning: recorders listen to everything
        return
    around, told = find.look(depth, disparity), {}
    if outputs.wanted("obstacles"):
        sectors = around.sectors()
        known = int(np.count_nonzero(np.isfinite(sectors.ranges)))
        told["obstacles"] = f"{known} of {len(sectors.ranges)} sectors told, the others unknown"
        if not known:
            told["obstacles"] = f"all sectors unknown: {around.why_no_sector()}"
        outputs.send("obstacles", lambda: scan_message(sectors))
    if outputs.wanted("range"):
        seen = around.along_axis()
        told["range"] = "told" if seen is not None else f"silent: {around.why_no_range()}"
        if seen is not None:
            outputs.send("range", lambda: range_message(seen))
    report.frame(**told)


def publish_reconstruction(
    outputs: Outputs, diagnostics: Diagnostics, report: AutopilotReport, stage: Reconstruct, find: FindObstacles,
    disparity: DisparityMap, left: ByteImage | None,
) -> None:  # fmt: skip
    """Compute what is listened to, and publish it: metres only where they are true; in colour only with `left`."""
    metric = disparity.geometry.metric
    diagnostics.say(scale="metric" if metric else "unknown")
    diagnostics.problem("scale", None if metric else _NO_SCALE)
    if not metric:
        report.frame(obstacles=_NO_METRES, range=_NO_METRES)
    if not outputs.wanted("surface", *(METRIC if metric else (UNSCALED,))):
        return
    depth = stage.depth(disparity)
    diagnostics.problem("depth", "; ".join(map(str, judge_depths(depth))) or None)
    if metric:
        image, sigma, info = depth_messages(depth)
        outputs.send("depth/camera_info", lambda: info)
        outputs.send("depth/sigma", lambda: sigma)
        outputs.send("depth/image_rect", lambda: image)
        if left is not None and outputs.wanted("points2", "points2_filtered"):
            cloud = stage.cloud(depth, left, normals=False)
            outputs.send("points2", lambda: cloud_message(cloud))
            outputs.send("points2_filtered", lambda: cloud_message(stage.thin(cloud)))
        publish_obstacles(outputs, report, find, depth, disparity)
    elif left is not None:
        outputs.send(UNSCALED, lambda: cloud_message(stage.cloud(depth, left, normals=False)))
    if left is not None:
        outputs.send("surface", lambda: surface_message(stage.surface(depth, left)))


class PointCloudNode(StageNode[CloudStage]):
    """Turns disparities into depth, clouds and surfaces."""

    def __init__(self, **options: Any) -> None:
        classes = (DisparityMessageParams, CloudParams, ReconstructParams, ObstacleParams, MountParams)
        super().__init__("point_cloud_node", classes=classes, inputs=INPUTS, outputs=OUTPUTS, **options)
        self._autopilot = AutopilotReport(self.diagnostics)

    def build(self, params: ParameterSet) -> CloudStage:
        """Make the stage."""
        adjusted = params[DisparityMessageParams].disparity_adjusted
        stage = Reconstruct(params[ReconstructParams])
        return CloudStage(stage, obstacle_finder(params), params[CloudParams].assumed_sigma_px, adjusted)

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Give the images room to wait for a disparity that takes its time."""
        self.inputs.assembler.memory_bytes = params[CloudParams].image_memory_mb * 1_000_000
        gray = params[ReconstructParams].texture == TEXTURES[1]
        self.inputs.accepts = lambda topic: not (gray and topic.name == _PICTURE)

    def adapt_to_listeners(self, outputs: Outputs) -> None:
        """Read an image only while something is coloured with it, and confidence only for autopilots."""
        uses = {"left": COLORED, "confidence": FOR_AUTOPILOTS}
        self.inputs.ignored = frozenset(name for name, topics in uses.items() if not outputs.wanted(*topics))

    def work(self, stage: CloudStage, group: Group, outputs: Outputs) -> int:
        """Reconstruct from one disparity."""
        geometry = geometry_from_infos(group["left_info"], group["right_info"])
        disparity = disparity_from_message(
            group["disparity"], geometry, sigma=group.get("sigma"), status=group.get("status"),
            confidence=group.get("confidence"), assumed_sigma_px=stage.assumed_sigma_px, adjusted=stage.adjusted,
        )  # fmt: skip
        left = color_image(group["left"]) if "left" in group else None
        if left is not None:
            expect_size("rectified left image", left, disparity.disparity)
        check_size(group["left_info"], disparity.disparity.shape)
        publish_reconstruction(
            outputs, self.diagnostics, self._autopilot, stage.reconstruct, stage.obstacles, disparity, left
        )
        return disparity.stamp_ns

    def say_unasked(self, outputs: Outputs) -> None:
        """Say why obstacles and range are silent, where no frame does."""
        self._autopilot.say(outputs, self.inputs.stall_s)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(PointCloudNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
