"""Message classes by the names that bags hold."""

from __future__ import annotations

import importlib
import re
from typing import Any

_NAME = re.compile(r"([a-z][a-z0-9_]*)/msg/([A-Z][A-Za-z0-9]*)")


def message_class(name: str) -> Any | None:
    """Find the class of e.g. ``sensor_msgs/msg/Image``; None where its package is not installed."""
    match = _NAME.fullmatch(name)
    if match is None:
        return None
    try:
        return getattr(importlib.import_module(f"{match[1]}.msg"), match[2], None)
    except ImportError:
        return None
