"""One gray image a view for the comparisons of the census, finer than a byte, and smoothed where noise asks for it."""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.planes.thread_pool import run_parallel
from uw_recon_ros.medians import median
from uw_recon_ros.types import ByteImage, FloatImage

CONTRAST = 128  #: units that the median local contrast of either view is made to be
LEVELS = 10  #: units that are about a gray level of an image in air
LUMINANCE = (0.299, 0.587, 0.114)
CLEAN, NOISY = (
    0.2,
    0.4,
)  #: noise / contrast up to which nothing is smoothed, and from which all channels weigh alike
SMOOTHING = 0.9  #: standard deviation of the smoothing there, px
BLOCK, FEWEST_BLOCKS = 8, 24  #: px; of JPEG and most video, and how many a side must have: of few, chance makes a grid
#: Ratio of steps between blocks to others: 1.0 to 1.17 in what is not compressed; 1.3 to 2.5 in JPEG of quality 30.
WHOLE, IN_BLOCKS = 1.2, 1.3
LEAST_CONTRAST = 1.0  #: less is taken for this, gray levels
MOST = 8000  #: units from the median, at most
_CONTRAST_WINDOW = 9
_EVERY = 3  # line, of those that blocks are looked for in
_SAMPLES = 60000  # pixels, about, that medians are taken over
_ONE_VALUE = 0.1  # standard deviation that rounding leaves in a window of one value

Gray = NDArray[np.int16]


def gray_pair(left: ByteImage, right: ByteImage, threads: int = 1) -> tuple[Gray, Gray, float, float]:
    """Gray images of both views, (H, W), of contrast `CONTRAST` each; how noisy they are.

    That is told twice: from 0 to 1, and as `noise_to_contrast`.

    Where noise is strong against the contrast, the mean of the channels carries less of it than the luminance, and
    smoothing helps the comparisons; elsewhere both would cost sharpness.

    Parameters
    ----------
    left, right : (H, W, C) uint8
        C = 1 or 3.
    threads : int
        The result does not depend on it.
    """
    luminance = mix(left, 0)
    ratio = noise_to_contrast(luminance)
    noise = max(float(np.clip((ratio - CLEAN) / (NOISY - CLEAN), 0, 1)), compression(luminance))
    images, grays = (left, right), [np.empty(0, np.int16)] * 2

    def normalise(view: int) -> None:
        grays[view] = _normalise(images[view], noise)

    run_parallel(normalise, (0, 1), min(threads, 2))
    return grays[0], grays[1], noise, ratio


def noise_to_contrast(gray: FloatImage) -> float:
    """Standard deviation of the noise, from second differences (Immerkaer, 1996), over the median local contrast."""
    if min(gray.shape) < _CONTRAST_WINDOW:
        return 0.0
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)
    spread = _spread(gray)
    uneven = spread > _ONE_VALUE
    if not uneven.any():
        return 0.0
    noise = median(np.abs(some(np.asarray(cv2.filter2D(gray, -1, kernel), np.float32)))[uneven]) / 0.6745 / 6
    return noise / max(median(spread[uneven]), 1e-3)


def compression(gray: FloatImage) -> float:
    """How far blocks of `BLOCK` pixels hide what is fine, from 0 to 1: steps between them against those within.

    What JPEG leaves out is no noise that could be measured, but it differs between the views as noise does. A grid that
    rectifying has bent is not seen.
    """
    if min(gray.shape) < FEWEST_BLOCKS * BLOCK:
        return 0.0
    ratio = min(_grid(np.diff(gray[::_EVERY], axis=1)), _grid(np.diff(gray[:, ::_EVERY], axis=0).T))
    return float(np.clip((ratio - WHOLE) / (IN_BLOCKS - WHOLE), 0, 1))


def _grid(steps: FloatImage) -> float:
    """Mean step at the columns of a grid of any phase over the median of the others."""
    columns = np.abs(steps).mean(axis=0)
    phases = np.sort(columns[: len(columns) // BLOCK * BLOCK].reshape(-1, BLOCK).mean(axis=0))
    return float(phases[-1] / max(float(np.median(phases[:-1])), 1e-3))


def local_contrast(gray: FloatImage | Gray) -> float:
    """Median standard deviation within 9x9 pixels, in units of the image; windows of one value do not count.

    Where half an image is burnt out or black, the median of all windows would be that of nothing: 0.
    """
    spread = _spread(gray)
    uneven = spread > _ONE_VALUE
    return median(spread[uneven]) if uneven.any() else 0.0


def _spread(gray: FloatImage | Gray) -> FloatImage:
    """Standard deviation about `some` pixels."""
    values = np.asarray(gray, np.float32)
    window = (_CONTRAST_WINDOW, _CONTRAST_WINDOW)
    mean, square = (some(np.asarray(cv2.blur(x, window), np.float32)) for x in (values, values * values))
    return np.asarray(np.sqrt(np.maximum(square - mean * mean, 0)), np.float32)


def some(values: FloatImage | Gray) -> FloatImage:
    """Every n-th pixel of every n-th row; n is odd, for what sensors do to colours has a period of two."""
    step = 2 * (math.isqrt(values.size // _SAMPLES) // 2) + 1
    return np.asarray(values[::step, ::step], np.float32)


def mix(image: ByteImage, evenness: float) -> FloatImage:
    """One channel: luminance, or with `evenness` 1 the mean of all."""
    if image.shape[2] == 1:
        return np.asarray(image[..., 0], np.float32)
    weights = np.array(LUMINANCE, np.float32) * (1 - evenness) + evenness / 3
    return np.asarray(cv2.transform(image.astype(np.float32), weights[None].astype(np.float32)), np.float32)


def _normalise(image: ByteImage, noise: float) -> Gray:
    gray = mix(image, noise)
    if noise * SMOOTHING > 0.1:
        gray = np.asarray(cv2.GaussianBlur(gray, (0, 0), noise * SMOOTHING), np.float32)
    gain = CONTRAST / max(local_contrast(gray), LEAST_CONTRAST)
    level = np.float32(median(some(gray)))
    return np.asarray(np.round((gray - level) * np.float32(gain)).clip(-MOST, MOST), np.int16)
