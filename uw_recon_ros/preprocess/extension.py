"""Steps 2 and 8: mirror an image to a square with a power-of-two side, and cut it out again.

The image lies in the middle, mirrored on all four sides with its border pixels doubled, so that a filter that wraps
around meets its seam far from the image.
"""

from __future__ import annotations

from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

Image = TypeVar("Image", bound=NDArray[Any])


def extension_side(height: int, width: int) -> int:
    """Side of the square: the smallest power of two that holds both sizes, px.

    Raises
    ------
    ValueError
        A size under 1.
    """
    if min(height, width) < 1:
        raise ValueError(f"height, width: expected at least 1 px, got {height}, {width}")
    return int(1 << (max(height, width) - 1).bit_length())


def extension_window(height: int, width: int) -> tuple[slice, slice]:
    """Rows and columns of the image within its extension."""
    side = extension_side(height, width)
    top, left = (side - height) // 2, (side - width) // 2
    return slice(top, top + height), slice(left, left + width)


def extend_symmetric(image: Image) -> Image:
    """Mirror an image to a square whose side is a power of two (paper, step 2).

    Parameters
    ----------
    image : (H, W) or (H, W, C), any dtype OpenCV knows

    Returns
    -------
    (N, N) or (N, N, C), same dtype
        ``N = extension_side(H, W)``; nothing is resampled.

    Raises
    ------
    ValueError
        No pixels, or not an image's shape.
    """
    array = np.asarray(image)
    if array.ndim not in (2, 3) or array.size == 0:
        raise ValueError(f"image: expected shape (H, W) or (H, W, C) with at least one pixel, got {array.shape}")
    height, width = array.shape[:2]
    side = extension_side(height, width)
    rows, columns = extension_window(height, width)
    borders = (rows.start, side - rows.stop, columns.start, side - columns.stop)
    extended = cv2.copyMakeBorder(array, *borders, cv2.BORDER_REFLECT)
    return extended.reshape(side, side, *array.shape[2:])  # type: ignore[return-value]


def crop_extension(extended: Image, height: int, width: int) -> Image:
    """Cut the image out of its extension again (paper, step 8).

    Parameters
    ----------
    extended : (N, N) or (N, N, C)
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
    side = extension_side(height, width)
    if extended.shape[:2] != (side, side):
        raise ValueError(f"extended: expected {side} x {side} px for {height} x {width}, got shape {extended.shape}")
    return extended[extension_window(height, width)]  # type: ignore[return-value]
