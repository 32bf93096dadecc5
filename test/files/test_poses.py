"""Poses from outside: TUM, our own CSV and others' tables."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uw_recon_ros.errors import TrajectoryError
from uw_recon_ros.files.trajectories import read_poses, write_trajectory_csv, write_tum
from uw_recon_ros.model.build import _told_sigmas
from uw_recon_ros.trajectory import Trajectory, trajectory_of

STAMPS = [1_700_000_000_123_456_789, 1_700_000_001_000_000_000]


def way() -> Trajectory:
    poses = np.tile(np.eye(4), (2, 1, 1))
    poses[:, :3, 3] = [[1, 2, 3], [4, 5, 6]]
    return trajectory_of(STAMPS, poses)


def same(found: Trajectory) -> bool:
    return bool((found.stamps_ns == STAMPS).all() and np.allclose(found.poses, way().poses))


def test_every_form_is_read(tmp_path: Path) -> None:
    write_tum(tmp_path / "tum.txt", way())
    write_trajectory_csv(tmp_path / "own.csv", way())
    table = ["Time, qw, qx, qy, qz, x, y, z, note", "1700000000.123456789, 1, 0, 0, 0, 1, 2, 3, a"]
    table += ["1700000001, 1, 0, 0, 0, 4, 5, 6, b", ""]
    (tmp_path / "theirs.csv").write_text("\n".join(table))
    for path in tmp_path.iterdir():
        assert same(read_poses(path)), path
        assert _told_sigmas(read_poses(path), 0.1, 0.2) == (0.1, 0.2)


def test_what_a_file_says_of_its_sureness_counts(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("stamp_ns,x,y,z,qx,qy,qz,qw,sigma_m,sigma_deg\n1,0,0,0,0,0,0,1,0.5,10\n2,0,0,0,0,0,0,1,0.5,10\n")
    turned = read_poses(path).turned(np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]))
    assert _told_sigmas(turned, 0.1, 0.1) == pytest.approx((0.5, np.radians(10)))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("stamp,x,y,z,qx,qy,qw\n1,0,0,0,0,0,1\n", "got none called qz"),
        ("x,y,z,qx,qy,qz,qw\n0,0,0,0,0,0,1\n", "got none called stamp"),
        ("stamp,x,y,z,qx,qy,qz,qw\n1,0,0,zero,0,0,0,1\n", ":2: expected numbers"),
        ("stamp,x,y,z,qx,qy,qz,qw\n1,0,0\n", ":2: expected numbers"),
        ("stamp,x,y,z,qx,qy,qz,qw\n1,nan,0,0,0,0,0,1\n", ":2: expected a finite pose"),
        ("stamp,x,y,z,qx,qy,qz,qw\n1,0,0,0,0,0,0,0\n", ":2: expected a finite pose"),
        ("stamp,x,y,z,qx,qy,qz,qw\n2,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,1\n", "increasing"),
        ("stamp,x,y,z,qx,qy,qz,qw\n1.7e12,0,0,0,0,0,0,1\n", "are they in ms or us?"),
        ("stamp,x,y,z,qx,qy,qz,qw\ninf,0,0,0,0,0,0,1\n", ":2: expected numbers"),
        ("stamp,x,y,z,qx,qy,qz,qw,sigma_m\n1,0,0,0,0,0,0,1,-1\n", "over 0"),
        ("stamp,x,y,z,qx,qy,qz,qw\n", "at least one pose"),
        ("", "at least one pose"),
    ],
)
def test_a_bad_file_is_one_line(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(TrajectoryError) as refused:
        read_poses(path)
    assert words in str(refused.value)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_seconds_with_an_exponent_are_exact(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("stamp,x,y,z,qx,qy,qz,qw\n1.7e+09,0,0,0,0,0,0,1\n1700000000.123456789,0,0,0,0,0,0,1\n")
    assert read_poses(path).stamps_ns.tolist() == [1_700_000_000 * 10**9, 1_700_000_000_123_456_789]
