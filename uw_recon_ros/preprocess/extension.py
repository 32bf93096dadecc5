"""Steps 2 and 8: mirror an image to a square with a power-of-two side, and cut it out again.

Where that square would have more than `MOST_TIMES` the image's pixels (of 65536 x 1 px: 65536 times), each side is
mirrored for itself, by an eighth, to a size that the transform likes.

The image lies in the middle, mirrored on all four sides with its border pixels doubled, so that a filter that wraps
around meets its seam far from the image.
"""

from __future__ import annotations

from typing import Any, TypeVar

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

Image = TypeVar("Image", bound=NDArray[Any])


#: Pixels of the square, in times those of the image, up to which the paper's square is taken: 5 keeps it for 16:9.
MOST_TIMES = 5
_BLOCK = 32  # px: so that the wavelet can halve both sides five times, its default


def extension_shape(height: int, width: int) -> tuple[int, int]:
    """Size of the extension: the smallest power of two that holds both, twice; or each for itself, px.

    Raises
    ------
    ValueError
        A size under 1.
    """
    if min(height, width) < 1:
        raise ValueError(f"height, width: expected at least 1 px, got {height}, {width}")
    side = 1 << (max(height, width) - 1).bit_length()
    if side * side <= MOST_TIMES * height * width:
        return side, side
    return _liked_size(height), _liked_size(width)


def _liked_size(size: int) -> int:
    """At least 9/8 of a size, in blocks whose number has small prime factors."""
    return _BLOCK * int(scipy.fft.next_fast_len(-(-(size + size // 8) // _BLOCK), real=True))


def extension_window(height: int, width: int) -> tuple[slice, slice]:
    """Rows and columns of the image within its extension."""
    rows, columns = extension_shape(height, width)
    top, left = (rows - height) // 2, (columns - width) // 2
    return slice(top, top + height), slice(left, left + width)


def extend_symmetric(image: Image) -> Image:
    """Mirror an image to a square whose side is a power of two (paper, step 2), or to `extension_shape`.

    Parameters
    ----------
    image : (H, W) or (H, W, C), any dtype OpenCV knows

    Returns
    -------
    (M, N) or (M, N, C), same dtype
        ``M, N = extension_shape(H, W)``; nothing is resampled.

    Raises
    ------
    ValueError
        No pixels, or not an image's shape.
    """
    array = np.asarray(image)
    if array.ndim not in (2, 3) or array.size == 0:
        raise ValueError(f"image: expected shape (H, W) or (H, W, C) with at least one pixel, got {array.shape}")
    height, width = array.shape[:2]
    shape = extension_shape(height, width)
    rows, columns = extension_window(height, width)
    borders = (rows.start, shape[0] - rows.stop, columns.start, shape[1] - columns.stop)
    extended = cv2.copyMakeBorder(array, *borders, cv2.BORDER_REFLECT)
    return extended.reshape(*shape, *array.shape[2:])  # type: ignore[return-value]


def crop_extension(extended: Image, height: int, width: int) -> Image:
    """Cut the image out of its extension again (paper, step 8).

    Parameters
    ----------
    extended : (M, N) or (M, N, C)
        What `extend_symmetric` returned, filtered or not.
    height, width : int
        The image's size before the extension, px.

    Returns
    -------
    (height, width) or (height, width, C)
        A view on `extended`: exactly what was extended, where nothing was filtered.

    Raises
    ------
    ValueError
        `extended` is not the extension of an image of that size.
    """
    rows, columns = extension_shape(height, width)
    if extended.shape[:2] != (rows, columns):
        raise ValueError(f"extended: expected {rows} x {columns} px for {height} x {width}, got shape {extended.shape}")
    return extended[extension_window(height, width)]  # type: ignore[return-value]
