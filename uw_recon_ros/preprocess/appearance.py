"""What is shown and textured, unless the paper's chain is asked for: balanced, evenly lit, free of grain and halos.

The white balance is one map for both cameras (`white_balance`). Noise is smoothed by its own measure, in lightness and
in colour, by a filter that keeps edges; so is the light's unevenness found, which is then halved, so that no rim arises
at an edge (``test/benchmark/enhancement.py`` sets it beside other enhancers).

References
----------
.. [1] J. Immerkaer, "Fast noise variance estimation", Computer Vision and Image Understanding 64 (1996) 300-302.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray
from uw_recon_ros.preprocess.color import RGB_FROM_YCBCR, YCBCR_FROM_RGB
from uw_recon_ros.preprocess.guided import guided_smooth, reduced
from uw_recon_ros.preprocess.image_pairs import TwoThreads
from uw_recon_ros.preprocess.intensity import joint_percentiles
from uw_recon_ros.preprocess.white_balance import white_balance
from uw_recon_ros.types import Mask

Views = tuple[FloatArray, FloatArray]

_LIGHTNESS_NOISE, _COLOR_NOISE = 2.0, 4.0  # standard deviations of the noise of which half is kept
_COLOR_REDUCTION, _LIGHT_REDUCTION = 2, 4
_BLOCK, _PLAINEST_PERCENT = 16, 5.0  # px a side; of the blocks
_LIGHT_RADIUS = 0.06  # of the longer side: larger is the light's unevenness
_LIGHT_EDGE = 0.08  # of the range of lightness: an edge in the scene, not in the light
_LIGHT_KEPT, _DETAIL_GAIN = 0.4, 1.1
_PERCENTS = (1.0, 50.0, 99.0)
_BLACK, _MIDDLE, _WHITE = 0.05, 0.53, 0.95  # where they come to lie
_MOST_STRETCH = 1.25
_SHOULDER = 0.1  # range at either end that rolls off
_MOST_COLOR_GAIN = 5.0
_DARK = 0.04  # lightness under which a colour is not raised any more
_WHITE_HOT = (0.87, 0.99)  # of two channels: a colour fades out, for none is known


class _Look(NamedTuple):
    """An image on its way: lightness (H, W), and Cb and Cr of a colour image, half that size each way."""

    light: FloatArray
    chroma: tuple[FloatArray, ...]


def improve_appearance(both: TwoThreads, views: Views, masks: tuple[Mask, Mask]) -> Views:
    """Make a pair pleasant and true to look at.

    Parameters
    ----------
    both : TwoThreads
    views : two of (H, W) or (H, W, 3) float32
        As the cameras gave them, [0, 1]; RGB.
    masks : two of (H, W) bool
        What does not count.

    Returns
    -------
    two of (H, W, 3) float32
        RGB; what exceeds [0, 1] is to be clipped.
    """
    looks = _without_grain(both, _balanced(both, views, masks))
    black, _, white = _percentiles([look.light for look in looks], masks)
    even = both(lambda look: _evenly_lit(look.light, black, 1.0 / max(white - black, 0.02)), looks)
    scale, shift = _stretch(*_percentiles(even, masks))
    return both(lambda look, light: _colored(look, _rolled_off(light * scale + shift)), looks, even)


def _balanced(both: TwoThreads, views: Views, masks: tuple[Mask, Mask]) -> tuple[_Look, _Look]:
    if views[0].ndim == 2:
        return _Look(views[0], ()), _Look(views[1], ())
    balance = white_balance(views, masks)
    return both(lambda view: _parted(view, balance), views)


def _parted(view: FloatArray, balance: NDArray[np.float64]) -> _Look:
    """Lightness of every pixel; colours at half the size, as in films and JPEG."""
    light = _root(cv2.transform(cv2.multiply(view, view), YCBCR_FROM_RGB[:1] @ balance))
    small = reduced(view, _COLOR_REDUCTION)
    rgb = _root(cv2.transform(cv2.multiply(small, small), balance))
    _, blue, red = cv2.split(cv2.transform(rgb, YCBCR_FROM_RGB))
    cool = _cool(small)
    return _Look(light, (cv2.multiply(blue, cool), cv2.multiply(red, cool)))


def _root(light: FloatArray) -> FloatArray:
    """From linear light to values as a camera gives them, in place."""
    np.maximum(light, 0, out=light)
    return np.sqrt(light, out=light)


def _cool(view: FloatArray) -> FloatArray:
    """1, and less where two channels are at their end: bubbles and lamps are white."""
    red, green, blue = cv2.split(view)
    second = cv2.max(cv2.min(red, green), cv2.min(cv2.max(red, green), blue))
    low, high = _WHITE_HOT
    cool: FloatArray = np.clip((np.float32(high) - second) * np.float32(1.0 / (high - low)), 0, 1)
    return cool


def _without_grain(both: TwoThreads, looks: tuple[_Look, _Look]) -> tuple[_Look, _Look]:
    """Both cameras by one measure of the noise of each plane."""
    planes = [(look.light, *look.chroma) for look in looks]
    noise = [max(map(_noise, pair)) for pair in zip(*planes, strict=True)]
    return both(lambda look: _smoothed(look, noise), looks)


def _smoothed(look: _Look, noise: Sequence[float]) -> _Look:
    light = guided_smooth(look.light, radius=2, edge=_LIGHTNESS_NOISE * noise[0])
    chroma = tuple(
        guided_smooth(plane, radius=2, edge=_COLOR_NOISE * sigma)
        for plane, sigma in zip(look.chroma, noise[1:], strict=True)
    )
    return _Look(light, chroma)


def _noise(plane: FloatArray) -> float:
    """Standard deviation of white noise, from diagonal differences [1]_ in the plainest blocks: texture is no noise."""
    rows, columns = (size // _BLOCK for size in plane.shape)
    if min(rows, columns) < 2:
        return 0.0
    kernel = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6
    bent = np.abs(cv2.filter2D(plane[: rows * _BLOCK, : columns * _BLOCK], -1, kernel))
    blocks = cv2.resize(bent, (columns, rows), interpolation=cv2.INTER_AREA)
    return float(np.percentile(blocks, _PLAINEST_PERCENT)) * float(np.sqrt(np.pi / 2))


def _percentiles(lights: Sequence[FloatArray], masks: Sequence[Mask]) -> NDArray[np.float64]:
    step = max(min(lights[0].shape) // 120, 1)
    return joint_percentiles(
        [light[::step, ::step] for light in lights], _PERCENTS, [mask[::step, ::step] for mask in masks]
    )


def _evenly_lit(light: FloatArray, black: float, scale: float) -> FloatArray:
    """Lightness, the light's slow changes compressed."""
    stretched = (light - np.float32(black)) * np.float32(scale)
    radius = max(round(_LIGHT_RADIUS * max(light.shape)), 1)
    base = guided_smooth(stretched, radius=radius, edge=_LIGHT_EDGE, reduction=_LIGHT_REDUCTION)
    return cv2.addWeighted(stretched, _DETAIL_GAIN, base, _LIGHT_KEPT - _DETAIL_GAIN, 0.0)


def _stretch(black: float, middle: float, white: float) -> tuple[np.float32, np.float32]:
    """Scale and shift of the lightness: the middle in its place, unless black or white would have no room."""
    scale = min((_WHITE - _BLACK) / max(white - black, 1e-3), _MOST_STRETCH)
    lowest, highest = _BLACK - black * scale, _WHITE - white * scale
    return np.float32(scale), np.float32(np.clip(_MIDDLE - middle * scale, min(lowest, highest), max(lowest, highest)))


def _rolled_off(light: FloatArray) -> FloatArray:
    """Squeezed into [0, 1], in place: the same between the shoulders, exponential beyond."""
    s = np.float32(_SHOULDER)
    for outside, end, sign in ((light < s, np.float32(0), 1), (light > 1 - s, np.float32(1), -1)):
        beyond = sign * (light[outside] - end)  # less than s
        light[outside] = end + sign * s * np.exp((beyond - s) / s)
    return light


def _colored(look: _Look, light: FloatArray) -> FloatArray:
    """The new lightness, and colours raised as it was."""
    if not look.chroma:
        return cv2.merge([light, light, light])
    gain = np.minimum(light / np.maximum(look.light, np.float32(_DARK)), np.float32(_MOST_COLOR_GAIN))
    chroma = [cv2.multiply(cv2.resize(plane, light.shape[::-1]), gain) for plane in look.chroma]
    rgb: FloatArray = cv2.transform(cv2.merge([light, *chroma]), RGB_FROM_YCBCR)
    return rgb
