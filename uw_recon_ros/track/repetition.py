"""Whether a picture repeats itself, as a tiled floor does: then a motion may be a period off, however well it fits."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.types import ByteImage

_WIDTH = 160  # px that a view is reduced to
_DETAIL = 4.0  # px of it: what is coarser is light, not the bottom
_ALIKE = 0.45  # correlation from which two places may be taken for each other
_BLANK = 0.5  # gray levels
_APART = 0.06  # of the width: nearer places overlap


def period_px(gray: ByteImage) -> float | None:
    """How far the nearest place is that looks like the middle of a view (H, W), px; None where there is none."""
    scale = min(1.0, _WIDTH / gray.shape[1])
    small = cv2.resize(gray, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA).astype(np.float32)
    small -= cv2.GaussianBlur(small, (0, 0), _DETAIL)
    if small.std() < _BLANK:
        return None
    height, width = small.shape
    top, left = height // 4, width // 4
    middle = small[top : height - top, left : width - left]
    alike = np.asarray(cv2.matchTemplate(small, np.ascontiguousarray(middle), cv2.TM_CCOEFF_NORMED))
    v, u = np.mgrid[: alike.shape[0], : alike.shape[1]]
    apart = np.hypot(u - left, v - top)
    alike[apart < _APART * width] = -1
    peaks = (alike >= _ALIKE) & (alike >= cv2.dilate(alike, np.ones((5, 5), np.uint8)))
    return float(apart[peaks].min() / scale) if peaks.any() else None
