"""What limits colours restored by range: the true water undone exactly, with and without the light's colour known.

    python test/benchmark/color_limits.py

Mean angle between colours shown and true, degrees, of areas of 4 x 4 px, in linear light. *raw*: as the camera gives
them. *ours*: what is shown. *truth, gray world*: the true colours themselves, balanced as if the scene were gray on
average. *water known, gray world*: veil, glow and attenuation taken away with the simulator's own numbers and true
ranges, then balanced. *water and light known*: divided by the true light instead. *darkest for veil*: the same with the
veil guessed as `VEIL` of each channel's darkest hundredth.
"""

# ruff: noqa: T201

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from simulated_colors import SCENES, color_errors, colored_scenes

from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.simulate import lamp as lamps
from uw_recon_ros.simulate.image_sensor import GAMMA, to_light
from uw_recon_ros.simulate.water import daylight_veil
from uw_recon_ros.types import StereoPair

Float = NDArray[np.float32]
VEIL = 0.8
COLUMNS = ("raw", "ours", "truth, gray world", "water known, gray world", "water and light known", "darkest for veil")


def row(choice: dict[str, Any], scene: Any) -> list[float]:
    """The columns for one scene."""
    height, width = scene.depth.shape
    params = SimulateParams(**{**choice, "width": width, "height": height, "frames": 1})
    dive = Dive(params)
    rays, met = dive._cameras[0].directions, np.isfinite(scene.depth)
    ranges = np.where(met, scene.depth / rays[..., 2], np.nanmedian(scene.depth)).astype(np.float32)
    arriving = to_light(scene.left) / dive._exposure
    veil = daylight_veil(ranges, dive.water, params.daylight) + lamps.lamp_glow(dive._cameras[0].glow, ranges)
    guessed = VEIL * np.percentile(arriving[met], 1, axis=0)
    gained = np.exp(dive.water.attenuation * ranges[..., None])
    direct, rough = (np.maximum(arriving - away, 0) * gained for away in (veil, guessed))
    light = params.daylight * dive.water.daylight + _lamp(dive, params, rays * ranges[..., None])
    ours = Preprocess()(StereoPair(scene.left, scene.right)).left
    shown = (arriving, to_light(ours), _gray_world(scene.light, met), _gray_world(direct, met), direct / light,
             rough / light)  # fmt: skip
    return [color_errors(_picture(colors), scene.light, met)[0] for colors in shown]


def _lamp(dive: Dive, params: SimulateParams, places: NDArray[np.floating]) -> NDArray[np.floating]:
    """The lamp's light at `places` but for shadows, slant and cone, which have no colour."""
    away = np.linalg.norm(places - np.array(lamps._PLACE), axis=-1, keepdims=True)
    return params.lamp * np.exp(-dive.water.attenuation * away) / away**2


def _gray_world(light: NDArray[np.floating], counted: NDArray[np.bool_]) -> NDArray[np.floating]:
    return light / light[counted].mean(axis=0)


def _picture(light: NDArray[np.floating]) -> NDArray[Any]:
    """16 bits, the brightest thousandth at white."""
    scaled = np.clip(light / np.quantile(light.max(axis=-1), 0.999), 0, 1)
    return np.round(65535 * scaled ** (1 / GAMMA)).astype(np.uint16)


def main() -> None:
    """Print the table."""
    print(f"| scene | {' | '.join(COLUMNS)} |\n" + "|" + " --- |" * (len(COLUMNS) + 1))
    rows = []
    for name, scene in colored_scenes().items():
        rows.append(row(SCENES[name], scene))
        print(f"| {name} | " + " | ".join(f"{value:.1f}" for value in rows[-1]) + " |", flush=True)
    print("| mean | " + " | ".join(f"{value:.1f}" for value in np.mean(rows, axis=0)) + " |")


if __name__ == "__main__":
    main()
