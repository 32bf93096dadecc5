"""More large images than any stage can keep up with."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import CameraInfo, Image

from helpers.graph_bench import Graph
from helpers.ros_bench import color, infos, mono, texture

SECOND = 1_000_000_000


class Source:
    """Large images, sent again and again: raw ones, and rectified ones with their camera infos."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        kinds = {"image_raw": Image, "image_rect": Image, "camera_info": CameraInfo}
        topics = ["left/image_raw", "right/image_raw"]
        topics += [f"rectified/{side}/{kind}" for kind in ("image_rect", "camera_info") for side in ("left", "right")]
        self._senders = {topic: graph.bench.talk(kinds[topic.split("/")[-1]], topic) for topic in topics}
        left = np.tile(texture(400, 500), (4, 4, 1))
        self._images = {"left": left, "right": np.roll(left, -8, axis=1)}
        self._sent = 0

    def connect(self, kind: str = "") -> None:
        """Wait until whatever is sent, or all topics of one kind, have readers."""
        wanted = [sender for topic, sender in self._senders.items() if topic.startswith(kind)]
        self._graph.spin_until(lambda: all(sender.get_subscription_count() for sender in wanted), "readers")

    def send(self) -> None:
        self._sent += 1
        stamp, left_right = self._sent * SECOND, infos(self._sent * SECOND)
        for topic, sender in self._senders.items():
            if "camera_info" in topic:
                info = left_right["right" in topic]
                info.height, info.width = self._images["left"].shape[:2]
                sender.publish(info)
            else:
                image = self._images["right" if "right" in topic else "left"]
                sender.publish(color(image, stamp) if "raw" in topic else mono(image[..., 0], stamp))
        self._graph.bench.spin_for(0.3)
