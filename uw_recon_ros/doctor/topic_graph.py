"""The chain from cameras to cloud: the stage nodes in a row, and what shows each at work."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.topics import SIDES, TOPICS, image_topics

PIPELINE = "pipeline_node"
METRIC_CLOUD, UNSCALED_CLOUD = "points2", "points_unscaled"


@dataclass(frozen=True)
class Stage:
    """A stage node, and the output that shows it at work."""

    label: str
    node: str
    output: str


STAGES = (
    Stage("preprocess", "preprocess_node", "left/image_matching"),
    Stage("rectify", "rectify_node", "rectified/left/image_rect"),
    Stage("disparity", "disparity_node", "disparity"),
    Stage("point cloud", "point_cloud_node", METRIC_CLOUD),
)
#: What may go on from there; nobody misses one that was not started.
FURTHER = (
    Stage("odometry", "odometry_node", "odometry"),
    Stage("model", "model_node", "model/submap"),
)
CHAIN = (*(stage.node for stage in STAGES), PIPELINE)
NODES = (*CHAIN, *(stage.node for stage in FURTHER))
#: The chain's topics, relative, and their types.
TYPES: dict[str, str] = {topic.name: topic.type for topic in TOPICS}
#: What the doctor listens to itself: enough to see where the chain breaks, and to have every stage work.
LISTENED = (
    *(topic for camera in SIDES for topic in image_topics(camera)),
    *(f"{camera}/camera_info" for camera in SIDES),
    *(stage.output for stage in (*STAGES, *FURTHER)),
    UNSCALED_CLOUD,
)
