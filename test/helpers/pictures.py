"""Pictures of known content: discs that hide each other (statistics of natural images), regular textures, water."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

Image = NDArray[Any]
DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"


def leaves(height: int, width: int, seed: int = 0, count: int = 400) -> Image:
    """Gray discs of all sizes, the later ones in front, with a little grain: (H, W) float32 in [0, 1]."""
    rng = np.random.default_rng(seed)
    image = np.full((height, width), 0.5, np.float32)
    for _ in range(count):
        centre = rng.integers(0, width), rng.integers(0, height)
        radius = int(min(height, width) / 4 * rng.uniform(0.08, 1.0) ** 2) + 1
        cv2.circle(image, (int(centre[0]), int(centre[1])), radius, float(rng.uniform(0.1, 0.9)), -1, cv2.LINE_8)
    image = cv2.GaussianBlur(image, (0, 0), 0.7) + rng.normal(0, 0.004, image.shape).astype(np.float32)
    return np.clip(image, 0, 1).astype(np.float32)


def colored_leaves(height: int, width: int, seed: int = 0) -> Image:
    """RGB discs under a blue-green cast: (H, W, 3) float32 in [0, 1]."""
    planes = [leaves(height, width, seed) for _ in range(3)]
    tint = leaves(height, width, seed + 1)
    red, green, blue = 0.35 * planes[0] * tint, 0.9 * planes[1], 0.85 * planes[2] * (0.6 + 0.4 * tint)
    return np.stack([red, green, blue], axis=2)


def wave(height: int, width: int, frequency: tuple[float, float], amplitude: float) -> Image:
    """A sinusoid, frequency along v and u in cycles / px."""
    v, u = np.mgrid[:height, :width]
    return (amplitude * np.cos(2 * np.pi * (frequency[0] * v + frequency[1] * u) + 0.7)).astype(np.float32)


def psnr(image: Image, truth: Image) -> float:
    """dB, for a range of 1."""
    return float(-10 * np.log10(np.mean(np.square(image.astype(np.float64) - truth))))


def real_images() -> list[Path]:
    """Photographs kept beside the project, or none."""
    return sorted([*DATA.glob("stereo/*/left.png"), *DATA.glob("underwater/*/left.*")])


def need_data() -> None:
    if not real_images():
        pytest.skip(f"no photographs in {DATA}")


def to_bytes(image: Image, peak: int = 255) -> Image:
    """[0, 1] to uint8, or to uint16 with another peak."""
    return np.round(np.clip(image, 0, 1) * peak).astype(np.uint8 if peak == 255 else np.uint16)
