"""`pipeline_node`: the four stages in one process, for small computers and quick starts.

Reads what `preprocess_node` and `rectify_node` read of the cameras, publishes what all four nodes publish.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.match.stage import MatchParams
from uw_recon_ros.node_params import CameraParams, DisparityMessageParams, RateParams
from uw_recon_ros.nodes import disparity_node, point_cloud_node, preprocess_node, rectify_node
from uw_recon_ros.pipeline import Products, Stages
from uw_recon_ros.preprocess.sequence import PreprocessSequence
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.reconstruct.obstacles import FindObstacles, ObstacleParams
from uw_recon_ros.reconstruct.stage import TEXTURES, Reconstruct, ReconstructParams
from uw_recon_ros.rectify.stage import RectifyParams
from uw_recon_ros.ros.autopilot_report import AutopilotReport
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.node_matcher import NodeMatcher
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.pairs import calibration_from_infos, raw_pair
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.topics import SIDES

INPUTS = (*preprocess_node.CAMERAS, *rectify_node.CAMERA_INFOS)
_STEPS = [module.OUTPUTS for module in (preprocess_node, rectify_node, disparity_node, point_cloud_node)]
PICTURES = (*preprocess_node.PICTURES, *(f"rectified/{side}/image_rect_color" for side in SIDES))
OUTPUTS = tuple(output for step in _STEPS for output in step)


def _topics_from(step: int) -> tuple[str, ...]:
    """What the stages from `step` on publish."""
    return tuple(output.topic for outputs in _STEPS[step:] for output in outputs)


@dataclass(frozen=True)
class NodeStages(Stages):
    """All four, with the parameters they were made of."""

    rectify: rectify_node.RigRectifier
    match: NodeMatcher
    obstacles: FindObstacles
    params: ParameterSet


class PipelineNode(StageNode[NodeStages]):
    """Runs the whole pipeline as far as somebody listens."""

    def __init__(self, **options: Any) -> None:
        own = (CameraParams, DisparityMessageParams, RateParams)
        stages = (PreprocessParams, RectifyParams, MatchParams, ReconstructParams, ObstacleParams, MountParams)
        super().__init__("pipeline_node", classes=(*own, *stages), inputs=INPUTS, outputs=OUTPUTS, **options)
        self._autopilot = AutopilotReport(self.diagnostics)

    def build(self, params: ParameterSet) -> NodeStages:
        """Make the stages; a rig already known is forgotten only when rectification changes."""
        before = self.stage
        keep_rig = before is not None and before.params[RectifyParams] == params[RectifyParams]
        return NodeStages(
            PreprocessSequence(params[PreprocessParams]),
            before.rectify if before and keep_rig else rectify_node.RigRectifier.make(params[RectifyParams]),
            NodeMatcher(params[MatchParams], params[RateParams]),
            Reconstruct(params[ReconstructParams]),
            point_cloud_node.obstacle_finder(params),
            params,
        )

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Take the image transport and the rate that are asked for; listen to calibrations only where they are used."""
        self.inputs.accepts = preprocess_node.camera_filter(params[CameraParams])
        self.inputs.pace.limit_hz = params[CameraParams].max_rate_hz
        self._most_pixels = params[CameraParams].max_pixels
        textured = params[ReconstructParams].texture == TEXTURES[0]
        self._pictured = PICTURES + (point_cloud_node.COLORED if textured else ())
        self.inputs.ignored = rectify_node.unwanted_infos(params[RectifyParams])
        self._rectified = rectify_node.came_rectified_to(self, params[RectifyParams])
        self.diagnostics.say(images_rectified="yes" if any(self._rectified) else "no")

    def warm_up(self, stage: NodeStages) -> None:
        """Compile the matcher, or fetch it compiled."""
        stage.match.warm_up()

    def work(self, stage: NodeStages, group: Group, outputs: Outputs) -> int:
        """Take one pair as far as somebody listens."""
        rectify_node.report_calibration(self.diagnostics, group)
        calibration = calibration_from_infos(group.get("left_info"), group.get("right_info"), self._rectified)
        raw = raw_pair(group, calibration, self._most_pixels)
        products = Products(raw, stage, shown=outputs.wanted(*self._pictured))
        preprocess_node.report_regions(self.diagnostics, products.enhanced)
        preprocess_node.publish_enhanced(outputs, products.enhanced)
        if outputs.wanted(*_topics_from(1)):
            rectify_node.report_rectification(self.diagnostics, products.rectified)
            rectify_node.publish_rectified(outputs, products.rectified)
            if outputs.wanted(*_topics_from(2)):
                self._reconstruct(stage, products, outputs)
            stage.rectify.watch(products.enhanced)
        return raw.stamp_ns

    def finished(self, stage: NodeStages, took_s: float) -> None:
        """Hold the rate that is asked for."""
        stage.match.finished(took_s, self.diagnostics)

    def _reconstruct(self, stage: NodeStages, products: Products, outputs: Outputs) -> None:
        disparity, left = products.disparity, stage.reconstruct.texture(products.rectified)
        disparity_node.report_disparity(self.diagnostics, disparity)
        disparity_node.publish_disparity(outputs, disparity, stage.match.spent, stage.params[DisparityMessageParams])
        point_cloud_node.publish_reconstruction(
            outputs, self.diagnostics, self._autopilot, stage.reconstruct, stage.obstacles, disparity, left
        )

    def say_unasked(self, outputs: Outputs) -> None:
        """Say why obstacles and range are silent, where no frame does."""
        self._autopilot.say(outputs, self.inputs.stall_s)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(PipelineNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
