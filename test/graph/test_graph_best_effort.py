"""Sensor-data subscribers in another process, as costmaps and MoveIt are: megabytes arrive, best effort or not."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import pytest
from helpers.ros_bench import FRAME, banded_pair, color, infos
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from uw_recon_ros.ros import messages

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
SCALE = 4  # 640 x 480
KINDS = {"points2": PointCloud2, "points2_filtered": PointCloud2, "depth/image_rect": Image,
         "depth/camera_info": CameraInfo}  # fmt: skip


def larger(info: CameraInfo) -> CameraInfo:
    info.width, info.height = info.width * SCALE, info.height * SCALE
    for values in (info.k, info.p):
        for i in range(6 if values is info.k else 8):
            values[i] *= SCALE
    return info


def test_big_clouds_reach_best_effort_readers(graph: Any, tmp_path: Path) -> None:
    graph.start("pipeline_node", "--ros-args", "-p", "effort:=navigation", "-p", "max_disparity:=90")
    bench = graph.bench
    heard: dict[str, list[Any]] = {topic: [] for topic in KINDS}
    for topic, kind in KINDS.items():
        bench.outsider.create_subscription(kind, topic, heard[topic].append, qos_profile_sensor_data)
    images = {side: bench.talk(Image, f"{side}/image_raw") for side in ("left", "right")}
    told = {side: bench.talk(CameraInfo, f"{side}/camera_info") for side in ("left", "right")}
    graph.spin_until(lambda: all(p.get_subscription_count() for p in (*images.values(), *told.values())), "the node")
    sent = [0]

    def send() -> None:
        stamp = (sent[0] + 1) * 1_000_000_000
        for side, image, info in zip(("left", "right"), banded_pair(), infos(stamp), strict=True):
            told[side].publish(larger(info))
            size = (image.shape[1] * SCALE, image.shape[0] * SCALE)
            images[side].publish(color(cv2.resize(image, size, interpolation=cv2.INTER_CUBIC), stamp))
        sent[0] += 1

    def answered() -> bool:
        """A pair at a time, the next once its cloud has come; a lost message would end the waiting."""
        if len(heard["points2"]) == sent[0] and sent[0] < 4:
            send()
        return all(len(got) == 4 for got in heard.values())

    graph.spin_until(answered, "four answers a topic")
    for topic, got in heard.items():
        assert [messages.stamp_ns(m) for m in got] == [(i + 1) * 1_000_000_000 for i in range(4)], topic
        assert {m.header.frame_id for m in got} == {FRAME}
    assert len(heard["points2"][0].data) > 3_000_000
