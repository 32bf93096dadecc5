"""Images that hold both cameras' views: side by side, one above the other, row by row, or an MPO's two photographs."""

from __future__ import annotations

import io
from typing import Literal, get_args

import cv2
import numpy as np
from PIL import Image, UnidentifiedImageError

from uw_recon_ros.errors import ImageError
from uw_recon_ros.findings import Code
from uw_recon_ros.images import to_gray
from uw_recon_ros.types import RawImage

#: How both views lie in one image; ``separate``: each has its own.
Layout = Literal["separate", "side-by-side", "top-bottom", "row-interleaved", "mpo"]
LAYOUTS: tuple[str, ...] = get_args(Layout)
_SIDE = 640  # px, to which the longer side is reduced to look for the layout
_MATCHES = 40  # that agree, which no two halves of one view have
_ROWS = 0.03  # of the height: how far matches of two views may lie off each other's row
_INTERLEAVED = 1.5  # difference of neighbouring rows over that of rows two apart


def cut(image: RawImage, layout: str, side: int) -> RawImage:
    """One camera's view.

    Parameters
    ----------
    image : (H, W) or (H, W, 3)
    layout : str
        One of `LAYOUTS`; images of ``separate`` and ``mpo`` come whole.
    side : {0, 1}
        Left (upper, even rows), right (lower, odd rows).
    """
    height, width = image.shape[:2]
    if layout == "side-by-side":
        return np.ascontiguousarray(image[:, side * (width // 2) : (side + 1) * (width // 2)])
    if layout == "top-bottom":
        return np.ascontiguousarray(image[side * (height // 2) : (side + 1) * (height // 2)])
    if layout == "row-interleaved":
        return _full_height(np.ascontiguousarray(image[side::2][: height // 2]), side)
    return image


def _full_height(rows: RawImage, side: int) -> RawImage:
    """A view of every second row, at full height again: row y of the odd ones was recorded at 2 y + 1."""
    height, width = 2 * rows.shape[0], rows.shape[1]
    at = np.array([[1.0, 0, 0], [0, 2.0, float(side)]])
    filled: RawImage = cv2.warpAffine(rows, at, (width, height), borderMode=cv2.BORDER_REPLICATE)
    return filled


def find_layout(image: RawImage) -> str:
    """What an image is, by its content: rows that alternate, or halves that show one scene.

    Returns
    -------
    str
        One of `LAYOUTS`; ``separate`` where nothing speaks for two views.
    """
    gray = to_gray(image)
    if gray.dtype != np.uint8:
        gray = (gray >> max(0, int(gray.max()).bit_length() - 8)).astype(np.uint8)
    if _alternates(gray):
        return "row-interleaved"
    small = cv2.resize(gray, None, fx=(f := min(1.0, _SIDE / max(gray.shape))), fy=f, interpolation=cv2.INTER_AREA)
    counts = {layout: _agreeing(small, layout) for layout in ("side-by-side", "top-bottom")}
    best = max(counts, key=lambda layout: counts[layout])
    return best if counts[best] >= _MATCHES and counts[best] > 2 * min(counts.values()) else "separate"


def _alternates(gray: RawImage) -> bool:
    values = gray[: 2 * (len(gray) // 2)].astype(np.float32)
    near, far = np.abs(values[1:] - values[:-1]).mean(), np.abs(values[2:] - values[:-2]).mean()
    return bool(far > 0 and near / far > _INTERLEAVED)


def _agreeing(gray: RawImage, layout: str) -> int:
    """How many key points of one half have their match on the same row (or column) of the other."""
    halves = [cut(gray, layout, side) for side in (0, 1)]
    finder = cv2.ORB.create(nfeatures=600, edgeThreshold=8, patchSize=21, fastThreshold=7)
    found = [finder.detectAndCompute(half, None) for half in halves]
    if any(descriptors is None or len(descriptors) < 2 for _, descriptors in found):
        return 0
    matches = cv2.BFMatcher(cv2.NORM_HAMMING, crossCheck=True).match(found[0][1], found[1][1])
    moved = np.array(
        [np.subtract(found[0][0][m.queryIdx].pt, found[1][0][m.trainIdx].pt) for m in matches if m.distance < 50]
    )
    if not len(moved):
        return 0
    across = np.abs(moved - np.median(moved, axis=0)) < _ROWS * max(halves[0].shape)
    return int(max(across[:, 0].sum(), across[:, 1].sum()) - len(moved) * 4 * _ROWS)


def mpo_parts(content: bytes) -> list[bytes]:
    """The photographs within an MPO file (CIPA DC-007), each a JPEG; [] where there are not two.

    Raises
    ------
    ImageError
        It says it has two, and has not.
    """
    try:
        with Image.open(io.BytesIO(content)) as opened:
            entries = getattr(opened, "mpinfo", {}).get(0xB002, [])
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError, Image.DecompressionBombError):
        return []
    views = [entry for entry in entries if entry.get("Size")]
    if len(views) < 2:
        return []
    base = content.find(b"MPF\0") + 4  # from where offsets count
    starts = [entry["DataOffset"] + (base if entry["DataOffset"] else 0) for entry in views[:2]]
    parts = [content[start : start + entry["Size"]] for start, entry in zip(starts, views, strict=False)]
    if not all(part.startswith(b"\xff\xd8") for part in parts):
        raise ImageError("MPO: expected two photographs, got one: the file is cut short", Code.IMAGE)
    return parts
