"""What makes messages: the one thing in which rclpy's and rosbags' classes differ."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import NDArray


class MessageFactory(Protocol):
    """Makes messages of one family of classes."""

    def __call__(self, type_name: str, **fields: Any) -> Any:
        """Make a message of e.g. ``sensor_msgs/msg/Image``; fields that are not given are zero or empty."""

    def octets(self, array: NDArray[Any]) -> Any:
        """Bytes of an array, rows one after the other, as a field ``uint8[]`` takes them."""

    def doubles(self, array: NDArray[Any]) -> Any:
        """Numbers of an array as a field ``float64[]`` takes them."""

    def floats(self, array: NDArray[Any]) -> Any:
        """Numbers of an array as a field ``float32[]`` takes them."""
