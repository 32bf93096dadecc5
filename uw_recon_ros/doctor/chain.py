"""The chain from cameras to cloud: which node makes which topic of which type.

Names stand here as text, so that judging needs neither ROS nor the nodes; a test compares them with the nodes' tables.
"""

from __future__ import annotations

from dataclasses import dataclass

IMAGE, COMPRESSED = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
INFO, CLOUD = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2"
DISPARITY = "stereo_msgs/msg/DisparityImage"
EYES = ("left", "right")
PIPELINE = "pipeline_node"
METRIC_CLOUD, UNSCALED_CLOUD = "points2", "points_unscaled"


def sources(eye: str) -> tuple[str, str]:
    """Topics that may bring an eye's images, raw first."""
    return f"{eye}/image_raw", f"{eye}/image_raw/compressed"


@dataclass(frozen=True)
class Stage:
    """A stage node, and the output that shows it at work."""

    label: str
    node: str
    output: str


STAGES = (
    Stage("preprocess", "preprocess_node", "left/image_enhanced"),
    Stage("rectify", "rectify_node", "rectified/left/image_rect"),
    Stage("disparity", "disparity_node", "disparity"),
    Stage("point cloud", "point_cloud_node", METRIC_CLOUD),
)
NODES = (*(stage.node for stage in STAGES), PIPELINE)
#: The chain's topics, relative, and their types.
TYPES: dict[str, str] = {
    **{topic: kind for eye in EYES for topic, kind in zip(sources(eye), (IMAGE, COMPRESSED), strict=True)},
    **{f"{eye}/camera_info": INFO for eye in EYES},
    **{f"{eye}/image_{kind}": IMAGE for eye in EYES for kind in ("enhanced", "matching")},
    **{f"rectified/{eye}/image_rect": IMAGE for eye in EYES},
    **{f"rectified/{eye}/camera_info": INFO for eye in EYES},
    "rectified/left/image_rect_color": IMAGE,
    "disparity": DISPARITY,
    METRIC_CLOUD: CLOUD,
    "points2_filtered": CLOUD,
    UNSCALED_CLOUD: CLOUD,
}
#: What the doctor listens to itself: enough to see where the chain breaks, and to have every stage work.
LISTENED = (
    *(topic for eye in EYES for topic in sources(eye)),
    *(f"{eye}/camera_info" for eye in EYES),
    *(stage.output for stage in STAGES),
    UNSCALED_CLOUD,
)
