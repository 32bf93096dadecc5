"""How likely a disparity is right, from what can be seen of the result alone.

Sigma tells how exact a right match is; a wrong one looks as exact. What betrays it are its surroundings: planes that
the start does not support, steps nearby, neighbours without a match, a start that the views disagree about far around;
and noise that comes near the texture's contrast, as in haze. How much each tells was learnt by logistic regression on
six pairs in air and four waters (``test/benchmark/match_trust.py --learn``), for errors of more than `WRONG_PX`, and
for those of more than `FAR_PX` apart: these must not look exact. It was checked on pairs left out, and in other waters.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from uw_recon_ros.masks import only_where, share_around
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Status

WRONG_PX, FAR_PX = 1.0, 4.0
SUPPORT_PX = 1.5  #: the start supports what is this near to it
AROUND, BESIDE, STEP_WINDOW = 25, 7, 9  #: sides of windows, px
FAR_AROUND = 101  #: side of the window that the views' disagreement is averaged over, px
LARGEST_STEP = 8.0  #: px
GRAIN = 0.02  #: noise over contrast that is as good as none
DOUBTFUL = 0.93  #: what is less likely to be right than this may be far off, whatever else is seen
DOUBTFUL_SIGMA = 1.0  #: least sigma of what may be far off, px


class Signs(NamedTuple):
    """What betrays errors, (H, W) float32 each but the last.

    Parameters
    ----------
    log_sigma
        Natural logarithm of sigma, px.
    unsupported, here
        Share of the surroundings that the start does not support; and where it does not support the pixel, 1.
    step
        Largest step nearby, as a part of `LARGEST_STEP`.
    hollow, sparse
        Share of pixels without a disparity, beside and around.
    contradicted
        Share of the start far around that the views disagree about, occlusions and the border apart.
    grain : float
        Natural logarithm of the noise over the contrast, of the whole view.
    """

    log_sigma: FloatImage
    unsupported: FloatImage
    here: FloatImage
    step: FloatImage
    hollow: FloatImage
    sparse: FloatImage
    contradicted: FloatImage
    grain: float


class Weights(NamedTuple):
    """Of the logarithm of the odds of being wrong.

    Parameters
    ----------
    constant : float
    signs : tuple of float
        Times each of `Signs`.
    """

    constant: float
    signs: tuple[float, ...]


#: Of errors over `WRONG_PX`, from air alone: where in a view errors are, whatever the water.
WRONG = {
    "navigation": Weights(-4.21, (0.01, 0.0, 0.0, 3.2, 2.31, 2.35, 0.0, 0.0)),
    "balanced": Weights(-4.55, (0.58, 4.26, 1.1, 2.78, 1.52, -0.35, 0.0, 0.0)),
    "quality": Weights(-5.08, (0.54, 3.62, 1.4, 3.08, 0.55, 2.62, 0.0, 0.0)),
}
#: Of errors over `FAR_PX`, from air and four waters; more than 0 is doubtful.
FAR = {
    "navigation": Weights(-0.7, (-0.11, 0.0, 0.0, 2.61, 0.2, 2.31, 15.14, 0.16)),
    "balanced": Weights(-0.09, (0.28, 1.91, 0.45, 1.65, 0.41, 1.84, 12.96, 0.32)),
    "quality": Weights(-0.09, (0.28, 1.91, 0.45, 1.65, 0.41, 1.84, 12.96, 0.32)),
}


def confidence_of(signs: Signs, effort: str) -> FloatImage:
    """Probability that a disparity is less than `WRONG_PX` off, (H, W); meaningless where there is none.

    Parameters
    ----------
    signs : Signs
    effort : {'navigation', 'balanced', 'quality'}
        That found the disparity.
    """
    return np.asarray(1 / (1 + np.exp(_weighed(signs, WRONG[effort]))), np.float32)


def doubtful(signs: Signs, effort: str, confidence: FloatImage) -> Mask:
    """Where a disparity may be more than `FAR_PX` off, (H, W) bool: of what remains, hardly one in 1000 is.

    Parameters
    ----------
    signs : Signs
    effort : {'navigation', 'balanced', 'quality'}
        That found the disparity.
    confidence : (H, W) float32
        Of `confidence_of`.
    """
    return np.asarray((_weighed(signs, FAR[effort]) > 0) | (confidence < DOUBTFUL))


def _weighed(signs: Signs, weights: Weights) -> FloatImage:
    total = np.full(signs.step.shape, weights.constant, np.float32)
    for sign, weight in zip(signs, weights.signs, strict=True):
        if weight:
            total += np.float32(weight) * sign
    return total


def signs_of_error(
    disparity: FloatImage, sigma: FloatImage, start: FloatImage, status: ByteImage, grain: float
) -> Signs:
    """Look for what betrays errors.

    Parameters
    ----------
    disparity, sigma : (H, W) float32
        px; NaN = none.
    start : (H, W) float32
        What the planes began with, px; ``status``, (H, W) uint8, says where both views agree about it.
    status : (H, W) uint8
    grain : float
        Noise over contrast, of `gray.noise_to_contrast`.
    """
    known = np.isfinite(disparity)
    agreed = status == 0
    supported = agreed & (np.abs(start - disparity) < SUPPORT_PX)
    # a wide window would repeat the outermost pixels: nothing is there beyond the border
    against, agree = (
        share_around(mask, FAR_AROUND, cv2.BORDER_CONSTANT) for mask in (status == Status.INCONSISTENT, agreed)
    )
    dense = share_around(known, AROUND)
    return Signs(
        np.log(np.nan_to_num(sigma, nan=1.0).clip(0.02, 4.0)),
        1 - share_around(supported, AROUND) / np.maximum(dense, np.float32(1e-3)),
        (~supported).astype(np.float32),
        _largest_step(disparity, known),
        1 - share_around(known, BESIDE),
        1 - dense,
        against / np.maximum(against + agree, np.float32(1e-3)),
        float(np.log(grain + GRAIN)),
    )


def _largest_step(disparity: FloatImage, known: Mask) -> FloatImage:
    """Between any two disparities nearby, as a part of `LARGEST_STEP`, at most 1."""
    window, far = np.ones((STEP_WINDOW, STEP_WINDOW), np.uint8), 1e6
    highest = cv2.dilate(only_where(known, disparity, -far), window)
    lowest = cv2.erode(only_where(known, disparity, far), window)
    return np.asarray(((highest - lowest) / LARGEST_STEP).clip(0, 1), np.float32)
