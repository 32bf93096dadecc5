"""From light to grey values: lens, gain, noise, gamma, quantisation, and back."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.types import FloatImage, RawImage

GAMMA = 2.2
_ELECTRONS = 5000.0  # at white: a small camera at moderate gain
_READ_NOISE = 0.002  # of white
_WHITE = 0.62  # where the brightest twentieth of the picture begins
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)


def to_light(image: RawImage) -> FloatImage:
    """Linear light, 0 to 1, of an ordinary 8- or 16-bit image; mono becomes three equal channels."""
    full = np.float32(np.iinfo(image.dtype).max)
    light: FloatImage = np.power(image.astype(np.float32) / full, np.float32(GAMMA))
    return light if image.ndim == 3 else np.repeat(light[..., None], 3, axis=2)


def lens_blur(light: FloatImage, sigma_px: float) -> FloatImage:
    """What lens and pixel do to any picture: a Gaussian blur."""
    if sigma_px <= 0:
        return light
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma_px, borderType=cv2.BORDER_REFLECT), np.float32)


def exposure_of(light: FloatImage) -> float:
    """The gain that puts the brightest twentieth of a picture just below white."""
    bright = float(np.percentile(light.max(axis=-1), 95))
    return _WHITE / bright if bright > 0 else 1.0


def expose(
    light: FloatImage, gain: float, rng: np.random.Generator, *, noise: float = 1.0, bits: int = 8, mono: bool = False
) -> RawImage:
    """Take the picture.

    Parameters
    ----------
    light : (H, W, 3) float32
        Linear RGB.
    gain : float
        Light times gain of 1 is white.
    rng : numpy.random.Generator
    noise : float
        Multiplies shot and read noise; 1 is a small camera at moderate gain.
    bits : {8, 16}
    mono : bool

    Returns
    -------
    (H, W, 3) or (H, W) uint8 or uint16
        Gamma 2.2.
    """
    signal = np.float32(gain) * (light @ _LUMA if mono else light)
    if noise > 0:
        variance = np.maximum(signal, np.float32(0)) / np.float32(_ELECTRONS) + np.float32(_READ_NOISE**2)
        signal = signal + np.float32(noise) * np.sqrt(variance) * rng.standard_normal(signal.shape, dtype=np.float32)
    full = 2**bits - 1
    values = np.float32(full) * np.power(np.clip(signal, 0, 1), np.float32(1 / GAMMA)) + np.float32(0.5)
    taken: RawImage = values.astype(np.uint8 if bits == 8 else np.uint16)
    return taken
