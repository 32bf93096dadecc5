"""Maps from rectified to raw pixels, and the rectangle of them that shows something."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Matrix, Window
from uw_recon_ros.unseen_pixels import blackened, with_margin

_INTERPOLATION = {"linear": cv2.INTER_LINEAR, "cubic": cv2.INTER_CUBIC, "lanczos": cv2.INTER_LANCZOS4}
Columns = NDArray[np.int64]
_FAR_PX = -1e4  # where a map points that has nowhere to point


@dataclass(frozen=True, eq=False)
class Canvas:
    """One rectified view before cropping.

    Parameters
    ----------
    view : RectifiedCamera
    raw_from_rect : (H, W, 2) float32
        Raw pixel (u, v) of every rectified pixel.
    shown : (H, W) bool
        Where that lies within the raw image.
    """

    view: RectifiedCamera
    raw_from_rect: FloatImage
    shown: Mask

    def part(self, window: Window) -> FloatImage:
        """The map of a window."""
        return np.ascontiguousarray(self.raw_from_rect[window.slices])


def make_canvas(view: RectifiedCamera, width: int, height: int, raw_width: int, raw_height: int) -> Canvas:
    """Map every pixel of a rectified image of the given size."""
    raw = view.raw_grid(width, height).astype(np.float32)
    u, v = raw[..., 0], raw[..., 1]
    with np.errstate(invalid="ignore"):  # a pixel's square belongs to the image: half a pixel beyond its centre
        shown = (u >= -0.5) & (u <= raw_width - 0.5) & (v >= -0.5) & (v <= raw_height - 0.5)
    np.nan_to_num(raw, copy=False, nan=_FAR_PX)
    return Canvas(view, raw.clip(_FAR_PX, -_FAR_PX), shown)


def _longest_run(row: Mask) -> tuple[int, int]:
    edges = np.flatnonzero(np.diff(np.concatenate([[False], row, [False]]).astype(np.int8)))
    runs = edges.reshape(-1, 2)
    first, last = max(runs, key=lambda run: run[1] - run[0])
    return int(first), int(last)


def row_spans(shown: Mask) -> tuple[Columns, Columns]:
    """First column and column after the last of the longest run of True in every row; equal where there is none."""
    width = shown.shape[1]
    count = shown.sum(axis=1)
    first, last = shown.argmax(axis=1), width - shown[:, ::-1].argmax(axis=1)
    last = np.where(count > 0, last, first)
    for row in np.flatnonzero(last - first != count):
        first[row], last[row] = _longest_run(shown[row])
    return first.astype(np.int64), last.astype(np.int64)


def inner_windows(shown: tuple[Mask, Mask], *, same_columns: bool) -> tuple[Window, Window]:
    """Largest rectangles wholly shown in either view, of one size and on the same rows.

    Parameters
    ----------
    shown : two of (H, W) bool
        What the left and the right view show.
    same_columns : bool
        Whether both rectangles must have the same columns, too.

    Returns
    -------
    Window, Window
        Of area 0 where there are none.
    """
    first, last = (np.stack(edges) for edges in zip(*(row_spans(mask) for mask in shown), strict=True))
    if same_columns:
        first, last = first.max(axis=0, keepdims=True), last.min(axis=0, keepdims=True)
    height = first.shape[1]
    best = (0, 0, 0, 0)  # area, top, rows, width
    for top in range(height):
        if (height - top) * shown[0].shape[1] <= best[0]:
            break
        left, right = np.maximum.accumulate(first[:, top:], axis=1), np.minimum.accumulate(last[:, top:], axis=1)
        widths = (right - left).min(axis=0)
        areas = widths * np.arange(1, height - top + 1)
        rows = int(areas.argmax())
        if areas[rows] > best[0]:
            best = (int(areas[rows]), top, rows + 1, int(widths[rows]))
    _, top, rows, width = best
    windows = [_centred(f[top : top + rows], e[top : top + rows], top, width) for f, e in zip(first, last, strict=True)]
    return windows[0], windows[-1]


def _centred(first: Columns, last: Columns, top: int, width: int) -> Window:
    """A window of the given width in the middle of what all rows show."""
    if not width:
        return Window(0, top, 0, 0)
    left, right = int(first.max()), int(last.min())
    return Window(left + (right - left - width) // 2, top, width, len(first))


def warp_image(image: ByteImage, raw_from_rect: FloatImage, interpolation: str) -> ByteImage:
    """Read an image at the raw pixels of a map; black outside.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) uint8
    raw_from_rect : (h, w, 2) float32
    interpolation : {'linear', 'cubic', 'lanczos'}

    Returns
    -------
    (h, w) or (h, w, 3) uint8
    """
    return blackened(read_at(image, raw_from_rect, interpolation), beyond_image(raw_from_rect, *image.shape[:2]))


def read_at(image: ByteImage, raw_from_rect: FloatImage, interpolation: str) -> ByteImage:
    """`warp_image`, but that the image's border goes on outside: for who knows already what lies there.

    Maps in fixed point would save nothing for gray images, and cost a digit in one pixel of twenty.
    """
    return np.asarray(_remapped(image, raw_from_rect, _INTERPOLATION[interpolation]), np.uint8)


def _remapped(image: NDArray[Any], raw_from_rect: FloatImage, interpolation: int) -> NDArray[Any]:
    nothing: Any = None  # u and v are in one array: the second map has nothing to add
    return np.asarray(cv2.remap(image, raw_from_rect, nothing, interpolation, borderMode=cv2.BORDER_REPLICATE))


def beyond_image(raw_from_rect: FloatImage, height: int, width: int) -> Mask:
    """Where a map points beyond a raw image of that size, (h, w) bool."""
    u, v = raw_from_rect[..., 0], raw_from_rect[..., 1]
    return np.asarray((u < -0.5) | (u > width - 0.5) | (v < -0.5) | (v > height - 0.5))


def warp_unseen(mask: Mask, raw_from_rect: FloatImage, outside: Mask | None = None) -> Mask:
    """Where a rectified image shows nothing, (h, w) bool.

    Parameters
    ----------
    mask : (H, W) bool
        Where the raw image shows nothing.
    raw_from_rect : (h, w, 2) float32
    outside : (h, w) bool or None
        `beyond_image` of the map, where that is known.

    Returns
    -------
    (h, w) bool
        Outside the raw image, and what is interpolated from masked pixels, with a margin.
    """
    if outside is None:
        outside = beyond_image(raw_from_rect, *mask.shape)
    if not mask.any():
        return outside
    share = _remapped(mask.astype(np.float32), raw_from_rect, cv2.INTER_LINEAR)
    return with_margin(share > 0) | outside


def swapped_map(raw_from_rect: FloatImage) -> FloatImage:
    """The map of a view with rows and columns exchanged."""
    return np.ascontiguousarray(raw_from_rect.transpose(1, 0, 2)[..., ::-1])


def swapped_window(window: Window) -> Window:
    """The window of a view with rows and columns exchanged."""
    return Window(window.v, window.u, window.height, window.width)


def warped_centre(view: RectifiedCamera, raw_width: int, raw_height: int) -> Matrix:
    """Rectified pixel of the raw image's centre, (2,) px."""
    centre: Matrix = view.rectified(np.array([[(raw_width - 1) / 2, (raw_height - 1) / 2]]))[0]
    return centre
