"""Which neighbours a pixel's cost is averaged over: a cross that stops at edges (Zhang, Lu and Lafruit, 2009)."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.gray import local_contrast
from uw_recon_ros.types import ByteImage, FloatImage

REACH = 9  #: longest arm, px
CERTAIN = 2  #: arms are at least this long, px: a lone pixel says too little
NEAR, FAR = 20, 8  #: colour difference that ends an arm, in its nearer and its farther half, gray levels
EDGE_SCALE = 20.0  #: summed colour difference that divides the smoothness by e, gray levels
LEAST_CONTRAST = 10.0  #: median local contrast that edges are judged at, gray levels
EDGE_SMOOTHING = 1.0  #: standard deviation of the smoothing where noise is strong, px
LEAST_SMOOTHNESS = 0.01  #: what is left of it across the strongest edge

Arms = NDArray[np.uint8]


@kernel
def measure_arms(image: ByteImage, first: int, last: int, arms: Arms) -> None:
    """Write the arms to the left, right, upwards and downwards, (4, H, W), of an (H, W, C) image, px.

    Rows `first` to `last`.
    """
    height, width, channels = image.shape
    for v in range(first, last):
        for u in range(width):
            for side in range(4):
                du = (-1, 1, 0, 0)[side]
                dv = (0, 0, -1, 1)[side]
                length = 0
                for n in range(1, REACH + 1):
                    y, x = v + n * dv, u + n * du
                    if y < 0 or y >= height or x < 0 or x >= width:
                        break
                    if n > CERTAIN:
                        apart, step = 0, 0
                        for c in range(channels):
                            apart = max(apart, abs(int(image[y, x, c]) - int(image[v, u, c])))
                            step = max(step, abs(int(image[y, x, c]) - int(image[y - dv, x - du, c])))
                        if apart > (NEAR if n <= REACH // 2 else FAR) or step > NEAR:
                            break
                    length = n
                arms[side, v, u] = length


@kernel
def inverse_size(arms: Arms, inverse: FloatImage) -> None:
    """Write one over the number of pixels of each cross: the rows of all pixels on its vertical arms."""
    height, width = inverse.shape
    below = np.zeros(height + 1, np.int32)
    for u in range(width):
        for v in range(height):
            below[v + 1] = below[v] + np.int32(arms[0, v, u]) + np.int32(arms[1, v, u]) + 1
        for v in range(height):
            count = below[v + np.int32(arms[3, v, u]) + 1] - below[v - np.int32(arms[2, v, u])]
            inverse[v, u] = np.float32(1.0) / np.float32(count)


def edge_weights(image: ByteImage, noise: float) -> FloatImage:
    """Smoothness towards the neighbours right, lower right, below and lower left, (4, H, W), of an (H, W, C) image.

    1 in even regions, less across edges, diagonals by their length; 0 where there is no neighbour. Where water has
    taken the contrast, it is raised to `LEAST_CONTRAST` first, so that edges remain edges; and with `noise` (of
    `gray.gray_pair`) the image is smoothed, and steps that are usual in it are none.
    """
    colors = _even_out(image, noise)
    scale = EDGE_SCALE * image.shape[2] / 3
    weights = np.zeros((4, *image.shape[:2]), np.float32)

    def step(a: FloatImage, b: FloatImage) -> FloatImage:
        return np.asarray(np.abs(a - b).sum(axis=2))

    along = step(colors[:, 1:], colors[:, :-1])
    usual = np.float32(noise * np.median(along)) if along.size else np.float32(0)

    def across(steps: FloatImage) -> FloatImage:
        likeness: FloatImage = np.exp(np.maximum(steps - usual, 0) * np.float32(-1 / scale))
        return np.asarray(np.maximum(likeness, np.float32(LEAST_SMOOTHNESS)))

    weights[0, :, :-1] = across(along)
    weights[1, :-1, :-1] = across(step(colors[1:, 1:], colors[:-1, :-1])) * np.float32(0.7)
    weights[2, :-1] = across(step(colors[1:], colors[:-1]))
    weights[3, :-1, 1:] = across(step(colors[1:, :-1], colors[:-1, 1:])) * np.float32(0.7)
    return weights


def _even_out(image: ByteImage, noise: float) -> FloatImage:
    """The image, smoothed by its noise and of no less than a usual contrast, (H, W, C)."""
    colors = image.astype(np.float32)
    if noise * EDGE_SMOOTHING > 0.1:
        colors = np.asarray(cv2.GaussianBlur(colors, (0, 0), noise * EDGE_SMOOTHING), np.float32).reshape(image.shape)
    contrast = local_contrast(np.asarray(colors.mean(axis=2)))
    return np.asarray(colors * np.float32(max(1.0, LEAST_CONTRAST / max(contrast, 1.0))))
