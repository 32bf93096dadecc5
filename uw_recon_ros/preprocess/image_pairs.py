"""Two raw images on their way in: checked, brought to [0, 1] by one factor, worked on side by side."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np

from uw_recon_ros.errors import ImageError
from uw_recon_ros.types import FloatImage, RawImage, StereoPair

R = TypeVar("R")
_kept = threading.local()

_DEPTHS = (8, 10, 12, 14, 16)  # bits of the sensors there are


class TwoThreads:
    """Calls a function for the left and the right camera at once; the libraries below release the interpreter's lock.

    The second thread belongs to the calling one and is kept: a thread made for every frame makes memory creep.
    """

    def __enter__(self) -> TwoThreads:
        if getattr(_kept, "process", None) != os.getpid():  # after a fork the thread is not there
            _kept.pool, _kept.process = ThreadPoolExecutor(max_workers=1), os.getpid()
        self._pool: ThreadPoolExecutor = _kept.pool
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __call__(self, function: Callable[..., R], *arguments: tuple[Any, Any]) -> tuple[R, R]:
        """``function`` of the left arguments, and of the right ones."""
        right = self._pool.submit(function, *(pair[1] for pair in arguments))
        left = function(*(pair[0] for pair in arguments))
        return left, right.result()


def checked_images(pair: StereoPair) -> tuple[RawImage, RawImage]:
    """Both images of a pair.

    Raises
    ------
    ImageError
        An image is empty or no image, or the cameras differ in shape or dtype.
    TypeError
        Neither uint8 nor uint16.
    """
    views = np.asarray(pair.left), np.asarray(pair.right)
    for name, image in zip(("left", "right"), views, strict=True):
        if image.dtype not in (np.uint8, np.uint16):
            raise TypeError(f"{name}: expected uint8 or uint16, got {image.dtype}")
        if image.size == 0 or not (image.ndim == 2 or (image.ndim == 3 and image.shape[2] == 3)):
            raise ImageError(f"{name}: expected shape (H, W) or (H, W, 3) with at least one pixel, got {image.shape}")
    left, right = views
    if left.shape != right.shape or left.dtype != right.dtype:
        raise ImageError(
            "right: expected the left image's shape and dtype, "
            f"{left.shape} {left.dtype}, got {right.shape} {right.dtype}"
        )
    return views


def full_scale(views: tuple[RawImage, RawImage], sensor_bits: int = 0) -> float:
    """The value that stands for 1, common to both cameras.

    Parameters
    ----------
    cameras : two arrays of uint8 or uint16
    sensor_bits : int
        Bits that a 16-bit pixel really has; 0: the fewest of 8, 10, 12, 14 and 16 that hold the brightest pixel.

    Returns
    -------
    float
        255 for uint8.
    """
    if views[0].dtype == np.uint8:
        return 255.0
    if sensor_bits:
        return float((1 << sensor_bits) - 1)
    brightest = max(int(view.max()) for view in views)
    return float(next((1 << bits) - 1 for bits in _DEPTHS if brightest < 1 << bits))


def unit_from_raw(image: RawImage, full_scale: float) -> FloatImage:
    """The image as float32, `full_scale` as 1."""
    unit: FloatImage = np.multiply(image, np.float32(1.0 / full_scale), dtype=np.float32)
    return unit
