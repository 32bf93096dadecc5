"""What came on one topic, and who is on it, as the doctor wants it."""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from uw_recon_ros.doctor.observation import Arrivals, CameraNumbers, Endpoint
from uw_recon_ros.messages.headers import stamp_ns

_MOST_STAMPS = 2000
_FLOAT32 = 7  # sensor_msgs/PointField.FLOAT32


class Recorder:
    """Counts the messages of a topic and keeps the last one."""

    def __init__(self) -> None:
        self.last: Any = None
        self._count, self._first_s, self._last_s, self._behind_ns = 0, 0.0, 0.0, 0
        self._stamps: list[int] = []

    def __call__(self, message: Any) -> None:
        """Take a message."""
        self._last_s = time.monotonic()
        self._first_s = self._first_s or self._last_s
        self._count, self.last = self._count + 1, message
        stamp = stamp_ns(message)
        self._behind_ns = time.time_ns() - stamp
        if len(self._stamps) < _MOST_STAMPS:
            self._stamps.append(stamp)

    @property
    def count(self) -> int:
        """Messages so far."""
        return self._count

    def arrivals(self, seconds: float) -> Arrivals:
        """Describe what came in `seconds` of listening."""
        if self.last is None:
            return Arrivals()
        span = self._last_s - self._first_s
        rate = (self._count - 1) / span if self._count > 1 and span > 0 else self._count / max(seconds, 1e-3)
        inner = getattr(self.last, "image", self.last)
        return Arrivals(
            count=self._count, rate_hz=rate, stamps_ns=tuple(self._stamps), behind_ns=self._behind_ns,
            width=int(getattr(inner, "width", 0)), height=int(getattr(inner, "height", 0)),
            encoding=str(getattr(inner, "encoding", getattr(inner, "format", "")))[:40],
            size_bytes=len(getattr(inner, "data", b"")), frame_id=getattr(self.last, "header", self.last).frame_id,
            valid_share=_valid_share(self.last),
        )  # fmt: skip


def _valid_share(message: Any) -> float | None:
    """Share of pixels with a value, of a disparity or an organised cloud; None for anything else."""
    if hasattr(message, "min_disparity"):
        values = _floats(message.image.data, 4, 0)
        return float((np.isfinite(values) & (values >= message.min_disparity)).mean()) if values.size else None
    fields = {field.name: field for field in getattr(message, "fields", ())}
    x = fields.get("z")
    if x is None or x.datatype != _FLOAT32 or message.height <= 1:
        return None
    values = _floats(message.data, message.point_step, x.offset)
    return float(np.isfinite(values).mean()) if values.size else None


def _floats(data: Any, step: int, offset: int) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Every `step` bytes a float32; nothing where the numbers do not fit."""
    raw = np.frombuffer(data, np.uint8)
    if step < offset + 4 or offset < 0 or raw.size % step:
        return np.empty(0, np.float32)
    column = np.ascontiguousarray(raw.reshape(-1, step)[:, offset : offset + 4])
    return column.view(np.float32).ravel()


def camera_numbers(info: Any) -> CameraNumbers:
    """Take the numbers out of a CameraInfo."""
    return CameraNumbers(
        info.width, info.height, tuple(map(float, info.k)), tuple(map(float, info.d)), tuple(map(float, info.r)),
        tuple(map(float, info.p)), info.distortion_model, (info.binning_x, info.binning_y),
        (info.roi.x_offset, info.roi.y_offset, info.roi.width, info.roi.height),
    )  # fmt: skip


def endpoint(info: Any) -> Endpoint:
    """Describe one end of a topic, rclpy's TopicEndpointInfo."""
    kind = getattr(info, "topic_type_hash", None)
    known = kind is not None and getattr(kind, "version", 0) > 0
    return Endpoint(
        node=f"{info.node_namespace.rstrip('/')}/{info.node_name}",
        type=info.topic_type,
        type_hash=str(kind) if known else "",
        reliable=info.qos_profile.reliability.name != "BEST_EFFORT",
        latched=info.qos_profile.durability.name == "TRANSIENT_LOCAL",
    )
