"""Numbers out of parsed files, with a sentence where one is missing."""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from uw_recon_ros.calibration.model import short
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import Matrix

_COMMA = re.compile(r"^'?-?\d+,\d+'?$")
Size = tuple[int, int]
#: Metres of one unit of length.
UNITS = {"m": 1.0, "meters": 1.0, "metres": 1.0, "meter": 1.0, "cm": 0.01, "centimeters": 0.01, "mm": 0.001,
         "millimeters": 0.001, "millimetres": 0.001, "in": 0.0254, "inches": 0.0254}  # fmt: skip


def numbers(values: dict[str, Any], name: str, count: int | None = None) -> Matrix:
    """(N,) numbers under a name; a matrix of OpenCV's is opened.

    Raises
    ------
    CalibrationError
        There are none, or another count.
    """
    if name not in values:
        raise CalibrationError(f"expected {name}, got {list_of(values)}", Code.CALIBRATION_NUMBERS)
    return as_numbers(values[name], name, count)


def as_numbers(value: Any, name: str, count: int | None = None) -> Matrix:
    """(N,) numbers of a value, its rows one after the other."""
    value = value["data"] if isinstance(value, dict) and "data" in value else value
    try:
        found = np.asarray(value, np.float64).ravel()
    except (TypeError, ValueError, OverflowError) as error:
        comma = ": a decimal comma? write points" if _COMMA.search(str(value)) else ""
        raise CalibrationError(
            f"{name}: expected numbers, got {short(value)}{comma}", Code.CALIBRATION_NUMBERS
        ) from error
    if (count is not None and found.size != count) or not np.isfinite(found).all():
        raise CalibrationError(
            f"{name}: expected {count or 'finite'} numbers, got {found.size}: {short(found.tolist())}",
            Code.CALIBRATION_NUMBERS,
        )
    return found


def text_of(values: dict[str, Any], name: str, default: str = "") -> str:
    """A text under a name; `default` where there is none."""
    value = values.get(name, default)
    if not isinstance(value, str):
        raise CalibrationError(f"{name}: expected text, got {short(str(value))}")
    return value


def list_of(values: dict[str, Any]) -> str:
    """The names that are there, for a sentence."""
    names = [name for name in values if not name.startswith("__")]
    return short(", ".join(names[:12])[:200]) if names else "nothing"


def intrinsics(fx: float, fy: float, cx: float, cy: float) -> Matrix:
    """(3, 3) of four numbers."""
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def needed(size: Size | None) -> Size:
    """The image size, where the file does not tell it.

    Raises
    ------
    CalibrationError
        Nobody told it.
    """
    if size is None:
        raise CalibrationError(
            "expected the size of the images, which this form does not hold: uw_recon convert-calibration --size WxH",
            Code.CALIBRATION_SIZE_UNKNOWN,
        )
    return size


def metres_of(unit: str | None, default: str) -> float:
    """Metres of one unit: as asked for, else as the form has it."""
    name = (unit or default).lower()
    if name not in UNITS:
        raise CalibrationError(f"unit: expected one of {', '.join(UNITS)}, got {short(name)}")
    return UNITS[name]


def squeezed(name: str) -> str:
    """A key without case and separators."""
    return re.sub(r"[^a-z0-9]", "", name.lower())
