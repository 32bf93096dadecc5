"""Step 1: find single waves that run through the whole image, and take them away.

Moire and electrical interference make peaks one spectral bin wide. A fence, a net, a chequerboard or sand ripples bend,
end, or have harmonics: then the image is left as it is, for what repeats is the picture.

References
----------
.. [1] D. N. Sidorov and A. C. Kokaram, "Suppression of moire patterns via spectral analysis", VCIP 2002, SPIE 4671.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number
from uw_recon_ros.preprocess.color import luminance
from uw_recon_ros.preprocess.spectrum import Spectrum, level_db

Frequencies = NDArray[np.float64]  # (N, 2): along v and u, cycles / px

_SMALLEST = 32  # px: below it a spectrum has too few bins to tell a peak from the picture
_EVEN_SHARE = 0.5  # of a wave's power that does not change over the image
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
    peaks = spectrum.peaks(prominence_db, min_frequency)
    if any(spectrum.has_harmonics(*peak) for peak in peaks):
        return np.zeros((0, 2))
    waves = [wave for wave in (spectrum.refined(*peak) for peak in peaks) if _runs_through(image, np.array(wave))]
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
    if len(frequencies) == 0:
        return checked
    planes = list(cv2.split(checked))
    for frequency in frequencies:
        wave = _Wave(checked.shape[:2], frequency)
        planes = [plane - wave.part_of(plane) for plane in planes]
    without: FloatArray = cv2.merge(planes)
    return without


def _runs_through(image: FloatArray, frequency: NDArray[np.float64]) -> bool:
    """Whether a wave has much the same amplitude and phase all over the image."""
    power = np.square(np.abs(_Wave(image.shape, frequency).amplitude(image)))
    return bool(power[0, 0] > _EVEN_SHARE * power.sum())


class _Wave:
    """A wave of one frequency whose complex amplitude is a sum of slow cosine modes."""

    def __init__(self, shape: tuple[int, ...], frequency: NDArray[np.float64]) -> None:
        self.modes_v, self.modes_u = (_modes(size, float(part)) for size, part in zip(shape, frequency, strict=True))
        mixing = np.kron(self.modes_v @ self.modes_v.T, self.modes_u @ self.modes_u.T)
        identity = np.eye(len(mixing))
        system = np.block([[identity + mixing.real, mixing.imag], [mixing.imag, identity - mixing.real]])
        self.solution = np.linalg.pinv(system, rcond=1e-6)

    def amplitude(self, plane: FloatArray) -> NDArray[np.complex128]:
        """Amplitude in modes along v and u, by least squares.

        The projections c of the image on the modes hold the wave's own amplitude a and, where the negative frequency is
        near, some of its conjugate: c = a + G conj(a).
        """
        real, imaginary = np.split(_stacked(self.modes_v, plane.dtype) @ (plane - plane.mean()), 2)
        projected = ((real + 1j * imaginary) @ self.modes_u.T).ravel()
        solved = self.solution @ np.concatenate([projected.real, projected.imag])
        real, imaginary = solved.reshape(2, len(self.modes_v), len(self.modes_u))
        amplitude: NDArray[np.complex128] = real + 1j * imaginary
        return amplitude

    def part_of(self, plane: FloatArray) -> FloatArray:
        """The wave that is in an image."""
        along_u = self.amplitude(plane) @ self.modes_u.conj()
        # the real part of the product of two complex matrices, as one product of real ones
        part: FloatArray = _stacked(2 * self.modes_v, plane.dtype).T @ _stacked(along_u, plane.dtype)
        return part


def _stacked(complex_rows: NDArray[np.complex128], dtype: np.dtype[Any]) -> FloatArray:
    return np.concatenate([complex_rows.real, complex_rows.imag]).astype(dtype)


def _modes(size: int, frequency: float) -> NDArray[np.complex128]:
    """Orthonormal slow cosines, times the wave's conjugate: a row each."""
    x = np.arange(size) + 0.5
    order = np.arange(min(_NOTCH_MODES, size))
    norm = np.sqrt(np.where(order > 0, 2.0, 1.0) / size)
    cosines = norm[:, None] * np.cos(np.pi / size * np.outer(order, x))
    modes: NDArray[np.complex128] = cosines * np.exp(-2j * np.pi * frequency * x)
    return modes
