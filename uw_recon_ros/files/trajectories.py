"""Trajectories as files: the TUM format, and CSV with all that is known of each pose."""

from __future__ import annotations

import csv
import io
from dataclasses import replace
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.errors import TrajectoryError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.trajectory import PoseStatus, Trajectory, as_quaternions, trajectory_of
from uw_recon_ros.types import Matrix

_TIMES, _POSE = ("stamp_ns", "stamp", "time", "timestamp"), ("x", "y", "z", "qx", "qy", "qz", "qw")
_LATEST_NS = 2**31 * 10**9  # ROS holds no later time
_CSV_HEAD = "stamp_ns,x,y,z,qx,qy,qz,qw,status,segment"
_UPPER = np.triu_indices(6)


def _rows(trajectory: Trajectory) -> Matrix:
    """(N, 7): world position (the origin added) and quaternion."""
    return np.hstack([trajectory.positions + trajectory.origin, as_quaternions(trajectory.poses)])


def tum_stamp(stamp_ns: int) -> str:
    """Seconds with nine decimals, exact."""
    return f"{stamp_ns // 10**9}.{stamp_ns % 10**9:09d}"


def write_tum(path: str | Path, trajectory: Trajectory) -> None:
    """Write ``stamp x y z qx qy qz qw`` lines (s, m), world coordinates; whole file or none.

    The format of the TUM RGB-D benchmark (Sturm et al. 2012), which evo and rpg_trajectory_evaluation read.
    """
    lines = ["# stamp x y z qx qy qz qw"]
    for stamp, row in zip(trajectory.stamps_ns.tolist(), _rows(trajectory).tolist(), strict=True):
        lines.append(" ".join([tum_stamp(stamp), *(f"{x:.9f}" for x in row)]))
    write_bytes(path, ("\n".join(lines) + "\n").encode())


def _stamp(text: str) -> int:
    """Exact ns of seconds in decimal."""
    try:
        return int(Decimal(text) * 10**9)
    except (InvalidOperation, OverflowError) as error:  # the latter: infinite
        raise ValueError(f"expected seconds, got {text!r}") from error


def _text(path: str | Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise TrajectoryError(f"{path}: expected a trajectory, got: {error}") from error


def read_tum(path: str | Path, *, origin: Matrix | None = None) -> Trajectory:
    """Read a file in the TUM format.

    Parameters
    ----------
    path : path
    origin : (3,) float64, optional
        Subtracted from the positions; None = zero.

    Raises
    ------
    TrajectoryError
        Not readable, no eight numbers a line, or stamps that do not increase.
    """
    stamps, rows = [], []
    for number, line in enumerate(_text(path).splitlines(), 1):
        words = line.replace(",", " ").split()
        if not words or words[0].startswith("#"):
            continue
        try:
            stamp, row = _stamp(words[0]), [float(word) for word in words[1:]]
        except ValueError:
            row = []
        if len(row) != 7 or not np.isfinite(row).all() or not np.any(row[3:]):
            raise TrajectoryError(f"{path}:{number}: expected stamp x y z qx qy qz qw, got {line.strip()[:80]!r}")
        stamps.append(stamp)
        rows.append(row)
    return _made(path, stamps, rows, origin)


def _made(path: str | Path, stamps: list[int], rows: list[list[float]], origin: Matrix | None) -> Trajectory:
    if not stamps:
        raise TrajectoryError(f"{path}: expected at least one pose, got none")
    wild = next((stamp for stamp in stamps if not abs(stamp) < _LATEST_NS), None)
    if wild is not None:
        raise TrajectoryError(
            f"{path}: expected stamps in seconds (or in ns in a column stamp_ns), got {wild / 1e9:g} s: "
            "are they in ms or us?"
        )
    table, start = np.array(rows), np.zeros(3) if origin is None else np.asarray(origin, np.float64)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(table[:, 3:]).as_matrix()
    poses[:, :3, 3] = table[:, :3] - start
    try:
        return trajectory_of(stamps, poses, origin=start)
    except ValueError as error:
        raise TrajectoryError(f"{path}: {error}") from error


def write_trajectory_csv(path: str | Path, trajectory: Trajectory) -> None:
    """Write a line a pose: stamp, world position, quaternion, status, segment, upper triangle of the covariance."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*_CSV_HEAD.split(","), *(f"c{i}{j}" for i, j in zip(*_UPPER, strict=True))])
    for k, row in enumerate(_rows(trajectory).tolist()):
        table.writerow([
            int(trajectory.stamps_ns[k]), *(f"{x:.9f}" for x in row), str(PoseStatus(int(trajectory.status[k]))),
            int(trajectory.segment[k]), *(f"{x:.6g}" for x in trajectory.covariances[k][_UPPER]),
        ])  # fmt: skip
    write_bytes(path, text.getvalue().encode())


def read_trajectory_csv(path: str | Path, *, origin: Matrix | None = None) -> Trajectory:
    """Read what `write_trajectory_csv` wrote.

    Raises
    ------
    TrajectoryError
    """
    lines = list(csv.reader(_text(path).splitlines()))
    if not lines or ",".join(lines[0][:10]) != _CSV_HEAD:
        raise TrajectoryError(
            f"{path}: expected columns {_CSV_HEAD},..., got {','.join(lines[0])[:80] if lines else ''!r}"
        )
    try:
        stamps = [int(line[0]) for line in lines[1:]]
        found = _made(path, stamps, [[float(x) for x in line[1:8]] for line in lines[1:]], origin)
        status = np.array([PoseStatus[line[8].upper()] for line in lines[1:]], np.uint8)
        segment = np.array([int(line[9]) for line in lines[1:]], np.int64)
        upper = np.array([[float(x) for x in line[10:31]] for line in lines[1:]]).reshape(len(stamps), 21)
    except (ValueError, KeyError, IndexError) as error:
        raise TrajectoryError(f"{path}: expected what write_trajectory_csv writes, got: {error}") from error
    covariances = np.empty((len(stamps), 6, 6))
    covariances[:, _UPPER[0], _UPPER[1]] = upper
    covariances[:, _UPPER[1], _UPPER[0]] = upper
    return replace(found, status=status, segment=segment, covariances=covariances)


def read_poses(path: str | Path, *, origin: Matrix | None = None) -> Trajectory:
    """Read poses from outside: TUM, what `write_trajectory_csv` wrote, or a table whose first line names its columns.

    Columns, in any order, others passed over: ``stamp_ns``, or ``stamp``, ``time``, ``timestamp`` (s); ``x``, ``y``,
    ``z`` (m); ``qx``, ``qy``, ``qz``, ``qw``; where they are there, ``sigma_m`` and ``sigma_deg``, how sure each is.

    Returns
    -------
    Trajectory
        Covariances NaN where the file does not tell them.

    Raises
    ------
    TrajectoryError
    """
    lines = _text(path).splitlines()
    names = [name.strip().lower() for name in lines[0].split(",")] if lines else []
    if not {"x", "qw"} <= set(names):
        return read_tum(path, origin=origin)
    if ",".join(names[:10]) == _CSV_HEAD:
        return read_trajectory_csv(path, origin=origin)
    time = next((name for name in _TIMES if name in names), None)
    missing = [name for name in _POSE if name not in names] + ([] if time else ["stamp"])
    if missing or time is None:
        raise TrajectoryError(f"{path}: expected columns stamp, {', '.join(_POSE)}, got none called {missing[0]}")
    stamps, rows, sigmas = [], [], []
    for number, line in enumerate(csv.DictReader(lines, fieldnames=names), 1):
        if number == 1:
            continue
        try:
            stamps.append(int(line[time]) if time == "stamp_ns" else _stamp(line[time].strip()))
            rows.append([float(line[name]) for name in _POSE])
            sigmas.append([float(line[name]) if name in names else float("nan") for name in ("sigma_m", "sigma_deg")])
        except (ValueError, TypeError, AttributeError) as error:
            raise TrajectoryError(f"{path}:{number}: expected numbers, got {lines[number - 1][:80]!r}") from error
        if not np.isfinite(rows[-1]).all() or not np.any(rows[-1][3:]):
            raise TrajectoryError(f"{path}:{number}: expected a finite pose, got {lines[number - 1][:80]!r}")
        if any(sigma <= 0 for sigma in sigmas[-1]):
            raise TrajectoryError(
                f"{path}:{number}: expected sigma_m and sigma_deg over 0, got {lines[number - 1][:80]!r}"
            )
    found, spread = _made(path, stamps, rows, origin), np.array(sigmas) * (1.0, np.pi / 180)
    return replace(found, covariances=np.repeat(spread**2, 3, axis=1)[:, :, None] * np.eye(6))
