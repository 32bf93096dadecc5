"""Where a spectrum has peaks of one wave each, and what lies around them."""

from __future__ import annotations

import cv2
import numpy as np
import scipy.fft
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray

Mask = NDArray[np.bool_]

_REACH = 12  # bins around a peak that are its surroundings
_CORE = 4  # bins around a peak that belong to it: the main lobe of the Hann window and a slow change of amplitude
_ALONE_DB = 12.0  # above the strongest of its surroundings: a peak, no line and no cluster
_BYPRODUCT_DB = 18.0  # below the strongest peak: what JPEG made of it
_HARMONIC_DB = 15.0  # above the median around it: a harmonic is there
_FAINT_DB = 36.0  # below its wave a harmonic means nothing: JPEG makes such ones


def level_db(image: FloatArray) -> NDArray[np.float32]:
    """Levels of the spectrum of an image under a Hann window, its mean taken off.

    Parameters
    ----------
    image : (H, W) float32 or float64

    Returns
    -------
    (H, W // 2 + 1) float32
        dB, in the order of ``scipy.fft.rfft2``.
    """
    window_v, window_u = (np.hanning(size + 2)[1:-1].astype(image.dtype) for size in image.shape)
    spectrum = scipy.fft.rfft2((image - image.mean()) * window_v[:, None] * window_u)
    power = np.square(spectrum.real) + np.square(spectrum.imag)
    floor = np.finfo(np.float32).tiny + 1e-12 * float(power.max())
    level: NDArray[np.float32] = (10 * np.log10(power + floor)).astype(np.float32)
    return level


class Spectrum:
    """Levels of a half plane of bins, with enough of the other half around it to look at any bin's neighbours.

    Parameters
    ----------
    level : (H, W // 2 + 1) float32
        As from `level_db`.
    shape : (H, W)
        Of the image, px.
    """

    def __init__(self, level: NDArray[np.float32], shape: tuple[int, ...]) -> None:
        self.height, self.width = shape
        self.level = level
        columns = np.arange(-_REACH, level.shape[1] + _REACH) % self.width
        mirrored = columns >= level.shape[1]
        columns = np.where(mirrored, self.width - columns, columns)
        around = _REACH, _REACH, _REACH, _REACH
        self.padded = np.asarray(cv2.copyMakeBorder(level, *around, cv2.BORDER_WRAP), np.float32)
        rows = np.arange(-_REACH, self.height + _REACH)
        self.padded[:, mirrored] = level[np.ix_(-rows % self.height, columns[mirrored])]

    def peaks(self, prominence_db: float, min_frequency: float) -> list[tuple[int, int]]:
        """Bins (v, u) of single waves, strongest first; those far weaker than the first are its by-products."""
        alone = [peak for peak in self.candidates(prominence_db, min_frequency) if self.stands_alone(*peak)]
        return [peak for peak in alone if self.level[peak] > self.level[alone[0]] - _BYPRODUCT_DB]

    def candidates(self, prominence_db: float, min_frequency: float) -> list[tuple[int, int]]:
        """Bins that rise out of the level around them, strongest first."""
        size, core = 2 * _REACH + 1, 2 * _CORE + 1
        inner = (slice(_REACH, -_REACH), slice(_REACH, -_REACH))
        high = self.level - cv2.blur(self.padded, (size, size))[inner] > prominence_db
        if not high.any():
            return []
        high &= cv2.dilate(self.padded, np.ones((core, core), np.uint8))[inner] == self.level
        v, u = np.nonzero(high)
        fast = np.hypot(scipy.fft.fftfreq(self.height)[v], u / self.width) >= min_frequency
        once = (u > 0) & (2 * u < self.width) | (v <= self.height // 2)  # those columns hold each wave twice
        v, u = v[fast & once], u[fast & once]
        order = np.argsort(-self.level[v, u], kind="stable")
        return [(int(v[i]), int(u[i])) for i in order]

    def surroundings(self, v: int, u: int) -> NDArray[np.float32]:
        """Levels around a bin, without those that belong to its wave."""
        near = self.padded[v : v + 2 * _REACH + 1, u : u + 2 * _REACH + 1]
        mirror = _wrapped(-2 * v, self.height), _wrapped(-2 * u, self.width)
        ring: NDArray[np.float32] = near[~(_core_at(0, 0) | _core_at(*mirror))]
        return ring

    def stands_alone(self, v: int, u: int) -> bool:
        """Whether this is a peak: no line, no cluster."""
        return bool(self.level[v, u] > self.surroundings(v, u).max() + _ALONE_DB)

    def has_harmonics(self, v: int, u: int) -> bool:
        """Whether what repeats has a shape other than a sine: a texture, or the blocks of a JPEG."""
        return any(self._is_harmonic(v, u, times) for times in (2, 3))

    def _is_harmonic(self, peak_v: int, peak_u: int, times: int) -> bool:
        v, u = times * peak_v % self.height, times * peak_u % self.width
        if u >= self.level.shape[1]:  # aliased: its mirror image is in the half plane
            v, u = -v % self.height, self.width - u
        taken = ((0, 0), (peak_v, peak_u), (-peak_v, -peak_u))
        if any(self._near(v, u, *other) for other in taken):  # aliased on to the picture or the wave itself
            return False
        near = slice(_REACH - times, _REACH + times + 1)
        found = self.padded[v : v + 2 * _REACH + 1, u : u + 2 * _REACH + 1][near, near].max()
        noise = np.median(self.surroundings(v, u))
        return bool(found > max(noise + _HARMONIC_DB, self.level[peak_v, peak_u] - _FAINT_DB))

    def _near(self, v: int, u: int, other_v: int, other_u: int) -> bool:
        apart = abs(_wrapped(v - other_v, self.height)), abs(_wrapped(u - other_u, self.width))
        return max(apart) <= 2 * _REACH

    def refined(self, v: int, u: int) -> tuple[float, float]:
        """Frequency between the bins, by parabolas through the levels, cycles / px."""
        row, column = v + _REACH, u + _REACH
        along_v = self.padded[row - 1 : row + 2, column]
        along_u = self.padded[row, column - 1 : column + 2]
        return (v + _vertex(along_v)) / self.height, (u + _vertex(along_u)) / self.width


def _wrapped(index: int, size: int) -> int:
    """`index` modulo `size`, in [-size / 2, size / 2)."""
    return (index + size // 2) % size - size // 2


def _core_at(dv: int, du: int) -> Mask:
    offset = np.arange(-_REACH, _REACH + 1)
    return np.maximum(np.abs(offset - dv)[:, None], np.abs(offset - du)) <= _CORE


def _vertex(three: NDArray[np.float32]) -> float:
    below, peak, above = (float(value) for value in three)
    bend = below - 2 * peak + above
    return 0.5 * (below - above) / bend if bend < 0 else 0.0
