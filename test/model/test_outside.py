"""What a bag knows of the way beside its pictures: against the simulated course that its sensors measured."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uw_recon_ros.bags.messages import MAKE
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.findings import Code
from uw_recon_ros.georeference.crs import LOCAL
from uw_recon_ros.messages.headers import header
from uw_recon_ros.model.external_poses import Outside, read_outside
from uw_recon_ros.simulate.navigation_sensors import sensor_messages
from uw_recon_ros.simulate.params import CourseParams, SimulateParams, defaults_on
from uw_recon_ros.simulate.rig import LEFT_FRAME
from uw_recon_ros.simulate.tracks import Course
from uw_recon_ros.types import Matrix

SECONDS, START_NS = 20.0, 10**9
TURN = Rotation.from_rotvec([0.0, 0.02, 0.01]).as_matrix()  # rectified <- raw


def course() -> Course:
    return Course(SimulateParams.from_mapping(defaults_on("lawnmower") | {"frames": 40}), CourseParams(leg_m=2.0))


def bag(folder: Path, extra: Callable[[BagWriter], None] = lambda _: None, drop: tuple[str, ...] = ()) -> str:
    path = folder / "bag"
    with BagWriter(path) as writer:
        for side in ("left", "right"):
            frame = LEFT_FRAME if side == "left" else "right_optical_frame"
            writer.image(f"/{side}/image_raw", np.zeros((4, 4), np.uint8), time_ns=START_NS, frame_id=frame)
        extra(writer)
        for topic, message in sensor_messages(course(), SECONDS, START_NS):
            if topic not in drop:
                writer.message(topic, message)
    return str(path)


def true_poses(stamps_ns: Any) -> Matrix:
    """World <- rectified view."""
    poses = np.tile(np.eye(4), (len(stamps_ns), 1, 1))
    for pose, stamp in zip(poses, stamps_ns, strict=True):
        at = course().pose((stamp - START_NS) / 1e9)
        pose[:3, :3], pose[:3, 3] = at.rotation @ TURN.T, at.position
    return poses


def named(outside: Outside, topic: str) -> Any:
    return next(p for p in outside.priors if p.name == topic)


@pytest.fixture(scope="module")
def outside(tmp_path_factory: pytest.TempPathFactory) -> Outside:
    return read_outside([bag(tmp_path_factory.mktemp("bag"))], TURN)


def test_the_attitude_is_that_of_the_rectified_view_and_its_heading_is_not_believed(outside: Outside) -> None:
    found = named(outside, "/imu/data")
    missed = Rotation.from_matrix(found.poses[:, :3, :3] @ true_poses(found.stamps_ns)[:, :3, :3].transpose(0, 2, 1))
    assert np.sqrt(np.mean(missed.as_rotvec() ** 2, axis=0)) == pytest.approx([0.005] * 3, abs=0.002)
    assert found.known.tolist() == [False] * 3 + [True] * 3
    assert found.information[5, 5] < 1e-3 * found.information[4, 4]


def test_fixes_are_in_a_zone_of_utm_less_a_whole_kilometre(outside: Outside) -> None:
    found = named(outside, "/gnss/fix")
    assert outside.crs.epsg == 32631
    assert np.all(outside.origin % 1000 == 0)
    true = true_poses(found.stamps_ns)[:, :3, 3]
    places = found.poses[:, :3, 3] - found.poses[:, :3, 3].mean(axis=0)
    # the simulator's sphere is not WGS 84: 0.3 % along a parallel and a meridian, and UTM's scale
    assert np.std(places - (true - true.mean(axis=0)), axis=0) == pytest.approx([0.5, 0.5, 1.0], rel=0.5)
    assert 1 / np.sqrt(np.diag(found.information)[:3]) == pytest.approx([0.5, 0.5, 1.0], rel=0.01)


def test_pressure_is_depth_in_metres(outside: Outside) -> None:
    found = named(outside, "/pressure")
    heights = found.poses[:, 2, 3] - true_poses(found.stamps_ns)[:, 2, 3]
    assert np.mean(heights) == pytest.approx(-5.0, abs=0.01)
    assert np.std(heights) == pytest.approx(0.01, rel=0.2)
    assert found.known.tolist() == [False, False, True, False, False, False]


def test_odometry_of_the_base_is_carried_to_the_camera_by_tf_static(tmp_path: Path) -> None:
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix(), [0.5, -0.2, 0.1]

    def extra(writer: BagWriter) -> None:
        writer.message("/tf_static", tf([("base", LEFT_FRAME, mount)]), log_time_ns=START_NS)
        for k in range(40):
            at = course().pose(k / 2)
            raw = np.eye(4)
            raw[:3, :3], raw[:3, 3] = at.rotation, at.position
            writer.message("/odom", odometry(START_NS + k * 500_000_000, raw @ np.linalg.inv(mount)))

    outside = read_outside([bag(tmp_path, extra, drop=("/gnss/fix",))], TURN)
    found = named(outside, "/odom")
    np.testing.assert_allclose(found.poses, true_poses(found.stamps_ns), atol=1e-9)
    assert found.smooth
    assert found.absolute
    assert outside.crs is LOCAL


def test_tf_of_the_base_serves_where_there_is_no_odometry(tmp_path: Path) -> None:
    mount = np.eye(4)
    mount[:3, :3], mount[:3, 3] = Rotation.from_rotvec([0.3, -1.2, 0.4]).as_matrix(), [0.5, -0.2, 0.1]

    def extra(writer: BagWriter) -> None:
        writer.message("/tf_static", tf([("base", LEFT_FRAME, mount)]), log_time_ns=START_NS)
        for k in range(40):
            at, stamp = course().pose(k / 2), START_NS + k * 500_000_000
            raw = np.eye(4)
            raw[:3, :3], raw[:3, 3] = at.rotation, at.position
            joints = [("odom", "base", raw @ np.linalg.inv(mount)), ("base", "arm", np.eye(4))]
            writer.message("/tf", tf(joints, stamp), log_time_ns=stamp)

    outside = read_outside([bag(tmp_path, extra, drop=("/gnss/fix",))], TURN)
    found = named(outside, "/tf odom to base")
    np.testing.assert_allclose(found.poses, true_poses(found.stamps_ns), atol=1e-9)
    assert (found.smooth, found.absolute) == (True, True)
    (tmp_path / "fixes").mkdir()
    beside = read_outside([bag(tmp_path / "fixes", extra)], TURN)
    assert not named(beside, "/tf odom to base").absolute  # GNSS says where, tf only how it moved


def test_what_nothing_joins_to_the_camera_is_left_out_and_said_so(tmp_path: Path) -> None:
    def extra(writer: BagWriter) -> None:
        for k in range(4):
            writer.message("/odom", odometry(START_NS + k * 500_000_000, np.eye(4)))

    outside = read_outside([bag(tmp_path, extra)], TURN)
    assert "/odom" not in [p.name for p in outside.priors]
    (finding,) = outside.findings
    assert finding.code is Code.TRACK_PRIORS_LEFT_OUT
    assert "/odom" in finding.text


def test_a_bag_that_knows_nothing_gives_nothing(tmp_path: Path) -> None:
    path = bag(tmp_path, drop=("/imu/data", "/gnss/fix", "/pressure", "/dvl/twist"))
    found = read_outside([path], TURN)
    assert (found.priors, found.findings, found.crs) == ([], [], LOCAL)


def tf(joints: list[tuple[str, str, Matrix]], stamp_ns: int = START_NS) -> Any:
    transforms = []
    for parent, child, motion in joints:
        turn, place = quaternion(motion), MAKE("geometry_msgs/msg/Vector3", **xyz(motion))
        transforms.append(
            MAKE("geometry_msgs/msg/TransformStamped", header=header(MAKE, stamp_ns, parent), child_frame_id=child,
                 transform=MAKE("geometry_msgs/msg/Transform", translation=place, rotation=turn))
        )  # fmt: skip
    return MAKE("tf2_msgs/msg/TFMessage", transforms=transforms)


def odometry(stamp_ns: int, pose: Matrix) -> Any:
    place = MAKE("geometry_msgs/msg/Point", **xyz(pose))
    inner = MAKE("geometry_msgs/msg/Pose", position=place, orientation=quaternion(pose))
    return MAKE("nav_msgs/msg/Odometry", header=header(MAKE, stamp_ns, "odom"), child_frame_id="base",
                pose=MAKE("geometry_msgs/msg/PoseWithCovariance", pose=inner))  # fmt: skip


def xyz(pose: Matrix) -> dict[str, float]:
    return dict(zip("xyz", pose[:3, 3].tolist(), strict=True))


def quaternion(pose: Matrix) -> Any:
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
    return MAKE("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)
