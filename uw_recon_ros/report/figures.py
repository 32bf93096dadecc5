"""Pictures of the stages: RGB arrays in, RGB arrays out."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.report.colors import ColorBar, colorize, robust_limits
from uw_recon_ros.types import Axis, ByteImage, DepthMap, DisparityMap, FloatImage, RawImage

_GAP = 8  # px between two views
_LINES = ((255, 209, 102), (6, 214, 160), (239, 71, 111), (120, 190, 255))  # cycled


def as_byte_rgb(image: RawImage) -> ByteImage:
    """Any raw image as (H, W, 3) uint8; 16 bits are scaled to their brightest value."""
    if image.dtype == np.uint16:
        brightest = max(int(image.max(initial=0)), 1)
        image = (image.astype(np.float32) * (255.0 / brightest)).round().astype(np.uint8)
    if image.dtype != np.uint8 or image.ndim not in (2, 3):
        raise TypeError(f"image: expected (H, W) or (H, W, 3) uint8 or uint16, got {image.shape} {image.dtype}")
    return np.repeat(image[..., None], 3, axis=2) if image.ndim == 2 else image


def disparity_bar(disparity: DisparityMap) -> ColorBar:
    """The legend that `colorize_disparity` paints by."""
    return ColorBar(*robust_limits(disparity.disparity), "px", "viridis", "disparity")


def colorize_disparity(disparity: DisparityMap, bar: ColorBar | None = None) -> ByteImage:
    """(H, W, 3) RGB of a disparity map; invalid pixels grey, by reason."""
    return colorize(disparity.disparity, bar or disparity_bar(disparity), disparity.status)


def depth_unit(depth: DepthMap) -> str:
    """``m``, or ``baselines`` where the scale is unknown."""
    return "m" if depth.geometry.metric else "baselines"


def depth_bar(depth: DepthMap, truth: FloatImage | None = None) -> ColorBar:
    """One legend for a depth map and, where it is known, its truth."""
    shown = depth.depth if truth is None or not np.isfinite(truth).any() else truth
    return ColorBar(*robust_limits(shown, 0.02), depth_unit(depth), "plasma_r", "depth")


def colorize_depth(depth: DepthMap, bar: ColorBar | None = None) -> ByteImage:
    """(H, W, 3) RGB of a depth map; invalid pixels grey, by reason."""
    return colorize(depth.depth, bar or depth_bar(depth), depth.status)


def error_bar(depth: DepthMap, truth: FloatImage) -> ColorBar:
    """A legend symmetrical about zero that holds 95 % of the errors."""
    error = np.abs(depth.depth - truth)
    limit = float(np.quantile(error[np.isfinite(error)], 0.95)) if np.isfinite(error).any() else 1.0
    limit = max(limit, 1e-6)
    return ColorBar(-limit, limit, depth_unit(depth), "diverging", "depth error, blue: too near, red: too far")


def error_map(depth: DepthMap, truth: FloatImage, bar: ColorBar | None = None) -> ByteImage:
    """(H, W, 3) RGB of depth minus truth; grey where either is missing.

    Parameters
    ----------
    depth : DepthMap
    truth : (H, W) float32
        Depth along the optical axis of the same view, same unit; NaN or inf = unknown.
    bar : ColorBar or None
        None: `error_bar`.

    Raises
    ------
    ValueError
        The two differ in size.
    """
    if truth.shape != depth.depth.shape:
        raise ValueError(f"truth: expected {depth.depth.shape} as the depth map, got {truth.shape}")
    return colorize(depth.depth - truth, bar or error_bar(depth, truth), depth.status)


def epipolar_lines(left: ByteImage, right: ByteImage, axis: Axis = "horizontal", count: int = 12) -> ByteImage:
    """Both rectified views next to each other, with lines on which matching points must lie.

    Parameters
    ----------
    left, right : (H, W, 3) uint8
        RGB, one size.
    axis : {'horizontal', 'vertical'}
        Horizontal rigs: side by side, lines along rows. Vertical ones: one above the other, lines along columns.
    count : int
        Number of lines.

    Raises
    ------
    ValueError
    """
    if left.shape != right.shape or left.ndim != 3:
        raise ValueError(f"left, right: expected two (H, W, 3) images of one size, got {left.shape} and {right.shape}")
    if axis == "vertical":
        turned = epipolar_lines(left.swapaxes(0, 1), right.swapaxes(0, 1), "horizontal", count)
        return np.ascontiguousarray(turned.swapaxes(0, 1))
    gap = np.full((left.shape[0], _GAP, 3), 255, np.uint8)
    both = np.ascontiguousarray(np.concatenate([left, gap, right], axis=1))
    thickness = 1 + both.shape[1] // 1600
    for k in range(count):
        v = round((k + 0.5) * left.shape[0] / count)
        cv2.line(both, (0, v), (both.shape[1] - 1, v), _LINES[k % len(_LINES)], thickness, cv2.LINE_8)
    return both


def with_color_bar(image: ByteImage, bar: ColorBar) -> ByteImage:
    """A colour-mapped picture with its legend drawn underneath, for files that stand alone."""
    width = image.shape[1]
    scale = max(width / 900, 0.45)
    strip = np.full((round(64 * scale), width, 3), 255, np.uint8)
    margin, top, bottom = round(16 * scale), round(10 * scale), round(28 * scale)
    ramp = np.linspace(bar.low, bar.high, width - 2 * margin)[None, :]
    strip[top:bottom, margin : width - margin] = colorize(ramp, ColorBar(bar.low, bar.high, "", bar.colormap))
    texts = [f"{bar.low:.4g}", f"{bar.label} [{bar.unit}]".strip(), f"{bar.high:.4g}"]
    for share, text in zip((0.0, 0.5, 1.0), texts, strict=True):
        (text_width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.55 * scale, 1)
        left = margin + round(share * (width - 2 * margin - text_width))
        where = (left, round(52 * scale))
        cv2.putText(strip, text, where, cv2.FONT_HERSHEY_SIMPLEX, 0.55 * scale, (40, 40, 40), 1, cv2.LINE_AA)
    return np.concatenate([image, strip])
