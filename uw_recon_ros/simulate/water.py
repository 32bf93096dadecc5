"""Water between a surface and a camera. Pure functions on arrays, of use to drown any image whose depth is known.

Image formation after Akkaynak and Treibitz (2018), per colour channel, with z the range along the ray in m and J the
light that leaves the surface:

    I = J exp(-attenuation z) + veil (1 - exp(-backscatter z))

Forward scatter is a blur of the first term that grows with z.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros.types import FloatImage, Matrix

#: Downwelling attenuation Kd of Jerlov's water types at about 600, 525 and 475 nm (red, green, blue), 1/m.
DOWNWELLING = {
    "clear": (0.0, 0.0, 0.0),
    "I": (0.235, 0.043, 0.018),
    "IA": (0.240, 0.048, 0.025),
    "IB": (0.245, 0.054, 0.033),
    "II": (0.260, 0.076, 0.062),
    "III": (0.295, 0.116, 0.116),
    "1C": (0.30, 0.13, 0.17),
    "3C": (0.33, 0.20, 0.29),
    "5C": (0.40, 0.31, 0.43),
    "7C": (0.48, 0.49, 0.71),
    "9C": (0.60, 0.78, 1.23),
}
_BEAM = 2.0  # beam attenuation relative to Kd: along a camera's ray, scattered light is lost
_SCATTER = 2.4  # the same for backscatter; it differs from the signal's (Akkaynak and Treibitz)
_VEIL = 0.35  # what endless water sends back of the daylight around it
_REFERENCE = sum(DOWNWELLING["3C"]) / 3
_BLUR_LEVELS = (0.0, 0.5, 1.0, 2.0, 4.0, 8.0)  # px


@dataclass(frozen=True, eq=False)
class Water:
    """A body of water.

    Parameters
    ----------
    attenuation : (3,) float64
        Of light on its way from the surface to the camera, red, green, blue, 1/m.
    backscatter : (3,) float64
        How fast the veil grows, 1/m.
    daylight : (3,) float64
        Share of the surface's daylight that is left at the rig's depth.
    veil : (3,) float64
        What endless water looks like, relative to the daylight at the surface.
    blur_px_m : float
        Standard deviation of the forward scatter's blur for each metre of range, px/m.
    """

    attenuation: Matrix
    backscatter: Matrix
    daylight: Matrix
    veil: Matrix
    blur_px_m: float


def make_water(name: str, *, turbidity: float = 1.0, water_depth_m: float = 5.0, blur_px_m: float = 0.25) -> Water:
    """Water of a Jerlov type.

    Parameters
    ----------
    name : str
        A key of `DOWNWELLING`.
    turbidity : float
        Multiplies attenuation and scattering.
    water_depth_m : float
        Of the rig below the surface.
    blur_px_m : float
        Forward scatter of type 3C; other types in proportion to their mean attenuation.

    Raises
    ------
    ValueError
        An unknown type.
    """
    if name not in DOWNWELLING:
        raise ValueError(f"water: expected one of {', '.join(DOWNWELLING)}, got {name!r}")
    kd = turbidity * np.array(DOWNWELLING[name])
    daylight = np.exp(-kd * water_depth_m)
    veil = _VEIL * daylight if kd.any() else np.zeros(3)
    return Water(_BEAM * kd, _SCATTER * kd, daylight, veil, float(blur_px_m * kd.mean() / _REFERENCE))


def attenuate(radiance: FloatImage, ranges: FloatImage, water: Water) -> FloatImage:
    """The direct signal, J exp(-attenuation z); nothing from where nothing is (range infinite or NaN)."""
    reach = np.where(np.isfinite(ranges), ranges, np.float32(np.inf)).astype(np.float32)
    with np.errstate(invalid="ignore"):
        left = np.exp(-reach[..., None] * water.attenuation.astype(np.float32))
    direct: FloatImage = np.where(np.isfinite(ranges)[..., None], radiance * left, np.float32(0)).astype(np.float32)
    return direct


def daylight_veil(ranges: FloatImage, water: Water, daylight: float) -> FloatImage:
    """Daylight scattered into the ray, veil (1 - exp(-backscatter z)); the full veil where nothing is met."""
    reach = np.nan_to_num(np.asarray(ranges, np.float32), nan=1e6, posinf=1e6)
    grown = -np.expm1(-reach[..., None] * water.backscatter.astype(np.float32))
    veil: FloatImage = (np.float32(daylight) * water.veil.astype(np.float32)) * grown
    return veil


def forward_scatter(direct: FloatImage, ranges: FloatImage, water: Water) -> FloatImage:
    """Blur each pixel with a Gaussian whose width grows with its range.

    Between a few evenly blurred copies the result is interpolated, so that sharp stays sharp nearby.

    Parameters
    ----------
    direct : (H, W, 3) float32
    ranges : (H, W) float32
        m; infinite or NaN is blurred most.
    water : Water
    """
    if water.blur_px_m <= 0:
        return direct
    sigma = np.nan_to_num(np.asarray(ranges, np.float32) * np.float32(water.blur_px_m), nan=8.0, posinf=8.0)
    level = np.interp(sigma, _BLUR_LEVELS, np.arange(len(_BLUR_LEVELS))).astype(np.float32)
    blurred = np.zeros_like(direct)
    for index, width in enumerate(_BLUR_LEVELS):
        share = np.clip(1.0 - np.abs(level - index), 0.0, 1.0)
        if share.any():
            copy = cv2.GaussianBlur(direct, (0, 0), width, borderType=cv2.BORDER_REFLECT) if width else direct
            blurred += share[..., None] * copy
    return blurred
