"""What spoils pictures on their way through port, sensor and recorder."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.simulate.params import DEAD_CHANNELS, SimulateParams
from uw_recon_ros.types import FloatImage, RawImage

_SPOTS, _SCRATCHES = 40, 6
_SPOT_PX, _SOFT_PX = (0.006, 0.03), 0.003  # of the width
_HAZE = 0.4  # of the picture's mean light that dirt sends out


def port_pattern(shape: tuple[int, int], seed: int, camera: int) -> FloatImage:
    """Opacity of spots and scratches, (H, W) float32, 0 to 1; out of focus, for the port is near."""
    rng = np.random.default_rng([seed, 10, camera])
    height, width = shape
    dirt = np.zeros(shape, np.float32)
    for _ in range(_SPOTS):
        radius = max(round(width * rng.uniform(*_SPOT_PX)), 1)
        place = int(rng.integers(width)), int(rng.integers(height))
        cv2.circle(dirt, place, radius, float(rng.uniform(0.3, 1.0)), -1)
    for _ in range(_SCRATCHES):
        begin, end = ((int(rng.integers(width)), int(rng.integers(height))) for _ in range(2))
        cv2.line(dirt, begin, end, float(rng.uniform(0.2, 0.6)), 1)
    return np.asarray(cv2.GaussianBlur(dirt, (0, 0), max(_SOFT_PX * width, 0.8)), np.float32)


def through_port(light: FloatImage, pattern: FloatImage, strength: float) -> FloatImage:
    """What a dirty port leaves of the light (H, W, 3), and what the dirt itself sends out."""
    lost = (np.float32(strength) * pattern)[..., None]
    return np.asarray(light * (1 - lost) + np.float32(_HAZE) * lost * light.mean(axis=(0, 1)), np.float32)


def recorded(image: RawImage, params: SimulateParams) -> RawImage:
    """The picture without its dead channel, and with black bars above and below."""
    image = image.copy()
    dead = DEAD_CHANNELS.index(params.dead_channel) - 1
    if dead >= 0 and image.ndim == 3:
        image[..., dead] = 0
    bar = round(params.letterbox_share * image.shape[0])
    if bar:
        image[:bar] = image[-bar:] = 0
    return image
