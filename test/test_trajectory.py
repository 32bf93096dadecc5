"""The trajectory and its files: what is written is read back, exactly in time, and evil files are refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from uw_recon_ros.errors import TrajectoryError
from uw_recon_ros.files.trajectories import read_trajectory_csv, read_tum, write_trajectory_csv, write_tum
from uw_recon_ros.findings import Code
from uw_recon_ros.trajectory import PoseStatus, Trajectory, trajectory_of

STAMPS = np.array([1_700_000_000_123_456_789, 1_700_000_000_123_456_790, 1_700_000_009_000_000_000], np.int64)


def some_trajectory() -> Trajectory:
    rng = np.random.default_rng(3)
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, :3, :3] = Rotation.random(3, random_state=5).as_matrix()
    poses[:, :3, 3] = rng.normal(size=(3, 3))
    square = rng.normal(size=(3, 6, 6))
    return Trajectory(
        STAMPS, poses, square @ square.transpose(0, 2, 1), np.array([0, 1, 2], np.uint8), np.array([0, 0, 1]),
        np.array([431_000.5, 5_210_000.25, -12.0]),
    )  # fmt: skip


def test_tum_keeps_every_nanosecond_and_the_world(tmp_path: Path) -> None:
    given = some_trajectory()
    write_tum(tmp_path / "t.txt", given)
    read = read_tum(tmp_path / "t.txt", origin=given.origin)
    assert np.array_equal(read.stamps_ns, STAMPS)
    assert read.poses == pytest.approx(given.poses, abs=2e-9)
    words = (tmp_path / "t.txt").read_text().splitlines()[1].split()
    assert float(words[1]) == pytest.approx(given.positions[0, 0] + 431_000.5, abs=1e-6)


def test_csv_keeps_status_segment_and_covariance(tmp_path: Path) -> None:
    given = some_trajectory()
    write_trajectory_csv(tmp_path / "t.csv", given)
    read = read_trajectory_csv(tmp_path / "t.csv", origin=given.origin)
    assert np.array_equal(read.status, given.status)
    assert np.array_equal(read.segment, given.segment)
    assert read.covariances == pytest.approx(given.covariances, rel=1e-5)
    assert "tracked" in (tmp_path / "t.csv").read_text()


def test_unknown_covariance_stays_unknown(tmp_path: Path) -> None:
    write_trajectory_csv(tmp_path / "t.csv", trajectory_of(STAMPS, some_trajectory().poses))
    assert np.isnan(read_trajectory_csv(tmp_path / "t.csv").covariances).all()


@pytest.mark.parametrize(
    "text",
    ["", "# only a comment\n", "1.0 0 0 0 0 0 0\n", "1.0 0 0 0 0 0 0 0\n", "1.0 nan 0 0 0 0 0 1\n", "x 0 0 0 0 0 0 1\n",
     "2.0 0 0 0 0 0 0 1\n1.0 0 0 0 0 0 0 1\n"],
)  # fmt: skip
def test_what_is_no_trajectory_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "t.txt").write_text(text)
    with pytest.raises(TrajectoryError) as caught:
        read_tum(tmp_path / "t.txt")
    assert caught.value.code is Code.TRAJECTORY
    assert "expected" in str(caught.value)
    with pytest.raises(TrajectoryError):
        read_trajectory_csv(tmp_path / "t.txt")


def test_shapes_and_order_are_checked() -> None:
    with pytest.raises(ValueError, match="increasing"):
        trajectory_of([2, 1], np.tile(np.eye(4), (2, 1, 1)))
    with pytest.raises(ValueError, match="origin"):
        trajectory_of([1], np.eye(4)[None], origin=np.zeros(2))


def test_another_frame_turns_poses_and_covariance_alike() -> None:
    """The covariance of a world quantity, here the position, does not depend on the frame it is told in."""
    given = some_trajectory()
    turn = Rotation.from_euler("xyz", [10, -20, 30], degrees=True).as_matrix()
    other = given.turned(turn)
    for k in range(3):
        before = given.rotations[k] @ given.covariances[k, :3, :3] @ given.rotations[k].T
        after = other.rotations[k] @ other.covariances[k, :3, :3] @ other.rotations[k].T
        assert after == pytest.approx(before)
    assert other.positions == pytest.approx(given.positions)


def test_status_names() -> None:
    assert [str(s) for s in PoseStatus] == ["tracked", "bridged", "predicted", "given"]
