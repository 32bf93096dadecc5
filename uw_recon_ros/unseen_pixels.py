"""What an image does not show: one spelling, exact 0, so that a mask travels wherever its image does.

Images to be matched hold 0 where nothing is seen (a black border, a dead part of the camera, what lies outside a
rectified view) and at least 1 elsewhere; see `mark_unseen`. Read from the image, by `unseen`, it is the same offline,
behind a topic, and for images that others rectified.
"""

from __future__ import annotations

from typing import Any, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.types import ByteImage, Mask

Image = TypeVar("Image", bound=NDArray[Any])

MARGIN = 3  #: px beside what is not seen that interpolation, filters and compression have spoilt
_PATCH = np.ones((2 * MARGIN + 1, 2 * MARGIN + 1), np.uint8)


def unseen(image: ByteImage) -> Mask:
    """Where an image is exactly 0 over a patch of at least 7x7 px, the image's borders not counted.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) uint8

    Returns
    -------
    (H, W) bool
        Single dark pixels are part of a picture.
    """
    zero = np.asarray(image == 0 if image.ndim == 2 else (image == 0).all(axis=2))
    if not zero.any():
        return zero
    return np.asarray(cv2.morphologyEx(zero.astype(np.uint8), cv2.MORPH_OPEN, _PATCH) > 0)


def with_margin(mask: Mask) -> Mask:
    """A mask and `MARGIN` px around it: whatever its shape, `unseen` finds it again."""
    if not mask.any():
        return mask
    return np.asarray(cv2.dilate(mask.astype(np.uint8), _PATCH) > 0)


def mark_unseen(image: ByteImage, mask: Mask) -> ByteImage:
    """The image with 0 where `mask` says that nothing is seen, and at least 1 elsewhere.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) uint8
    mask : (H, W) bool
        Of `with_margin`.
    """
    marked: ByteImage = np.maximum(image, np.uint8(1))
    marked[mask] = 0
    return marked


def blackened(image: Image, mask: Mask) -> Image:
    """The image, 0 where nothing is seen: an image to look at, in which black need not mean that. In place."""
    image[mask] = 0
    return image


def continued(image: Image, mask: Mask) -> Image:
    """The image, what it does not show replaced by what lies as far on the other side of the border.

    So no filter meets an edge that is not in the scene, and no statistic a plain area: noise, contrast and brightness
    go on as in the paper's symmetric extension (step 2).

    Parameters
    ----------
    image : (H, W) or (H, W, C), any dtype
    mask : (H, W) bool
        True where nothing is seen; nothing or everything: the image itself is returned.

    Returns
    -------
    same shape and dtype
    """
    if not mask.any() or mask.all():
        return image
    v, u, border_v, border_u = _nearest_seen(mask)
    height, width = mask.shape
    across_v, across_u = (2 * border_v - v).clip(0, height - 1), (2 * border_u - u).clip(0, width - 1)
    again = mask[across_v, across_u]
    across_v[again], across_u[again] = border_v[again], border_u[again]
    filled = image.copy()
    filled[v, u] = image[across_v, across_u]
    return filled  # type: ignore[no-any-return]


Pixels = NDArray[np.intp]


def _nearest_seen(mask: Mask) -> tuple[Pixels, Pixels, Pixels, Pixels]:
    """Row and column of every masked pixel, and of the pixel nearest to it that is not."""
    _, labels = cv2.distanceTransformWithLabels(
        mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    seen = np.flatnonzero(~mask)
    at = np.empty(int(labels.max()) + 1, np.intp)
    at[labels.ravel()[seen]] = seen
    v, u = np.nonzero(mask)
    nearest = at[labels[v, u]]
    return v, u, nearest // mask.shape[1], nearest % mask.shape[1]
