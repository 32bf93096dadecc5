"""Simulated pairs whose true colours are known: the same surfaces under even white light, without water."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.simulate.image_sensor import to_light

Byte = NDArray[np.uint8]
Float = NDArray[np.float32]

_DAY: dict[str, Any] = {"lamp": 0.0, "daylight": 1.0}
SCENES: dict[str, dict[str, Any]] = {
    "reef, lamp, 3C": {"scene": "reef", "water": "3C"},
    "amphora, day, II": {"scene": "amphora", "water": "II", "water_depth_m": 6.0, **_DAY},
    "reef, red dead, II": {"scene": "reef", "water": "II", "water_depth_m": 18.0, "pitch_deg": 35.0, **_DAY},
    "pipe, lamp, 7C": {"scene": "pipe", "water": "7C"},
    "amphora, both, IB": {"scene": "amphora", "water": "IB", "lamp": 0.6, "daylight": 0.6, "water_depth_m": 8.0,
                          "distance_m": 2.0, "pitch_deg": 35.0},
    "plane, lamp, 1C": {"scene": "plane", "water": "1C", "pitch_deg": 90.0},
}  # fmt: skip
_IN_AIR: dict[str, Any] = {
    "water": "clear", "lamp": 0.0, "daylight": 1.0, "snow_per_m3": 0.0, "noise": 0.0, "bits": 16,
}  # fmt: skip
_CELL = 4  # px: colours are compared of areas, not of grain


@dataclass(frozen=True, eq=False)
class ColoredScene:
    """A pair under water; true depth (m) and true colours (linear light) of the left image."""

    left: Byte
    right: Byte
    depth: Float
    light: Float


def colored_scenes(width: int = 320, height: int = 240) -> dict[str, ColoredScene]:
    """All scenes, by name."""
    return {name: _taken({**choice, "width": width, "height": height, "frames": 1}) for name, choice in SCENES.items()}


def _taken(choice: dict[str, Any]) -> ColoredScene:
    frame = Dive(SimulateParams(**choice)).frame(0)
    dry = Dive(SimulateParams(**{**choice, **_IN_AIR})).frame(0)
    return ColoredScene(frame.left, frame.right, frame.depth, to_light(dry.left))


def _areas(light: Float) -> Float:
    return cv2.resize(light, None, fx=1 / _CELL, fy=1 / _CELL, interpolation=cv2.INTER_AREA)


def color_errors(image: Byte, light: Float, counted: NDArray[np.bool_] | None = None) -> tuple[float, float]:
    """Mean angle (degrees) and mean CIE76 difference after one exposure for the whole picture."""
    seen, true = _areas(to_light(image)), _areas(light)
    where = np.ones(seen.shape[:2], bool) if counted is None else _areas(counted.astype(np.float32)) > 0.5
    seen, true = seen[where], true[where]
    lengths = np.linalg.norm(seen, axis=1) * np.linalg.norm(true, axis=1)
    angle = np.degrees(np.arccos(np.clip((seen * true).sum(axis=1) / np.maximum(lengths, 1e-9), -1, 1)))
    brightness = [np.log(np.maximum(values.mean(axis=1), 1e-3)) for values in (true, seen)]
    exposure = np.exp(np.median(brightness[0] - brightness[1]))
    return float(angle.mean()), float(np.linalg.norm(_lab(exposure * seen) - _lab(true), axis=1).mean())


def _lab(light: Float) -> Float:
    light = np.clip(light, 0, 1)
    srgb = np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)
    return cv2.cvtColor(srgb.astype(np.float32)[None], cv2.COLOR_RGB2LAB)[0]


def structure(image: Byte, light: Float) -> float:
    """Contrast and structure of SSIM: 1 is the truth's."""
    seen = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32) / 255
    true = (np.clip(light.mean(axis=2), 0, 1) ** (1 / 2.2)).astype(np.float32)
    means = _blurred(seen), _blurred(true)
    variances = _blurred(seen * seen) - means[0] ** 2 + _blurred(true * true) - means[1] ** 2
    covariance = _blurred(seen * true) - means[0] * means[1]
    return float(((2 * covariance + 9e-4) / (variances + 9e-4)).mean())


def _blurred(plane: Float) -> Float:
    return cv2.GaussianBlur(plane, (0, 0), 2.5)
