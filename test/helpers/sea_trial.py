"""A stereo rig of known truth that the test itself is: it sends what it likes, and looks at what comes of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from helpers.graph_bench import FOUR, Graph
from helpers.ros_bench import BANDS, BASELINE, FOCAL, banded_pair, color, infos, stamped
from uw_recon_ros.ros import messages

SECOND = 1_000_000_000
STEP = SECOND // 10  # between the stamps of two pairs
_PERIOD_S = 0.1  # between two pairs on their way
PARAMETERS = {"min_disparity": 0, "max_disparity": 24, "effort": "navigation", "stall_warning_s": 0.5}
OK, WARN = b"\0", b"\1"


def arguments(*extra: str, **parameters: Any) -> list[str]:
    """ROS arguments of a node under trial."""
    given = {**PARAMETERS, **parameters}
    return ["--ros-args", *extra, *(word for name, value in given.items() for word in ("-p", f"{name}:={value}"))]


class SeaTrial:
    """Cameras in front of three planes (`ros_bench.BANDS`), and a listener as navigation is one.

    Parameters
    ----------
    graph : Graph
    nodes : sequence of str
        Already started.
    space : str
        Name space of cameras, listener and nodes.

    Attributes
    ----------
    depths, clouds : dict
        Messages by stamp.
    stamp : int
        Of the pair sent last.
    """

    def __init__(self, graph: Graph, nodes: tuple[str, ...] = FOUR, space: str = "") -> None:
        self.graph, self.nodes, self.space = graph, nodes, space
        self.depths: dict[int, Image] = {}
        self.clouds: dict[int, PointCloud2] = {}
        self.stamp, self.baseline_m = 100_000 * SECOND, BASELINE
        self._sent_at = 0.0
        self.images = banded_pair()
        bench = graph.bench
        self.publishers = {
            f"{side}/{topic}": bench.talk(kind, f"{space}/{side}/{topic}")
            for side in ("left", "right")
            for topic, kind in (("image_raw", Image), ("camera_info", CameraInfo))
        }
        for topic, kind, kept in (
            ("depth/image_rect", Image, self.depths),
            ("points2_filtered", PointCloud2, self.clouds),
        ):
            bench.outsider.create_subscription(
                kind, f"{space}/{topic}", lambda m, kept=kept: kept.update({messages.stamp_ns(m): m}), 50
            )

    def connected(self) -> None:
        """Wait until everybody has found everybody."""
        self.graph.connected(*self.nodes, space=self.space)
        self.graph.spin_until(lambda: all(p.get_subscription_count() for p in self.publishers.values()), "cameras read")

    def send(self, stamp: int, *topics: str) -> None:
        """Publish the messages of one pair, all or those named."""
        self.stamp, self._sent_at = stamp, time.monotonic()
        notes = infos(stamp, baseline_m=self.baseline_m)
        for side, image, info in zip(("left", "right"), self.images, notes, strict=True):
            for topic, message in (
                (f"{side}/camera_info", stamped(info, stamp)),
                (f"{side}/image_raw", color(image, stamp)),
            ):
                if topic in (topics or self.publishers):
                    self.publishers[topic].publish(message)

    def sail_until(self, condition: Callable[[], Any], what: str, *topics: str) -> None:
        """Send pair after pair, all topics or those named, until something is so."""

        def onwards() -> bool:
            if time.monotonic() - self._sent_at >= _PERIOD_S:
                self.send(self.stamp + STEP, *topics)
            return bool(condition())

        self.graph.spin_until(onwards, what)

    def sails(self, frames: int = 3) -> None:
        """The whole graph gives right answers to what is sent from now on, and everybody says that all is well."""
        start = self.stamp
        for name in self.names:
            self.graph.said.pop(name, None)

        def fresh() -> list[int]:
            return [stamp for stamp in self.depths.keys() & self.clouds.keys() if stamp > start]

        self.sail_until(lambda: len(fresh()) >= frames, "clouds of what was sent just now")
        for stamp in fresh():
            self.check(stamp)
        self.sail_until(lambda: all(self.said(node).get("level") == OK for node in self.nodes), "all to be well")

    def check(self, stamp: int, baseline_m: float | None = None) -> None:
        """The depth of every plane is right, and the cloud's as well."""
        expected = [FOCAL * (baseline_m or self.baseline_m) / disparity for _, _, disparity in BANDS]
        np.testing.assert_allclose(self.planes(stamp), expected, rtol=0.02)
        cloud = self.clouds[stamp]
        z = np.frombuffer(cloud.data, np.float32).reshape(-1, cloud.point_step // 4)[:, 2]
        distance = np.abs(z[:, np.newaxis] / np.array(expected) - 1).min(axis=1)
        assert np.mean(distance < 0.03) > 0.9

    def planes(self, stamp: int) -> list[float]:
        """Median depth of each plane, m."""
        depth = messages.float_image_from_message(self.depths[stamp])
        return [float(np.nanmedian(depth[top + 8 : bottom - 8, 40:-10])) for top, bottom, _ in BANDS]

    def said(self, node: str) -> dict[str, Any]:
        """What a node said of itself last."""
        return self.graph.said[f"{self.space}/{node}"]

    @property
    def names(self) -> list[str]:
        """The nodes' full names."""
        return [f"{self.space}/{node}" for node in self.nodes]

    def complains(self, node: str, *words: str) -> bool:
        """Whether a node warns, in these words among others."""
        said = self.said(node)
        return said.get("level", OK) != OK and all(word in said["message"] for word in words)
