"""What a vehicle measures beside its pictures, with noise: IMU, pressure, DVL, GNSS (an acoustic position fix)."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.bags.messages import MAKE
from uw_recon_ros.messages.headers import header
from uw_recon_ros.simulate.rig import LEFT_FRAME
from uw_recon_ros.simulate.tracks import Course
from uw_recon_ros.types import Matrix

GRAVITY = 9.80665  # m/s2
WATER_KG_M3, SURFACE_PA = 1025.0, 101_325.0
LATITUDE, LONGITUDE, EARTH_M = 43.0, 5.0, 6_378_137.0  # the world's origin; a sphere will do for metres
IMU_HZ, PRESSURE_HZ, DVL_HZ, GNSS_HZ = 50.0, 10.0, 5.0, 1.0
#: Standard deviations: rad, rad/s, m/s2, Pa, m/s, m.
ATTITUDE, GYRO, ACCELERATION, PRESSURE, VELOCITY, FIX = 0.005, 0.002, 0.05, 100.0, 0.01, 0.5
HEADING_DRIFT = 2e-4  # rad/s
_DT = 0.005  # s, of differences


def sensor_messages(course: Course, seconds: float, first_ns: int) -> Iterator[tuple[str, Any]]:
    """Topics and messages of all sensors in the order of time, from the first frame to `seconds` later."""
    makers = (("/imu/data", IMU_HZ, _imu), ("/pressure", PRESSURE_HZ, _pressure), ("/dvl/twist", DVL_HZ, _dvl),
              ("/gnss/fix", GNSS_HZ, _gnss))  # fmt: skip
    moments = [(k / rate, which) for which, (_, rate, _) in enumerate(makers) for k in range(int(seconds * rate) + 1)]
    rng = np.random.default_rng([course.params.seed, 9])
    for at, which in sorted(moments):
        topic, _, make = makers[which]
        head = header(MAKE, first_ns + round(at * 1e9), "gnss" if make is _gnss else LEFT_FRAME)
        yield topic, make(course, at, head, rng)


def _vector(values: Matrix) -> Any:
    x, y, z = (float(v) for v in values)
    return MAKE("geometry_msgs/msg/Vector3", x=x, y=y, z=z)


def _diagonal(*sigmas: float) -> Any:
    return MAKE.doubles(np.diag(np.square(sigmas)))


def velocity(course: Course, at: float) -> Matrix:
    """Of the camera in the world, m/s."""
    before, after = course.pose(max(at - _DT, 0.0)), course.pose(at + _DT)
    return (after.position - before.position) / (at + _DT - max(at - _DT, 0.0))


def turning(course: Course, at: float) -> Matrix:
    """Angular velocity in the camera's frame, rad/s."""
    before, after = course.pose(at), course.pose(at + _DT)
    turned: Matrix = Rotation.from_matrix(before.rotation.T @ after.rotation).as_rotvec()
    return turned / _DT


def _imu(course: Course, at: float, head: Any, rng: np.random.Generator) -> Any:
    pose = course.pose(at)
    drifted = Rotation.from_rotvec([0.0, 0.0, HEADING_DRIFT * at]).as_matrix() @ pose.rotation
    x, y, z, w = (Rotation.from_matrix(drifted) * Rotation.from_rotvec(ATTITUDE * rng.standard_normal(3))).as_quat()
    acceleration = (velocity(course, at + 0.02) - velocity(course, at)) / 0.02
    felt = pose.rotation.T @ (acceleration + np.array([0.0, 0.0, GRAVITY]))
    return MAKE(
        "sensor_msgs/msg/Imu", header=head,
        orientation=MAKE("geometry_msgs/msg/Quaternion", x=float(x), y=float(y), z=float(z), w=float(w)),
        orientation_covariance=_diagonal(*[ATTITUDE] * 3),
        angular_velocity=_vector(turning(course, at) + GYRO * rng.standard_normal(3)),
        angular_velocity_covariance=_diagonal(*[GYRO] * 3),
        linear_acceleration=_vector(felt + ACCELERATION * rng.standard_normal(3)),
        linear_acceleration_covariance=_diagonal(*[ACCELERATION] * 3),
    )  # fmt: skip


def _pressure(course: Course, at: float, head: Any, rng: np.random.Generator) -> Any:
    """Absolute; the world's z = 0 lies `water_depth_m` below the surface."""
    depth = course.params.water_depth_m - float(course.pose(at).position[2])
    measured = SURFACE_PA + WATER_KG_M3 * GRAVITY * depth + PRESSURE * rng.standard_normal()
    return MAKE("sensor_msgs/msg/FluidPressure", header=head, fluid_pressure=float(measured), variance=PRESSURE**2)


def _dvl(course: Course, at: float, head: Any, rng: np.random.Generator) -> Any:
    seen = course.pose(at).rotation.T @ velocity(course, at) + VELOCITY * rng.standard_normal(3)
    covariance = np.zeros((6, 6))
    covariance[range(3), range(3)] = VELOCITY**2
    covariance[range(3, 6), range(3, 6)] = 1e6  # says nothing of rotation
    twist = MAKE("geometry_msgs/msg/Twist", linear=_vector(seen))
    inner = MAKE("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=MAKE.doubles(covariance))
    return MAKE("geometry_msgs/msg/TwistWithCovarianceStamped", header=head, twist=inner)


def _gnss(course: Course, at: float, head: Any, rng: np.random.Generator) -> Any:
    """World x east, y north."""
    x, y, z = course.pose(at).position + FIX * np.array([1.0, 1.0, 2.0]) * rng.standard_normal(3)
    degree = math.degrees(1.0 / EARTH_M)
    return MAKE(
        "sensor_msgs/msg/NavSatFix", header=head, latitude=LATITUDE + degree * float(y),
        longitude=LONGITUDE + degree * float(x) / math.cos(math.radians(LATITUDE)),
        altitude=float(z) - course.params.water_depth_m, position_covariance=_diagonal(FIX, FIX, 2 * FIX),
        position_covariance_type=2,
    )  # fmt: skip
