"""What others do to make an underwater picture pleasant, written from their papers: to be beaten.

Gray world with CLAHE is what most tools do. Multi-scale fusion is Ancuti, Ancuti, De Vleeschouwer and Bekaert, "Color
Balance and Fusion for Underwater Image Enhancement", IEEE TIP 27 (2018) 379-393: red filled from green, gray world,
then a gamma-darkened and a sharpened version blended by contrast, saliency and saturation over pyramids.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

Byte = NDArray[np.uint8]
Float = NDArray[np.float32]


def gray_world_clahe(image: Byte) -> Byte:
    """Means of the channels made equal, then CLAHE (clip 2, 8 x 8 tiles) on Lab's L."""
    unit = image.astype(np.float32) / 255
    means = np.maximum(unit.mean(axis=(0, 1)), 1e-3)
    balanced = _bytes(unit * (means.mean() / means).astype(np.float32))
    lab = cv2.cvtColor(balanced, cv2.COLOR_RGB2LAB)
    lab[..., 0] = cv2.createCLAHE(2.0, (8, 8)).apply(lab[..., 0])
    return cv2.cvtColor(lab, cv2.COLOR_LAB2RGB)


def multi_scale_fusion(image: Byte) -> Byte:
    """Ancuti et al. (2018)."""
    balanced = _white_balanced(image.astype(np.float32) / 255)
    dark = np.power(balanced, np.float32(2.0))
    inputs = [dark, _sharpened(balanced)]
    weights = np.stack([_weight(version) for version in inputs])
    weights = (weights + 0.1) / (weights + 0.1).sum(axis=0)
    return _bytes(_blended(inputs, weights, levels=5))


def _white_balanced(unit: Float) -> Float:
    """Red, and blue where it is weaker, filled from green in proportion to what it lacks; then gray world."""
    red, green, blue = cv2.split(unit)
    filled = red + (green.mean() - red.mean()) * (1 - red) * green
    if blue.mean() < green.mean():
        blue = blue + (green.mean() - blue.mean()) * (1 - blue) * green
    merged = np.clip(cv2.merge([filled, green, blue]), 0, 1)
    means = merged.mean(axis=(0, 1))
    return np.clip(merged * (means.mean() / np.maximum(means, 1e-3)), 0, 1).astype(np.float32)


def _sharpened(unit: Float) -> Float:
    """The paper's normalised unsharp mask: the mean of the picture and its stretched detail."""
    detail = unit - cv2.GaussianBlur(unit, (0, 0), 2.0)
    low, high = float(detail.min()), float(detail.max())
    return np.clip(0.5 * (unit + (detail - low) / max(high - low, 1e-6)), 0, 1).astype(np.float32)


def _weight(unit: Float) -> Float:
    lightness = cv2.cvtColor(unit, cv2.COLOR_RGB2GRAY)
    contrast = np.abs(cv2.Laplacian(lightness, cv2.CV_32F, ksize=3))
    lab = cv2.cvtColor(unit, cv2.COLOR_RGB2LAB) / np.float32(100)
    saliency = np.linalg.norm(cv2.GaussianBlur(lab, (0, 0), 1.0) - lab.mean(axis=(0, 1)), axis=2)
    saturation = np.sqrt(np.mean(np.square(unit - lightness[..., None]), axis=2))
    return np.asarray(contrast + saliency + saturation, np.float32)


def _blended(inputs: list[Float], weights: Float, levels: int) -> Float:
    total: list[Float] = []
    for version, weight in zip(inputs, weights, strict=True):
        bands, gaussian = [], version
        for _ in range(levels):
            smaller = cv2.pyrDown(gaussian)
            bands.append(gaussian - cv2.pyrUp(smaller, dstsize=gaussian.shape[1::-1]))
            gaussian = smaller
        bands.append(gaussian)
        for level, band in enumerate(bands):
            part = band * weight[..., None]
            total[level : level + 1] = [total[level] + part] if level < len(total) else [part]
            weight = cv2.pyrDown(weight)
    picture = total[-1]
    for band in reversed(total[:-1]):
        picture = cv2.pyrUp(picture, dstsize=band.shape[1::-1]) + band
    return picture


def _bytes(unit: Float) -> Byte:
    return (np.clip(unit, 0, 1) * 255 + 0.5).astype(np.uint8)
