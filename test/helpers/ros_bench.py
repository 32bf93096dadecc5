"""What tests of nodes share: a domain of their own, a context a test, an outsider that talks to the node under test."""

from __future__ import annotations

import fcntl
import os
import random
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

_reserved: list[Any] = []


def own_domain() -> int:
    """A ROS domain that no other run of tests on this machine has, as long as this process lives.

    Two runs on one domain hear each other's nodes: topics with two publishers, services with two servers.
    """
    for domain in random.SystemRandom().sample(range(1, 102), 101):
        file = Path(tempfile.gettempdir(), f"uw_recon_test_domain_{domain}.lock").open("a")  # noqa: SIM115
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            file.close()
            continue
        _reserved.append(file)
        return domain
    raise RuntimeError("expected a free ROS domain of 1 to 101, all are taken")


# Before any ROS import: the environment is read once.
os.environ["ROS_DOMAIN_ID"] = str(own_domain())
os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
os.environ.setdefault("ROS_LOG_DIR", tempfile.mkdtemp(prefix="uw_recon_test_log_"))
os.environ.setdefault("ROS_PYTHON_CHECK_FIELDS", "1")

import numpy as np  # noqa: E402
import rclpy  # noqa: E402
from rcl_interfaces.srv import ListParameters  # noqa: E402
from rclpy.context import Context  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.node import Node  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import QoSProfile, ReliabilityPolicy  # noqa: E402
from rclpy.signals import SignalHandlerOptions  # noqa: E402
from sensor_msgs.msg import CameraInfo, Image  # noqa: E402

from uw_recon_ros.messages.cameras import rectified_cameras  # noqa: E402
from uw_recon_ros.ros import fastdds, messages  # noqa: E402

LIMIT_S = 300.0  # on hanging; no verdict on speed
FRAME = "rov_left_optical_frame"
#: Parameters with which there are obstacles and a range to tell of.
AUTOPILOT = {"base_frame": "base_link", "obstacle_max_relative_sigma": 1.0}

fastdds.prepare()


class Bench:
    """One context, one executor: the node under test and an outsider, spun by the test; on another domain if asked.

    One bench a domain at a time: with a second one's publishers there, "has found its publisher" would not say which.
    """

    _domains: ClassVar[set[int]] = set()

    def __init__(self, domain: int | None = None) -> None:
        self._domain = int(os.environ["ROS_DOMAIN_ID"]) if domain is None else domain
        assert self._domain not in self._domains, "expected a domain without another bench; Bench(own_domain())"
        self._domains.add(self._domain)
        self.context = Context()
        rclpy.init(context=self.context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.outsider = Node("outsider", context=self.context)
        self.executor.add_node(self.outsider)
        self._started: list[Any] = []

    def start(self, make: Callable[..., Any], *, remap: dict[str, str] | None = None, **parameters: Any) -> Any:
        """Start a node of ours with parameters."""
        arguments = [a for old, new in (remap or {}).items() for a in ("-r", f"{old}:={new}")]
        node = make(
            context=self.context,
            parameter_overrides=[Parameter(name, value=value) for name, value in parameters.items()],
            cli_args=["--ros-args", *arguments] if arguments else None,
        )
        self.executor.add_node(node)
        self._started.append(node)
        return node

    def listen(self, message_type: Any, topic: str, depth: int = 50) -> list[Any]:
        """Collect the messages of a topic."""
        heard: list[Any] = []
        self.outsider.create_subscription(message_type, topic, heard.append, depth)
        return heard

    def talk(self, message_type: Any, topic: str, *, reliable: bool = True) -> Any:
        """Make a publisher."""
        policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
        return self.outsider.create_publisher(message_type, topic, QoSProfile(depth=50, reliability=policy))

    def spin_until(self, condition: Callable[[], Any], what: str = "") -> None:
        """Spin until `condition` holds; fail after a while."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < end, f"waited {LIMIT_S} s for {what or condition}"
            self.executor.spin_once(timeout_sec=0.02)

    def spin_for(self, seconds: float) -> None:
        """Spin for a while, to see that nothing happens."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.executor.spin_once(timeout_sec=0.02)

    def connected(self, *publishers: Any) -> None:
        """Spin until every publisher has a subscriber, and all ends in here that belong together know of each other.

        Either end may find the other first; what a writer sends before its reader has found it is lost.
        """
        self.spin_until(lambda: all(p.get_subscription_count() for p in publishers) and self._joined(), "subscribers")

    def _joined(self) -> bool:
        """Whether the outsider and the nodes under test have found each other, both ways."""
        nodes = (self.outsider, *self._started)
        published = Counter(p.topic_name for node in nodes for p in node.publishers)
        return all(
            s.get_publisher_count() >= published[s.topic_name]
            for node in nodes
            for s in node.subscriptions
            if s.topic_name in published
        )

    def close(self) -> None:
        self._domains.discard(self._domain)
        self.executor.shutdown()
        for node in self._started:
            if hasattr(node, "stop"):
                assert node.stop(30.0)
            node.destroy_node()
        self.outsider.destroy_node()
        rclpy.try_shutdown(context=self.context)


def meet(outsider: Node, name: str, spin_until: Callable[..., None]) -> None:
    """Wait until a node of another process has found the ends of all service clients that `outsider` has by now.

    A client knows when it has found its server (`service_is_ready`), but not the reverse, and a server sends no answer
    to a reader it has not found: rmw_fastrtps waits for it 100 ms, then the answer is lost. The ends of one participant
    are announced reliably and in the order they were made; so once a node answers a client made last of all, it has
    found the ones before. That question alone may be asked again; it changes nothing.
    """
    client = outsider.create_client(ListParameters, f"{name}/list_parameters")
    spin_until(client.service_is_ready, f"{name} to be there")
    asked, since = [client.call_async(ListParameters.Request())], time.monotonic()

    def answered() -> bool:
        nonlocal since
        if time.monotonic() - since > 1.0:
            asked.append(client.call_async(ListParameters.Request()))
            since = time.monotonic()
        return any(future.done() for future in asked)

    spin_until(answered, f"{name} to answer")
    outsider.destroy_client(client)


def color(image: np.ndarray, stamp_ns: int, frame_id: str = FRAME) -> Image:
    return messages.image_message(image, messages.header(stamp_ns, frame_id))


def mono(image: np.ndarray, stamp_ns: int, frame_id: str = FRAME) -> Image:
    return messages.image_message(image, messages.header(stamp_ns, frame_id))


def stamped(info: CameraInfo, stamp_ns: int, frame_id: str = FRAME) -> CameraInfo:
    info.header = messages.header(stamp_ns, frame_id)
    return info


def texture(height: int, width: int, seed: int = 0) -> np.ndarray:
    """RGB with structure at every scale, so that anything can be matched."""
    import cv2

    random = np.random.default_rng(seed)
    image = np.zeros((height, width, 3), np.float32)
    for blur in (1.0, 3.0, 9.0):
        noise = cv2.GaussianBlur(random.normal(size=image.shape).astype(np.float32), (0, 0), blur)
        image += noise / noise.std()
    return np.clip(128 + 35 * image, 0, 255).astype(np.uint8)


def array(message: Image) -> np.ndarray:
    return messages.image_from_message(message)


BANDS = ((0, 40, 5), (40, 80, 11), (80, 120, 17))  # rows from, to, and the disparity of what they show
WIDTH, HEIGHT, FOCAL, BASELINE = 160, 120, 150.0, 0.1


def banded_pair(seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """A rectified pair of three planes: RGB, HEIGHT x WIDTH, disparities of `BANDS`."""
    wide = texture(HEIGHT, WIDTH + 40, seed)
    left, right = wide[:, :WIDTH].copy(), np.empty((HEIGHT, WIDTH, 3), np.uint8)
    for top, bottom, disparity in BANDS:
        right[top:bottom] = wide[top:bottom, disparity : disparity + WIDTH]
    return left, right


def infos_from_geometry(geometry: Any, size: tuple[int, int], head: Any) -> tuple[CameraInfo, CameraInfo]:
    """Both rectified views, of `size` (width, height) px."""
    left, right = (messages.camera_info_message(camera, head) for camera in rectified_cameras(geometry, size))
    return left, right


def infos(stamp_ns: int, *, metric: bool = True, baseline_m: float = BASELINE) -> tuple[CameraInfo, CameraInfo]:
    """Two ideal cameras side by side that fit `banded_pair`."""
    from uw_recon_ros.types import StereoGeometry

    cx, cy = (WIDTH - 1) / 2, (HEIGHT - 1) / 2
    geometry = StereoGeometry(FOCAL, cx, cx, cy, baseline_m=baseline_m if metric else None)
    return infos_from_geometry(geometry, (WIDTH, HEIGHT), messages.header(stamp_ns, FRAME))


def calibration(stamp_ns: int = 0) -> Any:
    """The same as `infos`, for offline stages."""
    from uw_recon_ros.ros.pairs import calibration_from_infos

    return calibration_from_infos(*infos(stamp_ns))
