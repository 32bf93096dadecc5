"""Numbers to colours: perceptual maps, their legends, and one muted colour for every reason a pixel is invalid."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros.types import ByteImage, FloatImage, Matrix, Status

_MAPS = {"viridis": cv2.COLORMAP_VIRIDIS, "magma": cv2.COLORMAP_MAGMA, "plasma": cv2.COLORMAP_PLASMA}
# Blue - white - red: ends and middle of ColorBrewer's RdBu.
_DIVERGING = [(33, 102, 172), (103, 169, 207), (209, 229, 240), (247, 247, 247), (253, 219, 199), (239, 138, 98), (178, 24, 43)]  # fmt: skip # noqa: E501

#: Colour and words for each reason, the most telling first: a pixel with several bits shows the first.
REASONS: dict[Status, tuple[tuple[int, int, int], str]] = {
    Status.UNSEEN: ((24, 26, 30), "outside the rectified image"),
    Status.OUTSIDE: ((84, 90, 102), "outside the other view"),
    Status.OCCLUDED: ((52, 56, 66), "seen by the left camera only"),
    Status.LOW_TEXTURE: ((168, 160, 140), "too little texture"),
    Status.INCONSISTENT: ((132, 112, 112), "the two views disagree"),
    Status.OUT_OF_RANGE: ((196, 200, 208), "out of range"),
    Status.FILTERED: ((140, 122, 158), "isolated speckle"),
}
UNKNOWN_COLOR = (110, 110, 110)


@dataclass(frozen=True)
class ColorBar:
    """The legend of a colour map.

    Parameters
    ----------
    low, high : float
        Values at its ends; values beyond have the end's colour.
    unit : str
        E.g. ``px``, ``m``, ``baselines``.
    colormap : {'viridis', 'magma', 'plasma', 'diverging'}
        Or one of them with ``_r`` appended: reversed.
    label : str
        What is shown.
    """

    low: float
    high: float
    unit: str
    colormap: str = "viridis"
    label: str = ""

    @property
    def ticks(self) -> list[str]:
        """Values at its ends and in between, evenly, as they are written."""
        values = (self.low + (self.high - self.low) * k / 4 for k in range(5))
        return [f"{value:.3g}".replace("-", "\u2212") for value in values]


def color_table(name: str) -> ByteImage:
    """(256, 3) RGB of a colour map; a name that ends in ``_r`` turns it round.

    Raises
    ------
    ValueError
        There is no such map.
    """
    if name.endswith("_r"):
        return np.ascontiguousarray(color_table(name[:-2])[::-1])
    if name == "diverging":
        at, knots = np.linspace(0, 1, 256), np.linspace(0, 1, len(_DIVERGING))
        channels = [np.interp(at, knots, channel) for channel in np.transpose(_DIVERGING)]
        table: ByteImage = np.stack(channels, axis=1).round().astype(np.uint8)
        return table
    if name not in _MAPS:
        raise ValueError(f"colormap: expected one of {', '.join([*_MAPS, 'diverging'])}, got {name!r}")
    steps = np.arange(256, dtype=np.uint8)[:, None]
    return np.ascontiguousarray(cv2.applyColorMap(steps, _MAPS[name])[:, 0, ::-1])


def colorize(values: FloatImage | Matrix, bar: ColorBar, status: ByteImage | None = None) -> ByteImage:
    """Paint `values` as `bar` says; pixels without a value by the reason in `status`.

    Parameters
    ----------
    values : (H, W) float
        NaN (or infinite) = invalid.
    bar : ColorBar
    status : (H, W) uint8 or None
        `Status` bits.

    Returns
    -------
    (H, W, 3) uint8
        RGB.
    """
    valid = np.isfinite(values)
    span = max(bar.high - bar.low, 1e-12)
    shade = np.where(valid, (values - bar.low) / span, 0.0).clip(0, 1)
    painted: ByteImage = color_table(bar.colormap)[np.rint(255 * shade).astype(np.uint8)]
    painted[~valid] = UNKNOWN_COLOR
    if status is not None:
        for reason, (color, _) in reversed(REASONS.items()):
            painted[~valid & (status & np.uint8(reason) != 0)] = color
    return painted


def robust_limits(values: FloatImage | Matrix, share: float = 0.01) -> tuple[float, float]:
    """Quantiles that leave out `share` at either end, never equal; (0, 1) without values."""
    finite = values[np.isfinite(values)]
    if finite.size == 0:
        return 0.0, 1.0
    low, high = (float(q) for q in np.quantile(finite, [share, 1 - share]))
    return (low, high) if high > low else (low - 0.5, high + 0.5)


def reasons_in(values: FloatImage, status: ByteImage) -> list[tuple[tuple[int, int, int], str, float]]:
    """Colour, words and share of the pixels (0 to 1) of every reason that is shown, as `colorize` chooses it."""
    left = ~np.isfinite(values)
    found = []
    for reason, (color, words) in REASONS.items():
        here = left & (status & np.uint8(reason) != 0)
        left &= ~here
        if here.any():
            found.append((color, words, float(here.mean())))
    if left.any():
        found.append((UNKNOWN_COLOR, "no value", float(left.mean())))
    return found
