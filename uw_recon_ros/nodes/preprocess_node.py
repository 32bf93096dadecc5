"""`preprocess_node`: raw images in, enhanced images out.

| topic | type | |
| --- | --- | --- |
| `left/image_raw`, `right/image_raw` or `.../compressed` | Image / CompressedImage | in |
| the same `.../ffmpeg` or `.../foxglove` | FFMPEGPacket / CompressedVideo | in: video, with the extra `video` |
| `left/image_enhanced`, `right/image_enhanced` | Image bgr8 | out: texture; made only while somebody listens |
| `left/image_matching`, `right/image_matching` | Image mono8 | out: what the matcher sees; 0 = nothing is seen |
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from uw_recon_ros.findings import severe
from uw_recon_ros.node_params import CameraParams
from uw_recon_ros.preprocess.sequence import PreprocessSequence
from uw_recon_ros.preprocess.stage import PreprocessParams
from uw_recon_ros.ros.declared_topics import Input, input_topic, outputs_of
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.messages import header, image_message
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.pairs import raw_pair
from uw_recon_ros.ros.parameters import ParameterSet
from uw_recon_ros.ros.process import run
from uw_recon_ros.topics import SIDES, image_topics, transport_of
from uw_recon_ros.types import EnhancedPair

CAMERAS = tuple(Input(side, tuple(map(input_topic, image_topics(side)))) for side in SIDES)
_IMAGES = frozenset(topic.name for camera in CAMERAS for topic in camera.alternatives)
OUTPUTS = outputs_of("preprocess_node")
PICTURES = tuple(f"{side}/image_enhanced" for side in SIDES)


def camera_filter(params: CameraParams) -> Any:
    """Which sources of a camera's image the parameters allow."""
    if params.image_transport == "auto":
        return lambda source: True
    return lambda source: source.name not in _IMAGES or transport_of(source.name) == params.image_transport


def publish_enhanced(outputs: Outputs, pair: EnhancedPair) -> None:
    """Publish what the preprocessing stage made."""
    head = header(pair.stamp_ns, pair.frame_id)
    outputs.send("left/image_matching", lambda: image_message(pair.left_matching, head))
    outputs.send("right/image_matching", lambda: image_message(pair.right_matching, head))
    for side, picture in pair.pictures.items():
        outputs.send(f"{side}/image_enhanced", partial(image_message, picture, head))


def report_regions(diagnostics: Diagnostics, pair: EnhancedPair) -> None:
    """Say which parts of either camera's image show no scene."""
    diagnostics.say(regions="; ".join(finding.text for finding in pair.findings) or None)
    diagnostics.found("regions", severe(pair.findings))


class PreprocessNode(StageNode[PreprocessSequence]):
    """Enhances pairs of raw images."""

    def __init__(self, **options: Any) -> None:
        super().__init__(
            "preprocess_node", classes=(CameraParams, PreprocessParams), inputs=CAMERAS, outputs=OUTPUTS, **options
        )

    def build(self, params: ParameterSet) -> PreprocessSequence:
        """Make the stage."""
        return PreprocessSequence(params[PreprocessParams])

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Take the image transport and the rate that are asked for."""
        self.inputs.accepts = camera_filter(params[CameraParams])
        self.inputs.pace.limit_hz = params[CameraParams].max_rate_hz
        self._most_pixels = params[CameraParams].max_pixels

    def work(self, stage: PreprocessSequence, group: Group, outputs: Outputs) -> int:
        """Enhance one pair."""
        pair = stage(raw_pair(group, most_pixels=self._most_pixels), shown=outputs.wanted(*PICTURES))
        report_regions(self.diagnostics, pair)
        publish_enhanced(outputs, pair)
        return pair.stamp_ns


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until it is interrupted; return the exit code."""
    return run(PreprocessNode, __doc__, args)


if __name__ == "__main__":
    sys.exit(main())
