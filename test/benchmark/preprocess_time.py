"""How long preprocessing takes, whole and step by step.

Usage: python test/benchmark/preprocess_time.py [--repeat N]

Milliseconds for a pair: CPU time of all threads and wall time, least of N. Limits on two cores: 250 ms at 640 x 480,
1500 ms at 1920 x 1080.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import cv2
import numpy as np

from uw_recon_ros.preprocess import (
    color,
    diffusion,
    extension,
    homomorphic,
    intensity,
    matching_profile,
    moire,
    wavelet,
)
from uw_recon_ros.preprocess.image_pairs import TwoThreads, unit_from_raw
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import StereoPair

SIZES = ((480, 640, 250), (1080, 1920, 1500))


def picture(height: int, width: int, seed: int) -> np.ndarray:
    """Grainy color clouds, uint8."""
    rng = np.random.default_rng(seed)
    clouds = cv2.resize(rng.random((height // 16, width // 16, 3)).astype(np.float32), (width, height))
    return np.clip(255 * clouds * (0.3, 1, 0.9) + rng.normal(0, 4, clouds.shape), 0, 255).astype(np.uint8)


def measured(function: Callable[[], Any], repeat: int) -> tuple[float, float, Any]:
    """Least CPU and wall time, ms, and the result."""
    cpu, wall, result = [], [], None
    for _ in range(repeat):
        started = time.process_time(), time.perf_counter()
        result = function()
        cpu.append(1e3 * (time.process_time() - started[0]))
        wall.append(1e3 * (time.perf_counter() - started[1]))
    return min(cpu), min(wall), result


def steps(left: np.ndarray, right: np.ndarray, repeat: int) -> None:
    """Print a line for each step, on both cameras in two threads."""
    height, width = left.shape[:2]

    with TwoThreads() as both:

        def step(name: str, function: Callable[..., Any], *views: Any) -> Any:
            cpu, wall, result = measured(lambda: both(function, *views), repeat)
            print(f"  {name:42s}{cpu:8.1f}{wall:8.1f}")
            return result

        unit = step("   uint8 to float", partial(unit_from_raw, full_scale=255.0), (left, right))
        clean = step("1  moire", moire.remove_moire, unit)
        ycbcr = step("3  RGB to YCbCr", color.ycbcr_from_rgb, clean)
        luma = both(color.luminance, clean)
        extended = step("2  symmetric extension", extension.extend_symmetric, luma)
        even = step("4  homomorphic", partial(homomorphic.homomorphic_filter, cutoff=20.0), extended)
        pyramids = step("5  wavelet: decompose", partial(wavelet.decompose, levels=5), even)
        cpu, wall, sigma = measured(lambda: wavelet.noise_sigma(pyramids), repeat)
        print(f"  {'5  wavelet: noise of both views':42s}{cpu:8.1f}{wall:8.1f}")
        shrunk = step("5  wavelet: shrink", partial(wavelet.shrink, sigma=sigma), pyramids)
        smooth = step("5  wavelet: reconstruct", wavelet.reconstruct, shrunk)
        diffused = step("6  diffusion, 4 times", diffusion.diffuse, smooth)
        cropped = both(partial(extension.crop_extension, height=height, width=width), diffused)
        cpu, wall, bounds = measured(lambda: intensity.intensity_bounds(cropped), repeat)
        print(f"  {'7  intensity: bounds of both views':42s}{cpu:8.1f}{wall:8.1f}")
        stretched = step("7  intensity: stretch", partial(intensity.stretch, bounds=bounds), cropped)
        replaced = step("8  luminance in its place", color.replace_luminance, ycbcr, stretched)
        rgb = step("8  YCbCr to RGB", color.rgb_from_ycbcr, replaced)
        cpu, wall, gains = measured(lambda: color.equalizing_gains(rgb), repeat)
        print(f"  {'9  colour means: gains of both views':42s}{cpu:8.1f}{wall:8.1f}")
        step("9  colour means: apply", partial(color.apply_gains, gains=gains), rgb)
        cpu, wall, weights = measured(lambda: matching_profile.channel_weights(clean), repeat)
        print(f"  {'m  matching: weights of both views':42s}{cpu:8.1f}{wall:8.1f}")
        gray = step("m  matching: gray", partial(matching_profile.weighted_gray, weights=weights), clean)
        step("m  matching: denoise", partial(matching_profile.denoise_evenly, sigma=0.02), gray)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--repeat", type=int, default=5)
    repeat = parser.parse_args().repeat
    for height, width, limit in SIZES:
        left, right = (picture(height, width, seed) for seed in (0, 1))
        print(f"{width} x {height} colour pair{'':21s}{'CPU ms':>8s}{'wall ms':>8s}")
        for profile in ("none", "paper", "matching"):
            stage = Preprocess(PreprocessParams(profile=profile))
            cpu, wall, _ = measured(partial(stage, StereoPair(left, right)), repeat)
            print(f"  whole stage, profile {profile:21s}{cpu:8.1f}{wall:8.1f}   limit {limit} ms")
        steps(left, right, repeat)


if __name__ == "__main__":
    main()
