"""Raw photographs made by hand: a Bayer mosaic with the tags that a DNG needs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import tifffile
from numpy.typing import NDArray

_XYZ_TO_SRGB = (3.2406, -1.5372, -0.4986, -0.9689, 1.8758, 0.0415, 0.0557, -0.2040, 1.0570)


def write_dng(path: Path, linear: NDArray[np.float64], orientation: int = 1) -> Path:
    """A DNG of linear RGB in [0, 1], (H, W, 3): RGGB, 16 bits, a camera that sees sRGB's colours."""
    scaled = np.round(np.clip(linear, 0, 1) * 65535).astype(np.uint16)
    mosaic = scaled[..., 1].copy()
    mosaic[0::2, 0::2], mosaic[1::2, 1::2] = scaled[0::2, 0::2, 0], scaled[1::2, 1::2, 2]
    tags = [
        (33421, "H", 2, (2, 2), True), (33422, "B", 4, bytes([0, 1, 1, 2]), True),  # CFA: which, how it repeats
        (50706, "B", 4, bytes([1, 4, 0, 0]), True), (50707, "B", 4, bytes([1, 1, 0, 0]), True),  # version
        (50708, "s", 0, "Test camera", True), (50778, "H", 1, 21, True),  # daylight
        (50721, "2i", 9, [x for n in _XYZ_TO_SRGB for x in (round(n * 1e4), 10000)], True),  # colour matrix
        (50728, "2I", 3, [1, 1] * 3, True),  # neutral
        (50714, "H", 1, 0, True), (50717, "H", 1, 65535, True),  # black, white
        (274, "H", 1, orientation, True),
    ]  # fmt: skip
    tifffile.imwrite(path, mosaic, photometric=32803, extratags=tags, metadata=None)
    return path
