"""Subscribes to what the graph publishes and keeps it, frame by frame."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_srvs.srv import Trigger
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.ros.messages import stamp_ns

PER_FRAME = {
    "left/image_enhanced": Image,
    "right/image_enhanced": Image,
    "rectified/left/image_rect_color": Image,
    "rectified/right/image_rect_color": Image,
    "rectified/left/camera_info": CameraInfo,
    "rectified/right/camera_info": CameraInfo,
    "disparity": DisparityImage,
    "disparity/status": Image,
    "disparity/sigma": Image,
    "depth/image_rect": Image,
    "depth/sigma": Image,
    "points2": PointCloud2,
    "points2_filtered": PointCloud2,
}
#: Published last for a frame: when it is here, so is everything else.
LAST = "points2"


class Collector:
    """Messages by stamp and topic, and how long after its images were sent each frame was whole.

    Parameters
    ----------
    context : Context
    name_space : str
        Of the graph.
    """

    def __init__(self, context: Context, name_space: str) -> None:
        self.node = Node("demo_collector", context=context, namespace=name_space)
        self.frames: defaultdict[int, dict[str, Any]] = defaultdict(dict)
        self.latency: dict[int, float] = {}
        self._stepped = 0.0
        self.diagnostics: dict[str, dict[str, str]] = {}
        keep_all = QoSProfile(history=QoSHistoryPolicy.KEEP_ALL, durability=QoSDurabilityPolicy.VOLATILE)
        for topic, kind in PER_FRAME.items():
            self.node.create_subscription(kind, topic, self._keep(topic), keep_all)
        self.node.create_subscription(DiagnosticArray, "/diagnostics", self._diagnose, 10)
        self._stepper = self.node.create_client(Trigger, "bag_player_node/step")
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)

    def _keep(self, topic: str) -> Callable[[Any], None]:
        def keep(message: Any) -> None:
            stamp = stamp_ns(message)
            self.frames[stamp][topic] = message
            if topic == LAST:
                self.latency[stamp] = time.monotonic() - self._stepped

        return keep

    def _diagnose(self, message: DiagnosticArray) -> None:
        for status in message.status:
            name = status.name.rsplit("/", 1)[-1]
            self.diagnostics[name] = {"message": status.message, **{v.key: v.value for v in status.values}}

    def step(self) -> None:
        """Have the player send the next stereo pair."""
        while not self._stepper.service_is_ready():
            self.spin(0.05)
        self._stepped = time.monotonic()
        self._stepper.call_async(Trigger.Request())  # its answer may be lost on a busy machine, the frame is not

    def spin(self, seconds: float) -> None:
        """Receive for a while."""
        until = time.monotonic() + seconds
        while (left := until - time.monotonic()) > 0:
            self._executor.spin_once(timeout_sec=left)

    def complete(self) -> list[int]:
        """Stamps of frames of which everything came, oldest first."""
        return sorted(stamp for stamp, got in self.frames.items() if got.keys() >= PER_FRAME.keys())

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self.node.destroy_node()
