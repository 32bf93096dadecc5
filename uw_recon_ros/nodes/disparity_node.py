"""`disparity_node`: rectified images in, disparity out. Any rectification node that follows image_pipeline may feed it.

| topic | type | |
| --- | --- | --- |
| `rectified/left/image_rect`, `rectified/right/image_rect` | Image mono8 | in |
| `rectified/left/camera_info`, `rectified/right/camera_info` | CameraInfo | in, of the same stamp |
| `disparity` | stereo_msgs/DisparityImage | out: NaN = invalid; see `uw_recon_ros.messages.disparities` |
| `disparity/status` | Image mono8 | out: `Status` bits, why a pixel is invalid |
| `disparity/sigma` | Image 32FC1 | out: standard deviation, px |
| `disparity/confidence` | Image 32FC1 | out: probability of being less than a pixel off |
| `disparity/effort` | diagnostic_msgs/DiagnosticArray | out: effort spent on the disparity of this stamp |
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

from uw_recon_ros.match.stage import MatchParams
from uw_recon_ros.node_params import DisparityMessageParams, RateParams
from uw_recon_ros.ros.declared_topics import Input, input_topic, outputs_of
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import (
    confidence_message,
    disparity_message,
    effort_message,
    sigma_message,
    status_message,
)
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.node_matcher import NodeMatcher
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.pairs import rectified_pair
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.topics import SIDES
from uw_recon_ros.types import DisparityMap

RECTIFIED_INFOS = tuple(Input(f"{side}_info", (input_topic(f"rectified/{side}/camera_info"),)) for side in SIDES)
INPUTS = (
    *(Input(side, (input_topic(f"rectified/{side}/image_rect"),)) for side in SIDES),
    *RECTIFIED_INFOS,
)
OUTPUTS = outputs_of("disparity_node")
_NEARLY_NOTHING = 0.01  # part of the pixels


def report_disparity(diagnostics: Diagnostics, disparity: DisparityMap) -> None:
    """Say how dense the disparity is, and in which limits it was searched."""
    diagnostics.say(
        method=disparity.method,
        density=f"{disparity.density:.3f}",
        disparities=f"{disparity.min_disparity} to {disparity.max_disparity} px",
        residual_row_offset=f"{disparity.rows}",
        scale="metric" if disparity.geometry.metric else "unknown",
    )
    limits = f"{disparity.min_disparity} to {disparity.max_disparity} px"
    text = (
        f"nearly nothing matched ({disparity.density:.1%} of the pixels have a disparity): open water or darkness; "
        f"or left and right swapped, a camera knocked, limits ({limits}) that miss the scene: see disparity/status"
    )
    diagnostics.problem("matched", text if disparity.density < _NEARLY_NOTHING else None)


def publish_disparity(outputs: Outputs, disparity: DisparityMap, effort: str, params: DisparityMessageParams) -> None:
    """Publish what the matching stage made, and what was spent on it."""
    outputs.send("disparity/effort", lambda: effort_message(disparity, effort))
    outputs.send("disparity/status", lambda: status_message(disparity))
    outputs.send("disparity/sigma", lambda: sigma_message(disparity))
    outputs.send("disparity/confidence", lambda: confidence_message(disparity))
    outputs.send("disparity", lambda: disparity_message(disparity, adjusted=params.disparity_adjusted))


class DisparityStage(NamedTuple):
    """The stage, and how its result is sent."""

    match: NodeMatcher
    message: DisparityMessageParams


class DisparityNode(StageNode[DisparityStage]):
    """Matches rectified pairs."""

    def __init__(self, **options: Any) -> None:
        classes = (DisparityMessageParams, RateParams, MatchParams)
        super().__init__("disparity_node", classes=classes, inputs=INPUTS, outputs=OUTPUTS, **options)

    def build(self, params: ParameterSet) -> DisparityStage:
        """Make the stage."""
        return DisparityStage(NodeMatcher(params[MatchParams], params[RateParams]), params[DisparityMessageParams])

    def warm_up(self, stage: DisparityStage) -> None:
        """Compile the matcher, or fetch it compiled."""
        stage.match.warm_up()

    def work(self, stage: DisparityStage, group: Group, outputs: Outputs) -> int:
        """Match one pair."""
        disparity = stage.match(rectified_pair(group))
        report_disparity(self.diagnostics, disparity)
        publish_disparity(outputs, disparity, stage.match.spent, stage.message)
        return disparity.stamp_ns

    def finished(self, stage: DisparityStage, took_s: float) -> None:
        """Hold the rate that is asked for."""
        stage.match.finished(took_s, self.diagnostics)


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(DisparityNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
