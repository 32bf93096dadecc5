"""Step 5: bivariate shrinkage of wavelet coefficients (eq. 6-8), with any wavelet of `filterbank`.

References
----------
.. [1] L. Sendur and I. W. Selesnick, "Bivariate shrinkage with local variance estimation", IEEE Signal Processing
   Letters 9 (2002) 438-441.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros.medians import median
from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number
from uw_recon_ros.preprocess.filterbank import FARRAS, Bands, analyse, noise_gains, synthesise


@dataclass(frozen=True, eq=False)
class Pyramid:
    """A wavelet decomposition.

    Parameters
    ----------
    lowpass : (H / 2^L, W / 2^L) array
    bands : tuple of L `Bands`
        Details, finest level first; each array half the size of its predecessor. Scaled so that white noise has the
        standard deviation it has in the image.
    wavelet : str
        Its name, see `filterbank.WAVELETS`.
    """

    lowpass: FloatArray
    bands: tuple[Bands, ...]
    wavelet: str = FARRAS


def decompose(image: FloatArray, levels: int, wavelet: str = FARRAS) -> Pyramid:
    """Decompose an image that wraps around.

    Parameters
    ----------
    image : (H, W) float32 or float64
        Both sizes divisible by ``2^levels``.
    levels : int
        At least 1.
    wavelet : str
        One of `filterbank.WAVELETS`.

    Returns
    -------
    Pyramid
        Of the image's dtype.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; sizes that cannot be halved that often.
    """
    lowpass = checked_float("image", image)
    if levels < 1 or any(size % (1 << levels) for size in lowpass.shape):
        raise ValueError(f"image: expected sizes divisible by 2^{levels}, levels >= 1, got shape {lowpass.shape}")
    bands: list[Bands] = []
    for gains in noise_gains(wavelet, levels):
        lowpass, details = analyse(lowpass, wavelet)
        bands.append(_scaled(details, [1 / gain for gain in gains]))
    return Pyramid(lowpass, tuple(bands), wavelet)


def _scaled(bands: Bands, factors: Sequence[float]) -> Bands:
    along_v, along_u, along_both = (
        band if factor == 1 else band * band.dtype.type(factor) for band, factor in zip(bands, factors, strict=True)
    )
    return along_v, along_u, along_both


def reconstruct(pyramid: Pyramid) -> FloatArray:
    """Recompose the image, exactly: the inverse of `decompose`."""
    image = pyramid.lowpass
    gains = noise_gains(pyramid.wavelet, len(pyramid.bands))
    for details, gain in zip(reversed(pyramid.bands), reversed(gains), strict=True):
        image = synthesise(image, _scaled(details, gain), pyramid.wavelet)
    return image


def noise_sigma(pyramids: Sequence[Pyramid]) -> float:
    """Standard deviation of white noise, ``median(|HH1|) / 0.6745`` (paper, eq. 6, misprint mended).

    Parameters
    ----------
    pyramids : sequence of Pyramid
        One image, or both cameras, whose coefficients are then taken together.

    Returns
    -------
    float
        In the image's unit.
    """
    return sigma_of_details([pyramid.bands[0][2] for pyramid in pyramids])


def sigma_of_details(finest: Sequence[FloatArray]) -> float:
    """Standard deviation of white noise of which these are the finest details along both axes (paper, eq. 6)."""
    sizes = np.concatenate([band.ravel() for band in finest])
    return median(np.abs(sizes, out=sizes)) / 0.6745


def shrink(pyramid: Pyramid, sigma: float, *, window: int = 7) -> Pyramid:
    """Shrink each detail coefficient given its parent's and its neighbours' size (paper, eq. 7-8).

    Parameters
    ----------
    pyramid : Pyramid
        At least two levels; the coarsest one is only parent, and left as it is.
    sigma : float
        Standard deviation of the noise, image's unit.
    window : int
        Odd side of the neighbourhood N(k), coefficients.

    Returns
    -------
    Pyramid
        New arrays where something changed.
    """
    checked_number("sigma", sigma, 0.0, np.inf)
    if window < 1 or window % 2 == 0:
        raise ValueError(f"window: expected an odd number >= 1, got {window}")
    if sigma == 0:
        return pyramid
    levels = [
        tuple(_shrink_band(child, parent, sigma, window) for child, parent in zip(children, parents, strict=True))
        for children, parents in zip(pyramid.bands, pyramid.bands[1:], strict=False)
    ]
    bands = (*levels, pyramid.bands[-1])
    return Pyramid(pyramid.lowpass, bands, pyramid.wavelet)  # type: ignore[arg-type]


def _shrink_band(child: FloatArray, parent: FloatArray, sigma: float, window: int) -> FloatArray:
    variance = child.dtype.type(sigma * sigma)
    power = cv2.multiply(child, child)
    signal: FloatArray = cv2.blur(power, (window, window), borderType=cv2.BORDER_REFLECT)
    none = np.sqrt(np.finfo(child.dtype).tiny)  # a signal of zero, that can be divided by
    np.maximum(np.subtract(signal, variance, out=signal), none, out=signal)  # eq. 7, squared
    parents = cv2.resize(cv2.multiply(parent, parent), child.shape[::-1], interpolation=cv2.INTER_NEAREST)
    signal *= cv2.add(power, parents, dst=power)
    kept: FloatArray = np.maximum(np.sqrt(signal, out=signal), none, out=signal)
    np.divide(child.dtype.type(-np.sqrt(3.0)) * variance, kept, out=kept)  # eq. 8
    kept += 1
    np.maximum(kept, 0, out=kept)
    kept *= child
    return kept


def wavelet_denoise(luminance: FloatArray, levels: int = 4, sigma: float | None = None) -> FloatArray:
    """Remove white noise from an image that wraps around (paper, step 5).

    Parameters
    ----------
    luminance : (H, W) float32 or float64
        Both sizes divisible by ``2^(levels + 1)``.
    levels : int
        Levels to shrink.
    sigma : float or None
        Standard deviation of the noise, image's unit; None: estimated from the image.

    Returns
    -------
    (H, W), same dtype

    Raises
    ------
    TypeError, ValueError
        As `decompose` and `shrink`.
    """
    pyramid = decompose(luminance, levels + 1)
    return reconstruct(shrink(pyramid, noise_sigma([pyramid]) if sigma is None else sigma))
