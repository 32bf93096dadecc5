"""Half a camera: what becomes of a simulated pair one of whose images is half black, gray, noise, a repeated row, ...

Run: ``python test/benchmark/half_camera.py [--effort balanced] [--kinds WORD ...] [--size 320x240]``. A line each:
share of the left view's pixels with a depth (of all, and of those where either camera is broken), share of these that
is more than 20 % wrong, the same in the intact part, and what the pipeline says. Simulated, no real fault.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ReconError
from uw_recon_ros.match.stage import MatchParams
from uw_recon_ros.pipeline import Pipeline, PipelineParams
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import StereoPair

Image = NDArray[np.uint8]
_WRONG = 0.2  # of the true depth


def painted(value: int) -> Callable[[Image], Image]:
    """One gray."""
    return lambda part: np.full_like(part, value)


def noise(part: Image) -> Image:
    """What a receiver without a signal shows."""
    return np.random.default_rng(0).integers(0, 256, part.shape, np.uint8)


def repeated(part: Image) -> Image:
    """The first row again and again."""
    return np.repeat(part[:1], len(part), axis=0)


def silt(part: Image) -> Image:
    """An even brown veil with the sensor's noise."""
    veil = np.array([96, 84, 62], np.float32) + np.random.default_rng(0).normal(0, 2, part.shape)
    return veil.clip(0, 255).astype(np.uint8)


DAMAGES: dict[str, Callable[[Image], Image]] = {
    "black": painted(0), "gray": painted(128), "noise": noise, "repeated row": repeated, "silt": silt,
}  # fmt: skip


def lower(image: Image, damage: Callable[[Image], Image]) -> Image:
    """The image with its lower half damaged."""
    half = len(image) // 2
    return np.concatenate([image[:half], damage(image[half:])])


def beside(image: Image, damage: Callable[[Image], Image]) -> Image:
    """The image with its right half damaged."""
    return np.ascontiguousarray(np.swapaxes(lower(np.swapaxes(image, 0, 1), damage), 0, 1))


def cut_jpeg(image: Image) -> Image:
    """The image after a JPEG of which the second half never came."""
    data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    half = np.concatenate([data[: len(data) // 2], np.array([0xFF, 0xD9], np.uint8)])  # as a driver closes it
    return np.asarray(cv2.imdecode(half, cv2.IMREAD_COLOR), np.uint8)


def cases(left: Image, right: Image, before: Image) -> dict[str, tuple[Image, Image]]:
    """All broken pairs of one good one."""
    made = {"intact": (left, right)}
    for name, damage in DAMAGES.items():
        made[f"left lower half {name}"] = lower(left, damage), right
        made[f"right lower half {name}"] = left, lower(right, damage)
        made[f"left right-hand half {name}"] = beside(left, damage), right
        made[f"right right-hand half {name}"] = left, beside(right, damage)
    for name in ("black", "gray"):
        made[f"both lower halves {name}"] = lower(left, DAMAGES[name]), lower(right, DAMAGES[name])
    made["left cut JPEG"] = cut_jpeg(left), right
    made["right cut JPEG"] = left, cut_jpeg(right)
    frozen = lower(right, lambda part: before[len(before) - len(part) :])
    made["right lower half frozen"] = left, frozen
    made["right all black"] = left, np.zeros_like(right)
    made["left all black"] = np.zeros_like(left), right
    made["right all frozen"] = left, before
    return made


def broken_in_left(pair: StereoPair, good: StereoPair, disparity: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Where either image differs from the good one, raw pixels taken for rectified ones: the broken part, about."""
    left = (pair.left != good.left).any(axis=2)
    right = (pair.right != good.right).any(axis=2)
    v, u = np.indices(left.shape)
    there = np.clip(np.round(u - np.nan_to_num(disparity)), 0, left.shape[1] - 1).astype(int)
    broken = cv2.morphologyEx((left | right[v, there]).astype(np.uint8), cv2.MORPH_CLOSE, np.ones((15, 15)))
    return np.asarray(broken > 0)


def measure(pipeline: Pipeline, dive: Dive, number: int, pair: StereoPair, good: StereoPair) -> str:
    """A line of the table."""
    try:
        result = pipeline(pair)
        _ = result.depth
    except ReconError as error:
        return f"refused: {str(error)[:110]}"
    geometry, shape = result.depth.geometry, result.depth.depth.shape
    truth = dive.true_depth(number, geometry, *shape[::-1])
    raw = cv2.resize(np.nan_to_num(geometry.disparity_from_depth(truth)), pair.left.shape[1::-1])
    broken = cv2.resize(broken_in_left(pair, good, raw).astype(np.uint8), shape[::-1]) > 0
    found = np.isfinite(result.depth.depth)
    wrong = found & (np.abs(result.depth.depth / truth - 1) > _WRONG)
    intact = ~broken

    def share(part: NDArray[np.bool_], of: NDArray[np.bool_]) -> str:
        return f"{100 * (part & of).sum() / max(of.sum(), 1):5.1f} %"

    findings = getattr(result.enhanced, "findings", ()) + result.rectified.quality.warnings
    said = ", ".join(f"{finding.code}:{finding.severity.name}" for finding in findings)
    return (
        f"dense {share(found, np.ones_like(found))}, in broken {share(found, broken)}; wrong {share(wrong, found)}, "
        f"in intact {share(wrong, found & intact)} of {share(found, intact)}; {said}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--effort", default="balanced")
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--kinds", nargs="*", default=[])
    given = parser.parse_args()
    width, height = (int(part) for part in given.size.split("x"))
    dive = Dive(SimulateParams(frames=2, width=width, height=height))
    first, taken = dive.frame(0), dive.frame(1)
    start: Any = StereoPair(first.left, first.right, stamp_ns=first.stamp_ns, calibration=dive.calibration)
    good = StereoPair(taken.left, taken.right, stamp_ns=taken.stamp_ns, calibration=dive.calibration)
    params = PipelineParams(match=MatchParams(effort=given.effort))
    for name, (left, right) in cases(taken.left, taken.right, first.right).items():
        if all(word in name for word in given.kinds):
            pipeline = Pipeline(params)
            pipeline(start)
            pair = replace(good, left=left, right=right)
            print(f"{name:32} {measure(pipeline, dive, 1, pair, good)}", flush=True)  # noqa: T201


if __name__ == "__main__":
    main()
