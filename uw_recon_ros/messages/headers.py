"""Stamps and names of frames <-> headers."""

from __future__ import annotations

from typing import Any

from uw_recon_ros.errors import MessageError
from uw_recon_ros.messages.factory import MessageFactory

BILLION = 1_000_000_000
_LONGEST_FRAME_ID = 255


def stamp_ns(message: Any) -> int:
    """Stamp of a message, ns: its header's, or its own where it has none."""
    stamp = message.header.stamp if hasattr(message, "header") else message.timestamp
    return int(stamp.sec) * BILLION + int(stamp.nanosec)


def received_stamp_ns(message: Any) -> int:
    """Header stamp of a message that came from elsewhere, ns.

    Raises
    ------
    MessageError
        The stamp is no time, or the frame's name no name: neither may travel on.
    """
    headed = hasattr(message, "header")
    stamp = message.header.stamp if headed else message.timestamp
    frame_id = message.header.frame_id if headed else message.frame_id
    if stamp.sec < 0 or stamp.nanosec >= BILLION:
        raise MessageError(
            f"stamp: expected sec >= 0 and nanosec < {BILLION}, got sec {stamp.sec}, nanosec {stamp.nanosec}"
        )
    if len(frame_id) > _LONGEST_FRAME_ID or not frame_id.isprintable():
        raise MessageError(
            f"frame_id: expected at most {_LONGEST_FRAME_ID} printable characters, got {len(frame_id)}: "
            f"{frame_id[:40]!a}"
        )
    return stamp_ns(message)


def time_message(make: MessageFactory, nanoseconds: int) -> Any:
    """Turn ns into a ``builtin_interfaces/Time``.

    Raises
    ------
    ValueError
        Beyond what a Time holds (32 bits of seconds).
    """
    seconds, rest = divmod(nanoseconds, BILLION)
    if not -(2**31) <= seconds < 2**31:
        raise ValueError(f"stamp: expected seconds within 32 bits, got {seconds}")
    return make("builtin_interfaces/msg/Time", sec=seconds, nanosec=rest)


def header(make: MessageFactory, nanoseconds: int, frame_id: str) -> Any:
    """Make a header, stamp in ns."""
    return make("std_msgs/msg/Header", stamp=time_message(make, nanoseconds), frame_id=frame_id)
