"""Message classes by the names that bags hold, and messages made of them."""

from __future__ import annotations

import importlib
import importlib.util
import re
from array import array
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


@cache
def message_class(name: str) -> Any | None:
    """Find the class of e.g. ``sensor_msgs/msg/Image``; None where its package is not installed.

    A bag chooses the name: nothing is imported but packages that are made of ROS messages.
    """
    match = _NAME.fullmatch(name)
    if match is None or not _holds_messages(match[1]):
        return None
    try:
        return getattr(importlib.import_module(f"{match[1]}.msg"), match[2], None)
    except ImportError:
        return None


def _holds_messages(package: str) -> bool:
    """Whether a package has messages with generated type support; found out without importing it."""
    spec = importlib.util.find_spec(package)
    folders = [Path(folder) for folder in spec.submodule_search_locations or ()] if spec else []
    return any((folder / "msg" / "__init__.py").is_file() and any(folder.glob("*_s*.so")) for folder in folders)


class RosFactory:
    """Makes rclpy's messages; see `uw_recon_ros.messages.factory`."""

    def __call__(self, type_name: str, **fields: Any) -> Any:
        """Make a message; fields that are not given are zero or empty."""
        kind = message_class(type_name)
        assert kind is not None, f"{type_name}: expected an installed message package"
        return kind(**fields)

    def octets(self, contents: NDArray[Any]) -> Any:
        """Bytes of an array, rows one after the other.

        An ``array.array`` is taken as it is; a numpy array would be converted element by element, seconds for a cloud.
        """
        octets = array("B")
        if contents.size:
            octets.frombytes(memoryview(np.ascontiguousarray(contents).data).cast("B"))
        return octets

    def doubles(self, contents: NDArray[Any]) -> Any:
        """Numbers of an array."""
        return array("d", np.asarray(contents, np.float64).ravel().tolist())

    def floats(self, contents: NDArray[Any]) -> Any:
        """Numbers of an array."""
        return array("f", np.asarray(contents, np.float32).ravel().tolist())


#: The one there needs to be.
MAKE = RosFactory()
