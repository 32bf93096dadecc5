"""Step 1: find single waves that run through the whole image, and take them away.

Moire and electrical interference make peaks one spectral bin wide; a fence, a net or sand ripples bend, end or have
harmonics, and are left alone.

References
----------
.. [1] D. N. Sidorov and A. C. Kokaram, "Suppression of moire patterns via spectral analysis", VCIP 2002, SPIE 4671.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number
from uw_recon_ros.preprocess.color import luminance
from uw_recon_ros.preprocess.spectrum import Spectrum, level_db

Frequencies = NDArray[np.float64]  # (N, 2): along v and u, cycles / px

_SMALLEST = 32  # px: below it a spectrum has too few bins to tell a peak from the picture
_NOTCH_MODES = 5  # cosine modes of the wave's amplitude an axis: a notch 5 half cycles per image wide


def find_moire(
    gray: FloatArray, *, prominence_db: float = 25.0, min_frequency: float = 0.05, max_waves: int = 8
) -> Frequencies:
    """Find the waves of a moire pattern (paper, step 1).

    Parameters
    ----------
    gray : (H, W) float32 or float64
    prominence_db : float
        Height of a peak above the mean level around it, dB.
    min_frequency : float
        Slower waves are the picture's own, cycles / px.
    max_waves : int
        The strongest are returned.

    Returns
    -------
    (N, 2) float64
        Frequency along v and u, cycles / px, strongest first; empty for a clean image, and for one under 32 px.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; parameters out of range.
    """
    image = checked_float("gray", gray)
    checked_number("prominence_db", prominence_db, 0.0, np.inf)
    checked_number("min_frequency", min_frequency, 0.0, 0.5)
    checked_number("max_waves", max_waves, 0, np.inf)
    if min(image.shape) < _SMALLEST:
        return np.zeros((0, 2))
    spectrum = Spectrum(level_db(image), image.shape)
    waves = [
        spectrum.refined(v, u)
        for v, u in spectrum.candidates(prominence_db, min_frequency)
        if spectrum.stands_alone(v, u) and not spectrum.has_harmonics(v, u)
    ]
    return np.array(waves[:max_waves]).reshape(-1, 2)


def remove_moire(image: FloatArray, *, prominence_db: float = 25.0) -> FloatArray:
    """Find moire in the luminance and remove it from every channel (paper, step 1).

    Parameters
    ----------
    image : (H, W) or (H, W, 3) float32 or float64
    prominence_db : float
        As of `find_moire`.

    Returns
    -------
    same shape and dtype
        `image` itself where there is none.

    Raises
    ------
    TypeError, ValueError
        As `find_moire`.
    """
    waves = find_moire(luminance(image), prominence_db=prominence_db)
    return remove_waves(image, waves) if len(waves) else image


def remove_waves(image: FloatArray, frequencies: Frequencies) -> FloatArray:
    """Notch narrow bands of frequencies (paper, step 1).

    The amplitude of each wave may change over the image as slowly as five cosine modes an axis can: a rectangular
    notch of the cosine spectrum about the wave's own frequency, without leakage where the wave does not fit the image.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) float32 or float64
    frequencies : (N, 2) float64
        As from `find_moire`.

    Returns
    -------
    same shape and dtype
        `image` itself where there is nothing to remove.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; frequencies of another shape.
    """
    checked = checked_float("image", image, shape="(H, W) or (H, W, 3)")
    if np.ndim(frequencies) != 2 or np.shape(frequencies)[1] != 2:
        raise ValueError(f"frequencies: expected shape (N, 2), got {np.shape(frequencies)}")
    for frequency in frequencies:
        planes = np.atleast_3d(checked)
        without = [planes[..., k] - _wave(planes[..., k], frequency) for k in range(planes.shape[2])]
        checked = np.stack(without, axis=-1).reshape(checked.shape)
    return checked


def _wave(plane: FloatArray, frequency: NDArray[np.float64]) -> FloatArray:
    frequency, pairs = _unpaired(frequency, plane.shape)
    modes_v, modes_u = (
        _modes(size, float(part), plane.dtype) for size, part in zip(plane.shape, frequency, strict=True)
    )
    centred = plane - plane.mean()
    rows = modes_v.real @ centred + 1j * (modes_v.imag @ centred)
    amplitude = rows @ modes_u.T
    wave: FloatArray = pairs * (modes_v.conj().T @ amplitude @ modes_u.conj()).real
    return wave


def _unpaired(frequency: NDArray[np.float64], shape: tuple[int, ...]) -> tuple[NDArray[np.float64], int]:
    """The frequency and how many times it is there: twice, but for multiples of 1/2, which are their own negatives."""
    half = np.round(2 * frequency) / 2
    own = bool(np.all(np.abs(frequency - half) * shape < 1))
    return (half, 1) if own else (frequency, 2)


def _modes(size: int, frequency: float, dtype: Any) -> NDArray[Any]:
    """Orthonormal slow cosines, times the wave's conjugate."""
    x = np.arange(size) + 0.5
    order = np.arange(min(_NOTCH_MODES, size))
    cosines = np.cos(np.pi / size * np.outer(order, x)) * np.sqrt(np.where(order > 0, 2.0, 1.0) / size)[:, None]
    modes = cosines * np.exp(-2j * np.pi * frequency * x)
    narrowed: NDArray[Any] = modes.astype(np.complex64 if dtype == np.float32 else np.complex128)
    return narrowed
