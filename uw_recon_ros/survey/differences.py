"""Where two settings differ, in words."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from typing import Any


def compare(before: Any, now: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Where two nested mappings differ: dotted name, value before, value now (None: not there)."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        keys = dict.fromkeys([*before, *now])
        parts = [compare(before.get(key), now.get(key), f"{name}.{key}" if name else str(key)) for key in keys]
        return [difference for part in parts for difference in part]
    return [] if before == now else [(name, before, now)]


def describe(differences: Iterable[tuple[str, Any, Any]], most: int = 4) -> str:
    """The differences in words."""
    listed = list(differences)
    texts = [f"{name}: {_shorten(before)} then, {_shorten(now)} now" for name, before, now in listed[:most]]
    if len(listed) > most:
        texts.append(f"and {len(listed) - most} more")
    return "; ".join(texts)


def _shorten(value: Any) -> str:
    if value is None:
        return "absent"
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
