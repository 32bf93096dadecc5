"""The model node, fed with views of a made-up flat bottom and an odometry: its model is that bottom."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from helpers.bottom_frames import SECOND, bottom, pose_at, view
from helpers.bottom_messages import Graph
from helpers.ros_bench import FRAME, Bench
from nav_msgs.msg import Odometry
from sensor_msgs.msg import PointCloud2
from std_srvs.srv import Trigger
from visualization_msgs.msg import Marker

from uw_recon_ros.files.trajectories import read_tum
from uw_recon_ros.nodes.model_node import ModelNode
from uw_recon_ros.ros.messages import odometry_message
from uw_recon_ros.trajectory import VehicleState
from uw_recon_ros.types import Matrix

PICTURE = bottom()
SMALL = {"model_submap_frames": 4, "model_loop_m": 0.0}
WAY = [pose_at(0.105 * k - 0.8, 0.0) for k in range(8)]


class Dive:
    """A node, what it says, and a graph with an odometry that feeds it."""

    def __init__(self, bench: Bench, child: str = FRAME, **parameters: Any) -> None:
        self.bench, self.child = bench, child
        self.clouds, self.submaps = bench.listen(PointCloud2, "model/points"), bench.listen(PointCloud2, "model/submap")
        self.surfaces, self.said = bench.listen(Marker, "model/surface"), bench.listen(DiagnosticArray, "/diagnostics")
        self.node = bench.start(ModelNode, **SMALL, **parameters)
        self.graph, self.talker = Graph(bench, self.node), bench.talk(Odometry, "odometry")
        self.save_client = bench.outsider.create_client(Trigger, "model_node/save")
        self.graph.connect()
        bench.connected(self.talker)

    def see(self, poses: list[Matrix]) -> None:
        for k, pose in enumerate(poses):
            stamp = SECOND + k * SECOND // 5
            zero, covariance = np.zeros(6), 1e-6 * (k + 1) * np.eye(6)
            state = VehicleState(stamp, "odom", self.child, pose, covariance, zero, covariance)
            self.talker.publish(odometry_message(state))
            before = sum(self.node.diagnostics.drops.values())
            self.graph.send(view(PICTURE, pose, stamp), lambda s=stamp, n=before: self._handled(s, n))

    def _handled(self, stamp: int, drops: int) -> bool:
        fused = self.node.stage.dive.last_ns == stamp and not self.node.session.busy
        return fused or sum(self.node.diagnostics.drops.values()) > drops

    def save(self) -> Trigger.Response:
        self.bench.spin_until(self.save_client.service_is_ready, "the service")
        future = self.save_client.call_async(Trigger.Request())
        self.bench.spin_until(future.done, "an answer")
        return future.result()

    def status(self, key: str) -> str:
        self.said.clear()
        self.bench.spin_until(lambda: len(self.said) > 1)
        return {pair.key: pair.value for pair in self.said[-1].status[0].values}.get(key, "")


def points(cloud: PointCloud2) -> np.ndarray:
    return np.frombuffer(cloud.data, np.float32).reshape(-1, cloud.point_step // 4)[:, :3]


def test_the_model_is_the_bottom(bench: Bench) -> None:
    dive = Dive(bench)
    dive.see(WAY)
    bench.spin_until(
        lambda: len(dive.clouds) >= 2 and len(dive.surfaces) >= 2 and len(dive.submaps) >= 2, "two submaps"
    )
    cloud = dive.clouds[-1]
    assert cloud.header.frame_id == "map"
    assert np.abs(points(cloud)[:, 2]).max() < 0.01
    assert len(points(dive.submaps[-1])) < len(points(cloud))
    assert len(dive.surfaces[-1].points) > 300
    assert (dive.status("key_frames"), dive.status("submaps")) == ("8", "2")


def test_an_odometry_of_something_else_is_refused(bench: Bench) -> None:
    dive = Dive(bench, child="base_link")
    dive.see(WAY[:1])
    assert "expected that of" in dive.status("last drop")
    assert dive.status("last drop code") == "model.poses"


def test_save_writes_a_model_once_and_never_over_another(bench: Bench, tmp_path: Path) -> None:
    folder = tmp_path / "model"
    dive = Dive(bench, model_folder=str(folder))
    assert not dive.save().success  # nothing was seen yet
    dive.see(WAY)
    answer = dive.save()
    assert answer.success, answer.message
    bench.spin_until(folder.exists, "the model")
    dive.node._saving.join(60)
    names = {path.name for path in folder.iterdir()}
    assert names >= {
        "mesh.ply",
        "mesh.glb",
        "cloud.ply",
        "orthomosaic.tif",
        "elevation.tif",
        "trajectory.txt",
        "model.json",
    }
    way = read_tum(folder / "trajectory.txt")
    assert np.abs(way.positions - np.array([pose[:3, 3] for pose in WAY])).max() < 1e-6
    assert dive.status("save").startswith("done")
    before = {path: path.read_bytes() for path in folder.iterdir()}
    again = dive.save()
    assert not again.success
    assert "holds something" in again.message
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    kept = dive.node.stage.dive.kept.folder
    assert kept.exists()
    dive.node.stop(30.0)
    assert not kept.exists(), "key frames stay on the disk"


def test_without_a_folder_nothing_is_kept_and_save_says_why(bench: Bench) -> None:
    dive = Dive(bench)
    dive.see(WAY[:3])
    answer = dive.save()
    assert not answer.success
    assert "model_folder" in answer.message
    assert dive.node.stage.dive.kept is None
