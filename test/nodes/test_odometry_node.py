"""The odometry node, fed with views of a made-up bottom: what it tells is compared with where they were taken."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import Pose
from helpers.bottom_frames import GEOMETRY, SECOND, bottom, pose_at, view
from helpers.bottom_messages import Graph
from helpers.ros_bench import FRAME, Bench
from nav_msgs.msg import Odometry, Path
from scipy.spatial.transform import Rotation

from uw_recon_ros import rigid
from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.nodes import odometry_node
from uw_recon_ros.nodes.odometry_node import OdometryNode
from uw_recon_ros.ros.messages import stamp_ns, transform_message
from uw_recon_ros.ros.parameters import ParameterError
from uw_recon_ros.ros.transforms import TF
from uw_recon_ros.trajectory import DisparityFrame, pose_matrix
from uw_recon_ros.types import Matrix

PICTURE = bottom()
#: Looks straight down, 20 cm ahead of the vehicle's middle.
MOUNTED = {"base_frame": "base_link", "camera_pitch_deg": 90.0, "camera_x_m": 0.2}


def frames(poses: list[Matrix], first: int = 0) -> list[DisparityFrame]:
    return [view(PICTURE, pose, SECOND + round((first + k) * 0.2 * SECOND)) for k, pose in enumerate(poses)]


def matrix(pose: Pose) -> Matrix:
    p, q = pose.position, pose.orientation
    return pose_matrix(np.array([p.x, p.y, p.z]), Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix())


class Way:
    """A node, what it says, and a graph that feeds it."""

    def __init__(self, bench: Bench, **parameters: Any) -> None:
        self.heard, self.paths = bench.listen(Odometry, "odometry"), bench.listen(Path, "path")
        self.said = bench.listen(DiagnosticArray, "/diagnostics")
        self.node = bench.start(OdometryNode, **parameters)
        self.bench, self.graph = bench, Graph(bench, self.node)
        self.graph.connect()

    def see(self, seen: list[DisparityFrame]) -> None:
        for frame in seen:
            before = len(self.heard)
            self.graph.send(
                frame, lambda f=frame: self.node.stage.way.last_ns == f.stamp_ns and not self.node.session.busy
            )
            lost = self.node.stage.way.lost_since_ns is not None
            self.bench.spin_until(lambda n=before, out=lost: out or len(self.heard) > n, "odometry")

    def status(self, key: str) -> str:
        self.said.clear()
        self.bench.spin_until(lambda: len(self.said) > 1)
        return {pair.key: pair.value for pair in self.said[-1].status[0].values}.get(key, "")


def test_the_base_moves_as_the_vehicle_did(bench: Bench) -> None:
    way = Way(bench, **MOUNTED)
    poses = [pose_at(0.05 * k, 0.02 * k, 1.2 + 0.01 * k, 0.04 * k) for k in range(8)]
    way.see(frames(poses))
    mount = MountParams(**MOUNTED)
    base_from_camera = pose_matrix(mount.place, mount.base_from_optical)
    bases = [pose @ rigid.inverse(base_from_camera) for pose in poses]
    assert [stamp_ns(m) for m in way.heard] == [f.stamp_ns for f in frames(poses)]
    for message, base in zip(way.heard, bases, strict=True):
        assert (message.header.frame_id, message.child_frame_id) == ("odom", "base_link")
        missed = rigid.log(rigid.inverse(matrix(message.pose.pose)) @ rigid.inverse(bases[0]) @ base)
        assert np.abs(missed).max() < 0.01
        covariance = np.array(message.pose.covariance).reshape(6, 6)
        assert covariance == pytest.approx(covariance.T)
        assert np.linalg.eigvalsh(covariance).min() > -1e-12
    twist = way.heard[-1].twist.twist
    true = rigid.log(rigid.inverse(bases[-2]) @ bases[-1]) / 0.2
    told = [twist.linear.x, twist.linear.y, twist.linear.z, twist.angular.x, twist.angular.y, twist.angular.z]
    assert told == pytest.approx(true, abs=0.03)
    assert way.heard[0].twist.covariance[0] == 1e6  # of a first frame nothing is known
    assert 0 < way.heard[-1].twist.covariance[0] < 0.01
    assert way.status("tracking") == "tracked"
    assert float(way.status("position_sigma_m")) < 0.02
    path = way.paths[-1]
    assert len(path.poses) > 1
    last = matrix(path.poses[-1].pose)
    assert any(matrix(m.pose.pose) == pytest.approx(last) for m in way.heard)


def test_without_a_base_it_is_the_cameras_way(bench: Bench) -> None:
    """A camera that looks ahead rises by 10 cm where it moves up in its own picture."""
    way = Way(bench)
    way.see(frames([pose_at(0, 0.05 * k) for k in range(3)]))
    last = way.heard[-1]
    assert last.child_frame_id == FRAME
    assert matrix(last.pose.pose)[:3, 3] == pytest.approx([0, 0, 0.1], abs=0.005)


def test_while_lost_it_says_so_and_publishes_nothing(bench: Bench) -> None:
    way = Way(bench, odometry_lost_s=0.5, **MOUNTED)
    seen = frames([pose_at(-1 + 0.05 * k, 0) for k in range(4)])
    black = [replace(f, left=np.full_like(f.left, 3)) for f in frames([pose_at(0, 0)] * 4, first=4)]
    elsewhere = frames([pose_at(1 + 0.05 * k, 0.5) for k in range(4)], first=8)
    way.see(seen + black)
    assert len(way.heard) == len(seen)
    assert way.status("tracking") == "lost"
    assert "lost for 0.6 s" in way.status("odometry")
    assert way.status("codes") == "odometry.lost"
    assert way.status("position_sigma_m") == ""
    before = way.heard[-1]
    way.see(elsewhere)
    after = way.heard[len(seen)]
    moved = matrix(after.pose.pose)[:3, 3] - matrix(before.pose.pose)[:3, 3]
    assert np.linalg.norm(moved) < 0.1, "a jump"
    assert after.pose.covariance[0] > 0.3**2 > before.pose.covariance[0]
    assert way.status("tracking") == "tracked"


def test_without_metres_there_is_no_odometry(bench: Bench) -> None:
    way = Way(bench, **MOUNTED)
    frame = view(PICTURE, pose_at(0, 0), SECOND, GEOMETRY)
    way.graph.send(replace(frame, geometry=GEOMETRY.unscaled), lambda: way.node.diagnostics.drops)
    assert "metric scale unknown" in way.status("last drop")
    assert way.status("last drop code") == "odometry.not_metric"
    assert not way.heard


def test_a_clock_set_back_begins_anew(bench: Bench) -> None:
    """As a bag that is played again."""
    way = Way(bench, **MOUNTED)
    seen = frames([pose_at(0.05 * k, 0) for k in range(4)])
    way.see(seen)
    way.see(seen[:1])
    assert matrix(way.heard[-1].pose.pose) == pytest.approx(np.eye(4))
    assert way.heard[-1].pose.covariance[0] == 0


def test_without_nav_msgs_one_line_says_so(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    without = tuple(replace(output, type=None) for output in odometry_node.OUTPUTS)
    monkeypatch.setattr(odometry_node, "OUTPUTS", without)
    with pytest.raises(ParameterError, match=r"^nav_msgs: expected to be installed, not found"):
        OdometryNode(context=bench.context)


def test_the_path_stays_short(bench: Bench) -> None:
    way = Way(bench, path_poses=10, path_spacing_m=0.0, **MOUNTED)
    way.see(frames([pose_at(0.02 * k, 0) for k in range(14)]))
    assert len(way.node.stage.way.poses) <= 10


def test_tf_wants_a_base_and_tf2_msgs(bench: Bench) -> None:
    with pytest.raises(ParameterError, match=r"publish_tf: expected (tf2_msgs|base_frame)"):
        OdometryNode(context=bench.context, parameter_overrides=[_parameter("publish_tf", True)])
    if not TF:
        pytest.skip("tf2_msgs is part of ROS 2, not of the wheels")
    way = Way(bench, publish_tf=True, **MOUNTED)
    heard = bench.listen(TF[0].type, TF[0].topic)
    way.graph.connect()
    way.see(frames([pose_at(0.05 * k, 0) for k in range(3)]))
    transform = heard[-1].transforms[0]
    assert (transform.header.frame_id, transform.child_frame_id) == ("odom", "base_link")


def _parameter(name: str, value: Any) -> Any:
    from rclpy.parameter import Parameter

    return Parameter(name, value=value)


def test_a_transform_takes_the_child_to_its_parent() -> None:
    pose = rigid.exp(np.array([1.0, 2.0, 3.0, 0.1, -0.2, 0.3]))
    message = transform_message(7 * SECOND, "odom", "base_link", pose)
    assert (message.header.frame_id, message.child_frame_id, message.header.stamp.sec) == ("odom", "base_link", 7)
    t, q = message.transform.translation, message.transform.rotation
    found = pose_matrix(np.array([t.x, t.y, t.z]), Rotation.from_quat([q.x, q.y, q.z, q.w]).as_matrix())
    assert found == pytest.approx(pose)
