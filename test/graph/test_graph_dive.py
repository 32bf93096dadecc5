"""A dive replayed to the nodes as processes: where they say the vehicle went, and what they saw, is the truth."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.bottom_frames import GEOMETRY, HEIGHT, SECOND, WIDTH, bottom, pose_at, view
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger

from uw_recon_ros import rigid
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.evaluate_trajectory import trajectory_errors
from uw_recon_ros.files.trajectories import read_tum
from uw_recon_ros.messages.cameras import rectified_cameras
from uw_recon_ros.ros.messages import stamp_ns, view_from_odometry
from uw_recon_ros.trajectory import trajectory_of
from uw_recon_ros.types import Matrix

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
FRAME = "rov_left_optical_frame"
FRAMES, STEP_M = 24, 0.06
TRUTH = {(k + 1) * SECOND // 5: pose_at(-0.7 + STEP_M * k, 0.02 * k, yaw=0.02 * k) for k in range(FRAMES)}


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Five pairs a second of a flat bottom, 1.2 m below."""
    picture, right = bottom(), rigid.exp(np.array([0.1, 0, 0, 0, 0, 0]))
    cameras = rectified_cameras(GEOMETRY, (WIDTH, HEIGHT))
    with BagWriter(tmp_path / "bag") as writer:
        for stamp, pose in TRUTH.items():
            for side, seen_from, camera in zip(("left", "right"), (pose, pose @ right), cameras, strict=True):
                image = view(picture, seen_from, stamp).left
                writer.camera_info(f"/{side}/camera_info", camera, time_ns=stamp, frame_id=FRAME)
                writer.image(f"/{side}/image_raw", image, time_ns=stamp, frame_id=FRAME)
    return tmp_path / "bag"


def found_way(heard: list[Odometry]) -> tuple[list[int], Matrix]:
    """Stamps and poses of the left view."""
    return [stamp_ns(m) for m in heard], np.array([view_from_odometry(m, np.eye(4))[0] for m in heard])


def test_the_way_and_the_bottom_of_a_replayed_dive(graph: Any, bag: Path, tmp_path: Path) -> None:
    """Odometry within 3 % of the path; the model is the plane; `~/save` leaves both."""
    odometry, clouds = graph.bench.listen(Odometry, "odometry"), graph.bench.listen(PointCloud2, "model/points")
    folder = tmp_path / "model"
    values = {"effort": "navigation", "min_disparity": 0, "max_disparity": 47, "model_submap_frames": 5}
    given = [part for name, value in values.items() for part in ("-p", f"{name}:={value}")]
    graph.start("pipeline_node", "--ros-args", *given)
    graph.start("odometry_node", "--ros-args", *given)
    graph.start("model_node", "--ros-args", *given, "-p", f"model_folder:={folder}")
    graph.ready("pipeline_node", "odometry_node", "model_node")
    graph.spin_until(lambda: graph.said["/pipeline_node"].get("warm_up") == "done", "compiled kernels")
    graph.spin_until(lambda: graph.said["/model_node"].get("warm_up") == "done", "compiled kernels")
    topics = [f"/{side}/{topic}" for side in ("left", "right") for topic in ("image_raw", "camera_info")]
    graph.start("bag_player_node", bag, "--rate", "0.4", "--wait-for", *topics)
    graph.spin_until(lambda: len(odometry) > FRAMES / 3 and clouds, "odometry and a submap")
    graph.spin_until(lambda: stamp_ns(odometry[-1]) >= max(TRUTH) - SECOND, "the end of the dive")
    stamps, poses = found_way(odometry)
    true = np.array([TRUTH[stamp] for stamp in stamps])
    path = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum())
    missed = rigid.inverse(poses[0]) @ poses @ rigid.inverse(rigid.inverse(true[0]) @ true)
    assert path > 0.5
    assert np.linalg.norm(missed[:, :3, 3], axis=1).max() < 0.03 * path
    points = np.frombuffer(clouds[-1].data, np.float32).reshape(-1, clouds[-1].point_step // 4)[:, :3].astype(float)
    middle = points.mean(axis=0)
    away = np.abs((points - middle) @ np.linalg.svd(points - middle, full_matrices=False)[2][2])
    assert len(points) > 1000
    assert np.median(away) < 0.01
    answer = graph.call("/model_node/save", Trigger, Trigger.Request())
    assert answer.success, answer.message
    graph.spin_until(folder.exists, "the model's files")
    way = read_tum(folder / "trajectory.txt")
    truth = trajectory_of(way.stamps_ns, np.array([TRUTH[int(stamp)] for stamp in way.stamps_ns]))
    assert trajectory_errors(way, truth).segments[0].ate_m < 0.02
