"""Step 1: find single waves that run through the whole image, and take them away.

Moire and electrical interference make peaks one spectral bin wide. A fence, a net, a chequerboard or sand ripples bend,
end, or have harmonics: then the image is left as it is, for what repeats is the picture.

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
    for frequency in frequencies:
        planes = np.atleast_3d(checked)
        without = [planes[..., k] - _wave(planes[..., k], frequency) for k in range(planes.shape[2])]
        checked = np.stack(without, axis=-1).reshape(checked.shape)
    return checked


def _wave(plane: FloatArray, frequency: NDArray[np.float64]) -> FloatArray:
    """The part of an image that is a wave of slowly changing amplitude."""
    modes_v, modes_u = _modes(plane.shape, frequency)
    amplitude = _amplitude(plane, modes_v, modes_u).astype(_complex(plane.dtype))
    back_v, back_u = (modes.conj().astype(_complex(plane.dtype)) for modes in (modes_v, modes_u))
    wave: FloatArray = 2 * (back_v.T @ (amplitude @ back_u)).real
    return wave


def _amplitude(plane: FloatArray, modes_v: NDArray[Any], modes_u: NDArray[Any]) -> NDArray[np.complex128]:
    """Complex amplitude of the wave in cosine modes, by least squares.

    The projections c of the image on the modes hold the wave's own amplitude a and, where the negative frequency is
    near, some of its conjugate: c = a + G conj(a).
    """
    rows_v = modes_v.astype(_complex(plane.dtype))
    centred = plane - plane.mean()
    projected = ((rows_v.real @ centred + 1j * (rows_v.imag @ centred)) @ modes_u.T).ravel()
    mixing = np.kron(modes_v @ modes_v.T, modes_u @ modes_u.T)
    identity = np.eye(projected.size)
    system = np.block([[identity + mixing.real, mixing.imag], [mixing.imag, identity - mixing.real]])
    solution = np.linalg.lstsq(system, np.concatenate([projected.real, projected.imag]), rcond=1e-6)[0]
    real, imaginary = solution.reshape(2, len(modes_v), len(modes_u))
    amplitude: NDArray[np.complex128] = real + 1j * imaginary
    return amplitude


def _runs_through(image: FloatArray, frequency: NDArray[np.float64]) -> bool:
    """Whether a wave has much the same amplitude and phase all over the image."""
    power = np.square(np.abs(_amplitude(image, *_modes(image.shape, frequency))))
    return bool(power[0, 0] > _EVEN_SHARE * power.sum())


def _modes(shape: tuple[int, ...], frequency: NDArray[np.float64]) -> list[NDArray[np.complex128]]:
    """Orthonormal slow cosines along each axis, times the wave's conjugate."""
    modes = []
    for size, part in zip(shape, frequency, strict=True):
        x = np.arange(size) + 0.5
        order = np.arange(min(_NOTCH_MODES, size))
        norm = np.sqrt(np.where(order > 0, 2.0, 1.0) / size)
        cosines = norm[:, None] * np.cos(np.pi / size * np.outer(order, x))
        modes.append(cosines * np.exp(-2j * np.pi * part * x))
    return modes


def _complex(dtype: np.dtype[Any]) -> type[np.complexfloating[Any]]:
    return np.complex64 if dtype == np.float32 else np.complex128
