"""`rectify_node`: enhanced images in, rectified ones out.

| topic | type | |
| --- | --- | --- |
| `left/image_enhanced`, `right/image_enhanced` | Image bgr8 | in, while `image_rect_color` is read |
| `left/image_matching`, `right/image_matching` | Image mono8 | in, where published; else luma of the enhanced images |
| `left/camera_info`, `right/camera_info` | CameraInfo | in, latest, where published; see `calibration_use` |
| `rectified/left/image_rect`, `rectified/right/image_rect` | Image mono8 | out: what the matcher sees |
| `rectified/left/image_rect_color`, `rectified/right/image_rect_color` | Image bgr8 | out |
| `rectified/left/camera_info`, `rectified/right/camera_info` | CameraInfo | out, see `uw_recon_ros.ros.geometry` |
| `/tf_static` | TFMessage | out, where tf2_msgs is installed: the rectified frame in the left camera's own |
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.node import Node

from uw_recon_ros.calibration.rectified import rectified_by_name
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.ros import rectified_frame
from uw_recon_ros.ros.declared_topics import Input, input_topic, outputs_of
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import header, image_message, rectified_infos
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.pairs import calibration_from_infos, enhanced_pair, is_calibrated
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.topics import SIDES
from uw_recon_ros.types import EnhancedPair, RectifiedPair

CAMERA_INFOS = tuple(Input(f"{side}_info", (input_topic(f"{side}/camera_info"),), "latest") for side in SIDES)
INPUTS = (
    *(Input(f"{side}_matching", (input_topic(f"{side}/image_matching"),), "optional") for side in SIDES),
    *(Input(side, (input_topic(f"{side}/image_enhanced"),)) for side in SIDES),
    *CAMERA_INFOS,
)
OUTPUTS = (*outputs_of("rectify_node"), *rectified_frame.OUTPUTS)


@dataclass(frozen=True)
class RigRectifier:
    """The stage, and what is remembered of the rig."""

    rectify: Rectify
    rig: RigTracker

    @classmethod
    def make(cls, params: RectifyParams) -> RigRectifier:
        """Start with an unknown rig."""
        return cls(Rectify(params), RigTracker(params))

    def __call__(self, pair: EnhancedPair) -> RectifiedPair:
        """Rectify one pair; what need not come before it is left to `watch`."""
        return self.rectify(pair, self.rig.update(pair, watch=False))

    def watch(self, pair: EnhancedPair) -> None:
        """Look whether the rig still is as it was, once the pair is on its way."""
        self.rig.watch(pair)


def unwanted_infos(params: RectifyParams) -> frozenset[str]:
    """Inputs that the parameters rule out."""
    return frozenset(i.name for i in CAMERA_INFOS) if params.calibration_use == "ignore" else frozenset()


def came_rectified_to(node: Node, params: RectifyParams) -> tuple[bool, bool]:
    """Whether the left and the right cameras' images come rectified, by the topics that the node is remapped to."""
    left, right = (
        rectified_by_name(
            params.images_rectified, *(node.resolve_topic_name(f"{side}/image_{kind}") for kind in ("raw", "enhanced"))
        )
        for side in SIDES
    )
    return left, right


def report_calibration(diagnostics: Diagnostics, group: Group) -> None:
    """Say where a camera_info denies being a calibration."""
    zero = [i.alternatives[0].name for i in CAMERA_INFOS if i.name in group and not is_calibrated(group[i.name])]
    text = f"{' and '.join(zero)}: K is zero (not calibrated): rectified from the images" if zero else None
    diagnostics.problem("uncalibrated", text)


def report_rectification(diagnostics: Diagnostics, pair: RectifiedPair) -> None:
    """Say how well the rows agree, and whether the scale is known."""
    quality = pair.quality
    diagnostics.say(
        rectification=quality.method,
        row_error_median_px=f"{quality.row_error_median_px:.3f}",
        row_error_p95_px=f"{quality.row_error_p95_px:.3f}",
        inliers=quality.inliers,
        medium=quality.medium or None,
        shape_sigma_percent=f"{shape:.1f}" if math.isfinite(shape := quality.shape_sigma_percent) else None,
        lens_k1=f"{k1:.3f}" if math.isfinite(k1 := quality.lens_k1) else None,
        scale="metric" if pair.geometry.metric else "unknown",
        rectifying_rotation_deg=f"{rectified_frame.rotation_deg(pair.geometry):.3f}",
    )
    diagnostics.found("rectification", quality.warnings)


def publish_rectified(outputs: Outputs, pair: RectifiedPair) -> None:
    """Publish what the rectification stage made."""
    head = header(pair.stamp_ns, pair.frame_id)
    rectified_frame.tell_rectified_frame(outputs, pair.geometry, pair.stamp_ns, pair.frame_id)
    left_info, right_info = rectified_infos(pair)
    outputs.send("rectified/left/camera_info", lambda: left_info)
    outputs.send("rectified/right/camera_info", lambda: right_info)
    for side, picture in pair.pictures.items():
        outputs.send(f"rectified/{side}/image_rect_color", partial(image_message, picture, head))
    outputs.send("rectified/left/image_rect", lambda: image_message(pair.left_matching, head))
    outputs.send("rectified/right/image_rect", lambda: image_message(pair.right_matching, head))


class RectifyNode(StageNode[RigRectifier]):
    """Rectifies pairs, by calibration or by what the images tell."""

    def __init__(self, **options: Any) -> None:
        super().__init__("rectify_node", classes=(RectifyParams,), inputs=INPUTS, outputs=OUTPUTS, **options)
        if not rectified_frame.OUTPUTS:
            self.get_logger().debug(rectified_frame.ABSENT)

    def build(self, params: ParameterSet) -> RigRectifier:
        """Make the stage; what was known of the rig is forgotten."""
        return RigRectifier.make(params[RectifyParams])

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Listen to calibrations only where they are used."""
        self._unwanted_infos = unwanted_infos(params[RectifyParams])
        self.inputs.ignored = self._unwanted_infos | (self.inputs.ignored & set(SIDES))
        self._rectified = came_rectified_to(self, params[RectifyParams])
        self.diagnostics.say(images_rectified="yes" if any(self._rectified) else "no")

    def adapt_to_listeners(self, outputs: Outputs) -> None:
        """Read an enhanced image only where its rectified one is read, or nothing else is there to match."""
        matching = all(self.inputs.has_publisher(f"{side}/image_matching") for side in SIDES)
        unread = {side for side in SIDES if matching and not outputs.wanted(f"rectified/{side}/image_rect_color")}
        self.inputs.ignored = self._unwanted_infos | unread

    def work(self, stage: RigRectifier, group: Group, outputs: Outputs) -> int:
        """Rectify one pair."""
        report_calibration(self.diagnostics, group)
        calibration = calibration_from_infos(group.get("left_info"), group.get("right_info"), self._rectified)
        enhanced = enhanced_pair(group, calibration)
        pair = stage(enhanced)
        report_rectification(self.diagnostics, pair)
        publish_rectified(outputs, pair)
        stage.watch(enhanced)
        return pair.stamp_ns


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(RectifyNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
