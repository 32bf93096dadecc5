"""What the disparity node and the rectify node would send of views of a made-up bottom."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from sensor_msgs.msg import CameraInfo, Image
from stereo_msgs.msg import DisparityImage

from helpers.ros_bench import FRAME, Bench, color, infos_from_geometry
from uw_recon_ros.ros import messages
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import DisparityMap

KINDS = {
    "disparity/sigma": Image,
    "rectified/left/image_rect_color": Image,
    "rectified/left/camera_info": CameraInfo,
    "rectified/right/camera_info": CameraInfo,
    "disparity": DisparityImage,
}


def frame_messages(frame: DisparityFrame) -> dict[str, Any]:
    """All messages of a frame, by topic."""
    height, width = frame.disparity.shape
    head = messages.header(frame.stamp_ns, FRAME)
    left, right = infos_from_geometry(frame.geometry, (width, height), head)
    status = np.where(np.isfinite(frame.disparity), 0, 8).astype(np.uint8)
    found = DisparityMap(
        frame.disparity, frame.sigma, status, 0, 64, frame.geometry, stamp_ns=frame.stamp_ns, frame_id=FRAME
    )
    return {
        "disparity/sigma": messages.sigma_message(found),
        "rectified/left/image_rect_color": color(frame.left, frame.stamp_ns),
        "rectified/left/camera_info": left,
        "rectified/right/camera_info": right,
        "disparity": messages.disparity_message(found),
    }


class Graph:
    """Stands for the four nodes: sends frames one by one, and waits until they are worked on."""

    def __init__(self, bench: Bench, node: Any) -> None:
        self.bench, self.node = bench, node
        self.talkers = {topic: bench.talk(kind, topic) for topic, kind in KINDS.items()}

    def connect(self) -> None:
        self.bench.connected(*self.talkers.values())

    def send(self, frame: DisparityFrame, done: Callable[[], Any]) -> None:
        for topic, message in frame_messages(frame).items():
            self.talkers[topic].publish(message)
        self.bench.spin_until(done, f"the frame of {frame.stamp_ns} ns")
