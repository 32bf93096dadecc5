"""One level of a wavelet transform of an image that wraps around.

The Farras wavelet, fast enough for live images, or any orthogonal or biorthogonal one of PyWavelets.

The Farras filters are taken in polyphase form: samples of even and odd place go through filters of half the length,
which OpenCV vectorises, several times faster than ``pywt.dwt2(mode="periodization")``, whose coefficients these are.

References
----------
.. [1] A. F. Abdelnour and I. W. Selesnick, "Nearly symmetric orthogonal wavelet bases", ICASSP 2001.
"""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pywt

from uw_recon_ros.preprocess.arrays import FloatArray

_A, _B, _C = 0.08838834764832, 0.695879989034, 0.01122679215254
_LOW = (0.0, 0.0, -_A, _A, _B, _B, _A, -_A, _C, _C)
_HIGH = (-_C, _C, _A, _A, -_B, _B, -_A, -_A, 0.0, 0.0)
FARRAS = "farras"
#: Names that a wavelet may have: ours, and the orthogonal and biorthogonal ones of PyWavelets. Not dmey: its filters
#: are cut short, so that it does not give an image back exactly.
WAVELETS = (FARRAS, *(name for name in pywt.wavelist(kind="discrete") if name != "dmey"))

_REACH = 2  # samples of one phase on either side: ten taps are five a phase
_LOW_PHASES = np.array(_LOW[1::2]), np.array(_LOW[0::2])  # what even and odd samples are weighed with
_HIGH_PHASES = np.array(_HIGH[1::2]), np.array(_HIGH[0::2])

Phases = tuple[FloatArray, FloatArray]  # samples of even and of odd place
Bands = tuple[FloatArray, FloatArray, FloatArray]  # detail along v, along u, along both


@cache
def named_wavelet(name: str) -> pywt.Wavelet:
    """The filters of a wavelet, as PyWavelets holds them.

    Raises
    ------
    ValueError
        Nobody knows the name.
    """
    if name == FARRAS:
        return pywt.Wavelet(FARRAS, filter_bank=(_LOW, _HIGH, _LOW[::-1], _HIGH[::-1]))
    if name not in WAVELETS:
        raise ValueError(
            f"wavelet: expected {FARRAS} or one of PyWavelets (db4, sym8, coif2, bior4.4, ...), got {name!r}"
        )
    return pywt.Wavelet(name)


@cache
def noise_gains(name: str, levels: int) -> tuple[tuple[float, float, float], ...]:
    """Standard deviations of the details of white noise of standard deviation 1, finest level first.

    All 1 for an orthogonal wavelet; else the norms of the filters, those of coarser levels run through all finer ones.

    Returns
    -------
    tuple of (float, float, float)
        A level each: detail along v, along u, along both.
    """
    wavelet = named_wavelet(name)
    if name == FARRAS or wavelet.orthogonal:
        return ((1.0, 1.0, 1.0),) * levels
    gains, through = [], np.ones(1)
    for level in range(levels):
        low, high = (np.convolve(through, _spread(taps, 1 << level)) for taps in (wavelet.dec_lo, wavelet.dec_hi))
        smooth, detail = float(np.linalg.norm(low)), float(np.linalg.norm(high))
        gains.append((smooth * detail, smooth * detail, detail * detail))
        through = low
    return tuple(gains)


def _spread(taps: list[float], step: int) -> FloatArray:
    """Taps with zeros between them."""
    spread = np.zeros((len(taps) - 1) * step + 1)
    spread[::step] = taps
    return spread


def analyse(image: FloatArray, wavelet: str = FARRAS) -> tuple[FloatArray, Bands]:
    """Low-pass image and details, each of half the size.

    Parameters
    ----------
    image : (H, W) float32 or float64
        Both sizes even; wraps around.
    wavelet : str
        One of `WAVELETS`.

    Returns
    -------
    lowpass : (H / 2, W / 2) array
    bands : three arrays of that shape
        Detail along v, along u, along both: as ``pywt.dwt2``.
    """
    if wavelet != FARRAS:
        lowpass, bands = pywt.dwt2(image, named_wavelet(wavelet), mode="periodization")
        return lowpass, bands
    low, high = _split(image, axis=1)
    low_low, detail_v = _split(low, axis=0)
    detail_u, detail_both = _split(high, axis=0)
    return low_low, (detail_v, detail_u, detail_both)


def diagonal_detail(image: FloatArray) -> FloatArray:
    """Detail along both of `analyse`, by the Farras wavelet, without the rest."""
    phases = _phases(_wrapped(image, 2 * _REACH, 1), 1)
    high = _sum_of_phases(phases, _HIGH_PHASES, 1)
    return _sum_of_phases(_phases(_wrapped(high, 2 * _REACH, 0), 0), _HIGH_PHASES, 0)


def synthesise(lowpass: FloatArray, bands: Bands, wavelet: str = FARRAS) -> FloatArray:
    """The image again: the inverse of `analyse`, for an orthogonal wavelet its transpose."""
    if wavelet != FARRAS:
        image: FloatArray = pywt.idwt2((lowpass, bands), named_wavelet(wavelet), mode="periodization")
        return image
    detail_v, detail_u, detail_both = bands
    return _join(_join(lowpass, detail_v, axis=0), _join(detail_u, detail_both, axis=0), axis=1)


def _split(image: FloatArray, axis: int) -> tuple[FloatArray, FloatArray]:
    phases = _phases(_wrapped(image, 2 * _REACH, axis), axis)
    return _sum_of_phases(phases, _LOW_PHASES, axis), _sum_of_phases(phases, _HIGH_PHASES, axis)


def _sum_of_phases(phases: Phases, taps: Phases, axis: int) -> FloatArray:
    total = _filtered(phases[0], taps[0][::-1], axis)
    return cv2.add(total, _filtered(phases[1], taps[1][::-1], axis))


def _join(low: FloatArray, high: FloatArray, axis: int) -> FloatArray:
    low, high = (_wrapped(band, _REACH, axis) for band in (low, high))
    even, odd = (
        cv2.add(_filtered(low, low_taps, axis), _filtered(high, high_taps, axis))
        for low_taps, high_taps in zip(_LOW_PHASES, _HIGH_PHASES, strict=True)
    )
    return _interleaved(even, odd, axis)


def _wrapped(image: FloatArray, count: int, axis: int) -> FloatArray:
    v, u = (count, 0) if axis == 0 else (0, count)
    padded: FloatArray = cv2.copyMakeBorder(image, v, v, u, u, cv2.BORDER_WRAP)
    return padded


def _phases(image: FloatArray, axis: int) -> Phases:
    if axis == 0:
        return image[0::2], image[1::2]
    even, odd = cv2.split(image.reshape(image.shape[0], -1, 2))
    return even, odd


def _interleaved(even: FloatArray, odd: FloatArray, axis: int) -> FloatArray:
    height, width = even.shape
    if axis == 0:
        joined: FloatArray = np.empty((2 * height, width), even.dtype)
        joined[0::2], joined[1::2] = even, odd
        return joined
    joined = cv2.merge([even, odd])
    return joined.reshape(height, 2 * width)


def _filtered(image: FloatArray, taps: FloatArray, axis: int) -> FloatArray:
    """Correlate along an axis, where the taps lie wholly inside."""
    kernel = taps[:, None] if axis == 0 else taps[None]
    filtered: FloatArray = cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REPLICATE)
    return filtered[_REACH:-_REACH] if axis == 0 else filtered[:, _REACH:-_REACH]
