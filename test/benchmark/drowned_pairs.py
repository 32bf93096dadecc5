"""Middlebury pairs under water: real textures and true disparity, through the image formation of a few waters.

Per channel ``I = J E exp(-beta_D z) + B_inf (1 - exp(-beta_B z))`` with beta_D != beta_B, half of the light blurred on
its way, an uneven lamp E beside the left camera, gamma 2.2, sensor noise.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.evaluate import fill_rows

STEREO = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "stereo"
#: Six more, small: low texture, one colour, occlusion at the left border.
THIRDS = STEREO.parent / "stereo_2006"
MEDIAN_DEPTH_M = 2.0
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Water:
    """Coefficients for R, G, B; 1/m, blur in px per m, noise in gray levels of 8 bits."""

    direct: tuple[float, float, float]
    veil: tuple[float, float, float]
    veil_color: tuple[float, float, float]
    blur: float
    noise: float
    gain: float = 1.0
    lamp: bool = False


WATERS = {
    "air": None,
    "clear": Water((0.35, 0.08, 0.06), (0.3, 0.08, 0.07), (0.08, 0.35, 0.42), 0.1, 1.0),
    "hazy": Water((0.7, 0.45, 0.45), (0.8, 0.55, 0.55), (0.12, 0.45, 0.42), 0.35, 1.5),
    "noisy": Water((0.5, 0.2, 0.25), (0.4, 0.25, 0.25), (0.05, 0.2, 0.22), 0.15, 8.0, gain=0.7),
    "uneven": Water((0.4, 0.15, 0.15), (0.4, 0.15, 0.15), (0.06, 0.15, 0.16), 0.15, 2.0, gain=1.6, lamp=True),
}


@dataclass(frozen=True)
class Truth:
    """A pair in air, its true disparity in both views, what is counted, and the largest disparity to search."""

    name: str
    left: Image
    right: Image
    disparity: NDArray[np.float32]
    disparity_left: NDArray[np.float32]
    disparity_right: NDArray[np.float32]
    mask: NDArray[np.bool_]
    max_disparity: int


def pairs(where: Path = STEREO) -> Iterator[Truth]:
    """The four pairs of the shared data; or those of `THIRDS`."""
    for folder in sorted(p.parent for p in where.glob("*/gt.pfm")):
        left, right = (cv2.imread(str(folder / f"{view}.png"))[..., ::-1] for view in ("left", "right"))
        truth = cv2.imread(str(folder / "gt.pfm"), cv2.IMREAD_UNCHANGED)
        mask = cv2.imread(str(folder / "mask_nonocc.png"), cv2.IMREAD_GRAYSCALE) == 255
        everywhere = _filled(np.where(np.isfinite(truth), truth, np.float32(np.nan)))
        ndisp = int(json.loads((folder / "meta.json").read_text())["ndisp"])
        yield Truth(
            folder.name, left, right, truth, everywhere, _in_right_view(everywhere), mask & np.isfinite(truth), ndisp
        )


def _in_right_view(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Warp a disparity map to the other camera, the nearest surface in front; holes take the farther neighbour."""
    v, u = np.indices(disparity.shape)
    order = np.argsort(disparity, axis=None, kind="stable")
    v, target, value = v.ravel()[order], np.round(u - disparity).astype(int).ravel()[order], disparity.ravel()[order]
    seen = (target >= 0) & (target < disparity.shape[1])
    warped = np.full_like(disparity, np.nan)
    warped[v[seen], target[seen]] = value[seen]
    return _filled(warped)


def _filled(disparity: NDArray[np.float32]) -> NDArray[np.float32]:
    """Rows filled; a row without any truth repeats the nearest that has some."""
    filled = fill_rows(disparity)
    known = np.flatnonzero(np.isfinite(filled[:, 0]))
    nearest = known[np.abs(np.arange(len(filled))[:, None] - known).argmin(axis=1)]
    return filled[nearest]


def drown(truth: Truth, water: Water | None, seed: int = 1) -> tuple[Image, Image]:
    """Both cameras of a pair under water; no water: in air."""
    if water is None:
        return truth.left, truth.right
    scale = float(np.median(truth.disparity_left)) * MEDIAN_DEPTH_M
    views = ((truth.left, truth.disparity_left, 0), (truth.right, truth.disparity_right, 1))
    left, right = (
        _drowned(image, scale / np.maximum(disparity, 1), water, view, np.random.default_rng([seed, view]))
        for image, disparity, view in views
    )
    return left, right


def _drowned(image: Image, depth: NDArray[np.float32], water: Water, view: int, rng: np.random.Generator) -> Image:
    z = depth.astype(np.float32)[..., None]
    light = _lamp(depth, view) if water.lamp else np.float32(1)
    direct = (image / np.float32(255)) ** 2.2 * light * np.exp(-np.float32(water.direct) * z)
    direct = 0.5 * direct + 0.5 * cv2.GaussianBlur(direct, (0, 0), water.blur * MEDIAN_DEPTH_M + 0.3)
    veil = np.float32(water.veil_color) * (1 - np.exp(-np.float32(water.veil) * z)) * light
    seen = np.clip(water.gain * direct + veil, 0, 1) ** (1 / 2.2) * 255
    return np.clip(np.round(seen + rng.normal(0, water.noise, seen.shape)), 0, 255).astype(np.uint8)


def _lamp(depth: NDArray[np.float32], view: int) -> NDArray[np.float32]:
    """A cone of light that falls with the squared distance; the right camera sees it farther left."""
    height, width = depth.shape
    v, u = np.indices(depth.shape, dtype=np.float32)
    centre = width * (0.45, 0.38)[view]
    beam = np.exp(-((u - centre) ** 2 + (v - 0.45 * height) ** 2) / (2 * (0.28 * width) ** 2))
    light = (0.06 + beam) * np.minimum((MEDIAN_DEPTH_M / depth) ** 2, 3)
    return light[..., None].astype(np.float32)
