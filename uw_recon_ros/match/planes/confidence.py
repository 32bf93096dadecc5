"""How likely a disparity is right, from what can be seen of the result alone.

Sigma tells how exact a right match is; a wrong one looks as exact. What betrays it are its surroundings: planes that
the start does not support, steps nearby, and neighbours without a match. How much each tells was learnt by logistic
regression on errors of more than `WRONG_PX` in air (``test/benchmark/match_trust.py --learn --waters air``), and
checked on pairs left out.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.types import FloatImage, Mask

WRONG_PX = 1.0
SUPPORT_PX = 1.5  #: the start supports what is this near to it
AROUND, BESIDE, STEP_WINDOW = 25, 7, 9  #: sides of windows, px
LARGEST_STEP = 8.0  #: px
DOUBTFUL = 0.96  #: where the confidence is less, no sigma is smaller than `DOUBTFUL_SIGMA` px
DOUBTFUL_SIGMA = 1.0


class Weights(NamedTuple):
    """Of the logarithm of the odds of being wrong.

    Parameters
    ----------
    constant : float
    sigma : float
        Times the natural logarithm of sigma, px.
    unsupported, here : float
        Times the share of the surroundings that the start does not support; and where it does not support the pixel.
    step : float
        Times the largest step nearby, as a part of `LARGEST_STEP`.
    hollow, sparse : float
        Times the share of pixels without a disparity, beside and around.
    """

    constant: float
    sigma: float
    unsupported: float
    here: float
    step: float
    hollow: float
    sparse: float


WEIGHTS = {
    "navigation": Weights(-4.21, 0.01, 0.0, 0.0, 3.2, 2.31, 2.35),
    "balanced": Weights(-4.55, 0.58, 4.26, 1.1, 2.78, 1.52, -0.35),
    "quality": Weights(-5.08, 0.54, 3.62, 1.4, 3.08, 0.55, 2.62),
}


def confidence_of(disparity: FloatImage, sigma: FloatImage, start: FloatImage, agreed: Mask, effort: str) -> FloatImage:
    """Probability that a disparity is less than `WRONG_PX` off.

    Parameters
    ----------
    disparity, sigma : (H, W) float32
        px; NaN = none.
    start : (H, W) float32
        Of the semi-global aggregation, px; `agreed` (H, W) bool says where both views agree about it.
    effort : {'navigation', 'balanced', 'quality'}
        That found the disparity.

    Returns
    -------
    (H, W) float32
        0 to 1; NaN where `disparity` is.
    """
    odds: NDArray[np.float32] = signs_of_error(disparity, sigma, start, agreed) @ np.array(
        WEIGHTS[effort][1:], np.float32
    )
    right = 1 / (1 + np.exp(odds + np.float32(WEIGHTS[effort].constant)))
    return np.asarray(np.where(np.isfinite(disparity), right, np.nan), np.float32)


def signs_of_error(disparity: FloatImage, sigma: FloatImage, start: FloatImage, agreed: Mask) -> NDArray[np.float32]:
    """What `Weights` multiply, in their order, (H, W, 6)."""
    known = np.isfinite(disparity)
    supported = agreed & (np.abs(start - disparity) < SUPPORT_PX)
    return np.stack([
        np.log(np.nan_to_num(sigma, nan=1.0).clip(0.02, 4.0)),
        1 - _share(supported, AROUND) / np.maximum(_share(known, AROUND), np.float32(1e-3)),
        (~supported).astype(np.float32),
        _largest_step(disparity, known),
        1 - _share(known, BESIDE),
        1 - _share(known, AROUND),
    ], axis=-1)  # fmt: skip


def _share(mask: Mask, side: int) -> FloatImage:
    return np.asarray(cv2.blur(mask.astype(np.float32), (side, side), borderType=cv2.BORDER_REPLICATE), np.float32)


def _largest_step(disparity: FloatImage, known: Mask) -> FloatImage:
    """Between any two disparities nearby, as a part of `LARGEST_STEP`, at most 1."""
    window, far = np.ones((STEP_WINDOW, STEP_WINDOW), np.uint8), np.float32(1e6)
    highest = cv2.dilate(np.where(known, disparity, -far), window)
    lowest = cv2.erode(np.where(known, disparity, far), window)
    return np.asarray(((highest - lowest) / LARGEST_STEP).clip(0, 1), np.float32)
