"""Ten thousand malformed messages: refused each with its reason, and the good frames before and after unharmed.

Most go straight to the node's own subscription callbacks, which is the middleware's way in without its delay; some
hundreds go through DDS. No node subscribes to a PointCloud2, so none is made here.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
from helpers import bad_messages as bad
from helpers.ros_bench import AUTOPILOT, FRAME, LIMIT_S, Bench, color, infos_from_geometry, mono, texture
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.images import to_gray
from uw_recon_ros.nodes import disparity_node, pipeline_node, point_cloud_node, preprocess_node, rectify_node
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.diagnostics import NO_PARTNER, SUPERSEDED
from uw_recon_ros.types import StereoGeometry

SECOND, MILLI = 1_000_000_000, 1_000_000
WIDTH, HEIGHT, SHIFT = 64, 48, 5
LEFT, RIGHT = (texture(HEIGHT, WIDTH + SHIFT, 4)[:, first : first + WIDTH].copy() for first in (0, SHIFT))
LIMITS = {"min_disparity": 0, "max_disparity": 12, "effort": "navigation"}
QUIET = (NO_PARTNER, SUPERSEDED)  # the graph's way to keep up, and what is left of a group whose member was refused
BATCH = 25


def camera_infos(stamp: int) -> tuple[CameraInfo, CameraInfo]:
    geometry = StereoGeometry(60.0, (WIDTH - 1) / 2, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, baseline_m=0.1)
    return infos_from_geometry(geometry, (WIDTH, HEIGHT), messages.header(stamp, FRAME))


def good_images(stamp: int) -> dict[str, Any]:
    return {f"{side}/image_raw": color(image, stamp) for side, image in (("left", LEFT), ("right", RIGHT))}


def good_compressed(stamp: int) -> dict[str, Any]:
    found = {}
    for side, image in (("left", LEFT), ("right", RIGHT)):
        message = CompressedImage(header=messages.header(stamp, FRAME), format="png")
        message.data.frombytes(cv2.imencode(".png", image[..., ::-1])[1].tobytes())
        found[f"{side}/image_raw/compressed"] = message
    return found


def good_camera_infos(stamp: int, prefix: str = "") -> dict[str, Any]:
    return {
        f"{prefix}{side}/camera_info": info for side, info in zip(("left", "right"), camera_infos(stamp), strict=True)
    }


def good_enhanced(stamp: int) -> dict[str, Any]:
    sides = (("left", LEFT), ("right", RIGHT))
    enhanced = {f"{side}/image_enhanced": color(image, stamp) for side, image in sides}
    matching = {f"{side}/image_matching": mono(to_gray(image), stamp) for side, image in sides}
    return {**good_camera_infos(stamp), **enhanced, **matching}


def good_rectified(stamp: int) -> dict[str, Any]:
    sides = (("left", LEFT), ("right", RIGHT))
    return {
        **good_camera_infos(stamp, "rectified/"),
        **{f"rectified/{side}/image_rect": mono(to_gray(image), stamp) for side, image in sides},
    }


def good_disparity(stamp: int) -> dict[str, Any]:
    values = np.full((HEIGHT, WIDTH), np.float32(SHIFT))
    values[:, :SHIFT] = np.nan
    head = messages.header(stamp, FRAME)
    disparity = DisparityImage(header=head, image=messages.image_message(values, head), max_disparity=12.0)
    disparity.f, disparity.t = 60.0, 0.1
    disparity.valid_window.width, disparity.valid_window.height = WIDTH, HEIGHT
    return {
        **good_camera_infos(stamp, "rectified/"),
        "rectified/left/image_rect_color": color(LEFT, stamp),
        "disparity/sigma": messages.image_message(np.full_like(values, 0.3), head),
        "disparity/status": mono(np.uint8(8) * np.isnan(values).astype(np.uint8), stamp),
        "disparity": disparity,
    }


def content(value: Any) -> Any:
    """A message as nested tuples without its stamps, arrays as bytes: NaN equals NaN."""
    if type(value).__name__ == "Time":
        return None
    if hasattr(value, "get_fields_and_field_types"):
        return tuple((name, content(getattr(value, name))) for name in value.get_fields_and_field_types())
    if hasattr(value, "tobytes"):
        return value.tobytes()
    return [content(each) for each in value] if isinstance(value, list) else repr(value)


class Subject:
    """A node under attack: its inputs, and all that it publishes."""

    def __init__(
        self, bench: Bench, module: Any, make: Any, good: Callable[[int], dict[str, Any]], **more: Any
    ) -> None:
        self.bench, self._good, self.stamp = bench, good, SECOND
        self.publishers = {topic: bench.talk(type(message), topic) for topic, message in good(0).items()}
        outputs = [output for output in module.OUTPUTS if output.topic != point_cloud_node.UNSCALED]
        self.heard = {output.topic: bench.listen(output.type, output.topic) for output in outputs}
        self.node = bench.start(make, **more)
        bench.connected(*self.publishers.values())
        bench.spin_until(lambda: self.expected >= self.publishers.keys(), "subscriptions to all that is published")
        self.before = self.answer()

    @property
    def expected(self) -> set[str]:
        return {subscription.topic_name.lstrip("/") for subscription in self.node.subscriptions}

    def callbacks(self) -> dict[str, Callable[[Any], None]]:
        return {s.topic_name.lstrip("/"): s.callback for s in self.node.subscriptions}

    def refused(self) -> dict[str, int]:
        return {reason: number for reason, number in self.node.diagnostics.drops.items() if reason not in QUIET}

    @property
    def count(self) -> int:
        return sum(self.refused().values())

    def next(self) -> dict[str, Any]:
        self.stamp += 10 * MILLI
        return self._good(self.stamp)

    def answer(self) -> dict[str, Any]:
        """What the node makes of a good frame that reaches it through DDS.

        DDS keeps no order between topics: where the images overtake a camera_info, the bad one before it costs them
        too; then there is a second frame, as from a camera.
        """
        for got in self.heard.values():
            got.clear()
        for _ in range(3):
            count = self.count
            for topic, message in self.next().items():
                self.publishers[topic].publish(message)
            self.bench.spin_until(lambda c=count: all(self.heard.values()) or self.count > c, "answers to a good frame")
            if all(self.heard.values()):
                break
        assert all(self.heard.values()), self.refused()
        return {topic: content(got[-1]) for topic, got in self.heard.items()}

    def send(self, each: bad.Bad, send: dict[str, Callable[[Any], None]]) -> None:
        """A bad message, then its good partners."""
        everything = self.next()
        each.spoil(everything[each.topic])
        send[each.topic](everything.pop(each.topic))
        if not each.alone:
            for topic, message in everything.items():
                send[topic](message)

    def attack(self, each: bad.Bad) -> None:
        """A bad message straight to the node's callback: it is refused, once, for the right reason."""
        count, end = self.count, time.monotonic() + LIMIT_S
        self.send(each, self.callbacks())
        while self.count <= count:
            assert time.monotonic() < end, f"taken: {each.what} on {each.topic}; drops {self.node.diagnostics.drops}"
            time.sleep(1e-4)
        assert self.count == count + 1, each
        said = self.node.diagnostics.tick("node")
        words = next(pair.value for pair in said.values if pair.key == "last drop")
        assert each.words in words, f"{each}: {words}"
        assert "\n" not in words, each
        assert len(words) < 1000, each
        assert set(self.refused()) <= {"ImageError", "CalibrationError", "MessageError"}, words

    def attack_through_dds(self, each: bad.Bad) -> None:
        """The same as a stranger would: sent again where images overtook the camera_info that is to spoil them."""
        count, end = self.count, time.monotonic() + LIMIT_S
        while self.count <= count:
            assert time.monotonic() < end, f"taken: {each.what} on {each.topic}; drops {self.node.diagnostics.drops}"
            self.send(each, {topic: publisher.publish for topic, publisher in self.publishers.items()})
            again = time.monotonic() + 0.3
            while self.count <= count and time.monotonic() < again:
                self.bench.executor.spin_once(timeout_sec=0.01)
        assert set(self.refused()) <= {"ImageError", "CalibrationError", "MessageError"}

    def unharmed(self) -> None:
        """The next good frame gives what the first gave, bit for bit."""
        after = self.answer()
        assert [topic for topic, told in after.items() if told != self.before[topic]] == []


def bombard(subject: Subject, flaws: st.SearchStrategy[bad.Bad], number: int, *, dds: bool = False) -> None:
    attack = subject.attack_through_dds if dds else subject.attack
    done = []

    @settings(
        database=None, max_examples=max(number // BATCH, 1), phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(st.lists(flaws, min_size=BATCH, max_size=BATCH))
    def test(batch: list[bad.Bad]) -> None:
        for each in batch:
            attack(each)
        done.extend(batch)
        subject.unharmed()

    test()
    assert len(done) >= 0.95 * number, "hypothesis ran out of examples"


def on(flaws: st.SearchStrategy[bad.Flaw], *topics: str) -> st.SearchStrategy[bad.Bad]:
    return st.builds(lambda flaw, topic: flaw.on(topic), flaws, st.sampled_from(topics))


SIDES = ("left", "right")
RAW = on(bad.bad_partners, *(f"{side}/image_raw" for side in SIDES))
COMPRESSED = on(bad.bad_compressed, *(f"{side}/image_raw/compressed" for side in SIDES))
INFOS = on(bad.bad_infos, *(f"{side}/camera_info" for side in SIDES))
ENHANCED = on(bad.bad_partners, *(f"{side}/image_{kind}" for side in SIDES for kind in ("enhanced", "matching")))
RECTIFIED = on(bad.bad_partners, *(f"rectified/{side}/image_rect" for side in SIDES))
RECTIFIED_INFOS = st.one_of(
    on(bad.bad_rectified_infos, *(f"rectified/{side}/camera_info" for side in SIDES)),
    on(bad.bad_left_rotation, "rectified/left/camera_info"),
)
COMPANIONS = st.one_of(
    on(bad.bad_floats, "disparity/sigma"),
    on(st.one_of(bad.bad_images, st.just(bad.SMALLER)), "disparity/status", "rectified/left/image_rect_color"),
)
DISPARITY = on(bad.bad_disparities, "disparity")
ATTACKS: dict[str, tuple[Any, Any, Any, dict[str, Any], Any, int]] = {
    "preprocess raw": (preprocess_node, preprocess_node.PreprocessNode, good_images, {}, RAW, 2000),
    "preprocess compressed": (
        preprocess_node, preprocess_node.PreprocessNode, good_compressed, {"image_transport": "compressed"},
        COMPRESSED, 1500,
    ),
    "rectify": (rectify_node, rectify_node.RectifyNode, good_enhanced, {}, st.one_of(ENHANCED, INFOS), 2000),
    "disparity": (
        disparity_node, disparity_node.DisparityNode, good_rectified, LIMITS, st.one_of(RECTIFIED, RECTIFIED_INFOS),
        1500,
    ),
    "point cloud": (
        point_cloud_node, point_cloud_node.PointCloudNode, good_disparity, AUTOPILOT,
        st.one_of(DISPARITY, COMPANIONS, RECTIFIED_INFOS), 2000,
    ),
    "pipeline": (
        pipeline_node, pipeline_node.PipelineNode, lambda s: {**good_camera_infos(s), **good_images(s)},
        LIMITS | AUTOPILOT,
        st.one_of(RAW, INFOS), 1000,
    ),
}  # fmt: skip
assert sum(attack[-1] for attack in ATTACKS.values()) == 10_000


@pytest.fixture(params=ATTACKS)
def attacked(request: pytest.FixtureRequest, bench: Bench) -> tuple[Subject, Any, int]:
    module, make, good, parameters, flaws, number = ATTACKS[request.param]
    return Subject(bench, module, make, good, **parameters), flaws, number


def test_each_is_refused_with_its_reason(attacked: tuple[Subject, Any, int]) -> None:
    subject, flaws, number = attacked
    bombard(subject, flaws, number)


def test_the_same_through_dds(attacked: tuple[Subject, Any, int]) -> None:
    subject, flaws, _ = attacked
    bombard(subject, flaws, 3 * BATCH, dds=True)


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9])
def test_bytes_that_are_no_message_harm_nobody(bench: Bench, share: float) -> None:
    """A stranger's publisher may send anything: the middleware drops it, and the node goes on."""
    subject = Subject(bench, preprocess_node, preprocess_node.PreprocessNode, good_images)
    good = serialize_message(good_images(SECOND)["left/image_raw"])
    random = np.random.default_rng(7)
    for _ in range(25):
        spoiled = bytearray(good[: int(share * len(good))] or b"\0")
        for place in random.integers(0, min(len(spoiled), 80), 4):
            spoiled[place] = random.integers(256)
        subject.publishers["left/image_raw"].publish(bytes(spoiled))
        bench.executor.spin_once(timeout_sec=0.002)
    subject.unharmed()


def test_a_burst_costs_what_cannot_be_kept_and_no_more(bench: Bench) -> None:
    """A thousand images of one camera at once, then a good pair."""
    subject = Subject(bench, preprocess_node, preprocess_node.PreprocessNode, good_images)
    taken = subject.callbacks()["left/image_raw"]
    for _ in range(1000):
        taken(subject.next()["left/image_raw"])
    assert subject.node.diagnostics.drops[NO_PARTNER] >= 1000 - 2 * 16
    subject.unharmed()


def test_a_frame_named_like_a_path_is_only_a_name(bench: Bench, tmp_path: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    subject = Subject(bench, preprocess_node, preprocess_node.PreprocessNode, good_images)
    everything = subject.next()
    for message in everything.values():
        message.header.frame_id = "../../tmp/<script>"
    for topic, message in everything.items():
        subject.publishers[topic].publish(message)
    heard = subject.heard["left/image_enhanced"]
    bench.spin_until(lambda: heard and heard[-1].header.frame_id == "../../tmp/<script>", "the name handed through")
    assert list(tmp_path.iterdir()) == []
