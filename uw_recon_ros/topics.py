"""The one table of topics: name, type, who publishes it, unit and meaning.

Nodes, doctor, security policy and ``docs/topics.md`` are made from it; launch file, layouts of RViz and Foxglove,
output bag and the other documents are checked against it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

CAMERAS = "cameras"  #: who publishes what goes in: drivers, or a bag
IMAGE, COMPRESSED_IMAGE = "sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage"
CAMERA_INFO, POINT_CLOUD = "sensor_msgs/msg/CameraInfo", "sensor_msgs/msg/PointCloud2"
LASER_SCAN, RANGE = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Range"
DISPARITY_IMAGE, MARKER = "stereo_msgs/msg/DisparityImage", "visualization_msgs/msg/Marker"
FFMPEG_PACKET = "ffmpeg_image_transport_msgs/msg/FFMPEGPacket"
FOXGLOVE_VIDEO = "foxglove_msgs/msg/CompressedVideo"
H264_PACKET = "h264_msgs/msg/Packet"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
ODOMETRY, PATH = "nav_msgs/msg/Odometry", "nav_msgs/msg/Path"
SIDES = ("left", "right")
#: How a camera's images come, by image_transport's names, and the type of each; those that come earlier are preferred.
TRANSPORTS = {"raw": IMAGE, "compressed": COMPRESSED_IMAGE, "ffmpeg": FFMPEG_PACKET, "foxglove": FOXGLOVE_VIDEO}


@dataclass(frozen=True)
class Topic:
    """One topic.

    Parameters
    ----------
    name : str
        Relative, so that a name space moves it.
    type : str
        E.g. ``sensor_msgs/msg/Image``.
    by : str
        The stage node that publishes it, or `CAMERAS`. `pipeline_node` publishes what the four
        stages from cameras to clouds do.
    about : str
        What it is, in a sentence.
    encoding : str
        Of an image.
    unit : str
        Of its numbers; empty where they have none.
    latched : bool
        Whether late subscribers get the last message (transient local).
    metric : bool
        Whether it is published only where the metric scale is known.
    """

    name: str
    type: str
    by: str
    about: str
    encoding: str = ""
    unit: str = ""
    latched: bool = False
    metric: bool = False


def _both(name: str, kind: str, by: str, about: str, encoding: str = "") -> Iterator[Topic]:
    """A topic of each side; ``{}`` stands for it."""
    return (Topic(name.format(side), kind, by, about.format(side), encoding) for side in SIDES)


_PREPROCESS, _RECTIFY, _DISPARITY, _CLOUD = "preprocess_node", "rectify_node", "disparity_node", "point_cloud_node"
_ODOMETRY, _MODEL, _CALIBRATE = "odometry_node", "model_node", "calibrate_node"
#: In the order in which one pair's messages are published.
TOPICS = (
    *_both("{}/image_raw", IMAGE, CAMERAS, "Image of the {} camera."),
    *_both("{}/image_raw/compressed", COMPRESSED_IMAGE, CAMERAS, "The same compressed; read where no raw one comes."),
    *_both("{}/image_raw/ffmpeg", FFMPEG_PACKET, CAMERAS, "The same as video; read where neither of these comes."),
    *_both("{}/image_raw/foxglove", FOXGLOVE_VIDEO, CAMERAS, "The same as video; read where none of these comes."),
    *_both("{}/camera_info", CAMERA_INFO, CAMERAS, "Calibration of the {} camera; without it the scale is unknown."),
    *_both("{}/image_matching", IMAGE, _PREPROCESS, "What the matcher sees of the {} camera.", "mono8"),
    *_both("{}/image_enhanced", IMAGE, _PREPROCESS, "Enhanced image of the {} camera: texture.", "bgr8"),
    *_both("rectified/{}/camera_info", CAMERA_INFO, _RECTIFY, "Rectified geometry of the {} view; P has the baseline."),
    *_both("rectified/{}/image_rect_color", IMAGE, _RECTIFY, "Rectified {} view, enhanced: texture.", "bgr8"),
    *_both("rectified/{}/image_rect", IMAGE, _RECTIFY, "Rectified {} view, as the matcher sees it.", "mono8"),
    Topic("disparity/status", IMAGE, _DISPARITY, "Why a pixel has no disparity: bits of `Status`, 0 = valid.", "mono8"),
    Topic("disparity/sigma", IMAGE, _DISPARITY, "Standard deviation of the disparity; NaN = invalid.", "32FC1", "px"),
    Topic("disparity/confidence", IMAGE, _DISPARITY, "Probability that the disparity is less than a pixel off; NaN = "
          "invalid.", "32FC1"),
    Topic("disparity/effort", DIAGNOSTICS, _DISPARITY, "Effort spent on the disparity of this stamp."),
    Topic("disparity", DISPARITY_IMAGE, _DISPARITY, "Disparity u_left - u_right; NaN = invalid.", "32FC1", "px"),
    Topic("depth/camera_info", CAMERA_INFO, _CLOUD, "Camera of the depth image: D = 0, R = I.", metric=True),
    Topic("depth/sigma", IMAGE, _CLOUD, "Standard deviation of the depth; NaN = invalid.", "32FC1", "m", metric=True),
    Topic("depth/image_rect", IMAGE, _CLOUD, "Depth along the optical axis; NaN = invalid (REP 118).", "32FC1", "m",
          metric=True),
    Topic("points2", POINT_CLOUD, _CLOUD, "Organised cloud, a point a pixel; may hold NaN.", unit="m", metric=True),
    Topic("points2_filtered", POINT_CLOUD, _CLOUD, "Dense cloud for navigation: range-limited, thinned to voxels.",
          unit="m", metric=True),
    Topic("obstacles", LASER_SCAN, _CLOUD, "Nearest trusted surface by direction; NaN = unknown; needs `base_frame`.",
          unit="m", metric=True),
    Topic("range", RANGE, _CLOUD, "Distance to the nearest trusted surface along `range_axis`; needs `base_frame`.",
          unit="m", metric=True),
    Topic("points_unscaled", POINT_CLOUD, _CLOUD, "Instead of all metric topics where the scale is unknown.",
          unit="baselines"),
    Topic("surface", MARKER, _CLOUD, "Triangles with colours.", unit="m, or baselines", latched=True),
    Topic("odometry", ODOMETRY, _ODOMETRY, "Pose since the start and velocity, with covariance; nothing while lost.",
          unit="m, rad", metric=True),
    Topic("calibration/coverage", IMAGE, _CALIBRATE, "Both pictures of a board, the parts it was seen in, what to do "
          "next.", "bgr8"),
    Topic("path", PATH, _ODOMETRY, "Where the vehicle has been.", unit="m", latched=True, metric=True),
    Topic("model/submap", POINT_CLOUD, _MODEL, "The submap that was closed last.", unit="m", metric=True),
    Topic("model/points", POINT_CLOUD, _MODEL, "All closed submaps, moved as loops say.", unit="m", latched=True,
          metric=True),
    Topic("model/surface", MARKER, _MODEL, "The same as triangles.", unit="m", latched=True, metric=True),
)  # fmt: skip
_BY_NAME = {topic.name: topic for topic in TOPICS}


def transport_of(topic: str) -> str:
    """Which of `TRANSPORTS` a topic of a camera's images is of, by the end of its name; ``raw`` where it tells none."""
    end = topic.rpartition("/")[2]
    return end if end in TRANSPORTS else "raw"


def image_topics(side: str) -> tuple[str, ...]:
    """Topics that may bring one camera's images, in the order of `TRANSPORTS`."""
    return tuple(topic.name for topic in TOPICS if topic.by == CAMERAS and topic.name.startswith(f"{side}/image_raw"))


def find_topic(name: str) -> Topic:
    """The topic of that relative name; `KeyError` where there is none."""
    return _BY_NAME[name]


def published_by(publisher: str) -> tuple[Topic, ...]:
    """What a stage node, or `CAMERAS`, publishes, in order."""
    return tuple(topic for topic in TOPICS if topic.by == publisher)
