"""Obstacles and ranges -> messages, as mavros turns them into OBSTACLE_DISTANCE and DISTANCE_SENSOR."""

from __future__ import annotations

from typing import Any

import numpy as np

from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.messages.headers import header
from uw_recon_ros.types import AxisRange, Sectors

SCAN, RANGE = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/Range"
_LIGHT = 1  # sensor_msgs/Range.INFRARED: measured by light, not by sound


def scan_message(make: MessageFactory, sectors: Sectors) -> Any:
    """Make a ``LaserScan``; NaN where nothing trusted was seen (REP 117: not a measurement, and not free)."""
    return make(
        SCAN, header=header(make, sectors.stamp_ns, sectors.frame_id),
        angle_min=sectors.first_rad, angle_max=sectors.first_rad + sectors.step_rad * (len(sectors.ranges) - 1),
        angle_increment=sectors.step_rad, range_min=sectors.min_range, range_max=sectors.max_range,
        ranges=make.floats(sectors.ranges.astype(np.float32)),
    )  # fmt: skip


def range_message(make: MessageFactory, seen: AxisRange) -> Any:
    """Make a ``Range``; its variance where the message has one (from ROS 2 Iron on)."""
    message = make(
        RANGE, header=header(make, seen.stamp_ns, seen.frame_id), radiation_type=_LIGHT, field_of_view=seen.cone_rad,
        min_range=seen.min_range, max_range=seen.max_range, range=seen.distance,
    )  # fmt: skip
    if hasattr(message, "variance"):
        message.variance = seen.sigma**2
    return message
