"""Views of different sharpness made alike before planes are compared: one lens out of focus, more water before it.

The blur of the less sharp view cannot be undone, but the other can be blurred as much. How sharp a view is, is told by
how much of its variation along the rows is fine: a ratio of two bands of frequencies, which brightness and contrast
leave alone, and noise in both views only brings nearer to 1.
"""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np

from uw_recon_ros.match.planes.gray import CONTRAST, MOST, Gray, local_contrast
from uw_recon_ros.types import FloatImage

#: Ratio of sharpness from which on views are made alike: 0.94 to 1.07 in pairs as sharp as each other, in air, water,
#: and of other exposure; 1.2 to 1.3 where one is blurred by 0.7 px, 1.35 to 1.6 by 1 px.
UNEVEN = 1.12
BANDS = (0.7, 1.4, 2.8)  #: px
BLURS = np.arange(0.4, 2.05, 0.1)  #: tried, px
EVERY = 4  #: row looked at
_REACH = 3.0  # of a blur, in standard deviations


def equally_sharp(left: Gray, right: Gray) -> tuple[Gray, Gray]:
    """Both views, the sharper one blurred to be like the other; the very same where they are alike.

    Parameters
    ----------
    left, right : (H, W) int16
        Of `gray.gray_pair`.
    """
    rows = [np.asarray(view[::EVERY], np.float32) for view in (left, right)]
    first, second = (sharpness(row) for row in rows)
    if max(first, second) < UNEVEN * min(first, second):
        return left, right
    if first > second:
        return _blurred(left, _blur_between(rows[0], second)), right
    return left, _blurred(right, _blur_between(rows[1], first))


def sharpness(rows: FloatImage) -> float:
    """Fine over coarse variation along rows (N, W)."""
    levels = [_along(rows, sigma) for sigma in BANDS]
    fine, coarse = (float(np.square(a - b).mean()) for a, b in pairwise(levels))
    return float(np.sqrt(fine / max(coarse, 1e-6)))


def _along(rows: FloatImage, sigma: float) -> FloatImage:
    size = 2 * int(np.ceil(_REACH * sigma)) + 1
    return np.asarray(cv2.GaussianBlur(rows, (size, 1), sigma), np.float32)


def _blur_between(rows: FloatImage, wanted: float) -> float:
    """The least blur after which rows are no sharper than wanted, px."""
    return next((float(s) for s in BLURS if sharpness(_along(rows, float(s))) <= wanted), float(BLURS[-1]))


def _blurred(gray: Gray, sigma: float) -> Gray:
    """Blurred, and of the contrast that it had."""
    soft = np.asarray(cv2.GaussianBlur(gray.astype(np.float32), (0, 0), sigma), np.float32)
    gain = CONTRAST / max(local_contrast(soft), 1.0)
    return np.asarray(np.round(soft * gain).clip(-MOST, MOST), np.int16)
