"""Which defaults should the depth filter and the surface have? Errors against the truth, setting by setting.

Usage: python test/benchmark/reconstruct_defaults.py [filter|speckles|surface|sigma] [--kz2]

Scenes: simulated dives (and the Middlebury pairs, where they are at hand), matched by OpenCV's semi-global matcher with
sub-pixels, and rounded to whole pixels as a graph cut leaves them (with --kz2: also by this project's own).
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from drowned_pairs import pairs
from numpy.typing import NDArray

from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.reconstruct.cloud import organised_cloud
from uw_recon_ros.reconstruct.depth_filter import ROUNDING_SIGMA
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.types import (
    DepthMap,
    DisparityMap,
    RectificationQuality,
    RectifiedPair,
    Status,
    StereoGeometry,
    StereoPair,
)

SUBPIXEL_SIGMA = 0.15  # px; the semi-global matcher's spread on these scenes' smooth parts
NEAR_EDGE_PX = 4
GROSS_PX = 2
Scores = dict[str, float]


@dataclass(frozen=True, eq=False)
class Case:
    """A disparity map with its truth."""

    name: str
    kind: str
    disparity: DisparityMap
    truth: NDArray[np.float32]
    picture: NDArray[np.uint8]
    simulated: bool


def semi_global(pair: RectifiedPair, count: int) -> NDArray[np.float32]:
    """OpenCV's semi-global matcher, left border padded, speckles left in."""
    count = -(-count // 16) * 16
    matcher = cv2.StereoSGBM_create(0, count, 5, 8 * 25, 32 * 25, 1, 31, 10, 0, 0)
    sides = [np.pad(side, ((0, 0), (count, 0)), mode="edge") for side in (pair.left_matching, pair.right_matching)]
    disparity = matcher.compute(*sides)[:, count:].astype(np.float32) / 16
    return np.where(disparity >= 0, disparity, np.float32(np.nan))


def as_map(disparity: NDArray[np.float32], sigma: float, geometry: StereoGeometry) -> DisparityMap:
    """With a constant sigma."""
    valid = np.isfinite(disparity)
    status = np.where(valid, 0, int(Status.INCONSISTENT)).astype(np.uint8)
    return DisparityMap(
        disparity, np.where(valid, np.float32(sigma), np.float32(np.nan)), status, 0, 255, geometry, "x"
    )


def matched(name: str, pair: RectifiedPair, truth: NDArray[np.float32], count: int, kz2: bool) -> Iterator[Case]:
    """All kinds of disparity map of one pair."""
    simulated = name.startswith("dive")
    fine = semi_global(pair, count)
    yield Case(name, "sub-pixel", as_map(fine, SUBPIXEL_SIGMA, pair.geometry), truth, pair.left, simulated)
    yield Case(name, "whole", as_map(np.round(fine), ROUNDING_SIGMA, pair.geometry), truth, pair.left, simulated)
    if kz2:
        from uw_recon_ros.match.stage import Match, MatchParams

        own = Match(MatchParams(method="kz2", max_disparity=count - 1))(pair)
        yield Case(name, "kz2", own, truth, pair.left, simulated)


def cases(kz2: bool) -> Iterator[Case]:
    """Dives through three waters, and the four pairs."""
    for scene, water in (("amphora", "3C"), ("amphora", "clear"), ("pipe", "II")):
        dive = Dive(SimulateParams(scene=scene, water=water, width=512, height=384))
        frame = dive.frame(0)
        enhanced = Preprocess(PreprocessParams())(StereoPair(frame.left, frame.right, calibration=dive.calibration))
        rectification = rectification_from_calibration(dive.calibration, RectifyParams())
        pair = Rectify(RectifyParams())(enhanced, rectification)
        truth = dive.true_disparity(0, pair.geometry, pair.left.shape[1], pair.left.shape[0])
        yield from matched(f"dive {scene} {water}", pair, truth, 96, kz2)
    for known in pairs():
        if known.name == "tsukuba":
            continue  # its truth is whole pixels
        gray = [cv2.cvtColor(np.ascontiguousarray(side), cv2.COLOR_RGB2GRAY) for side in (known.left, known.right)]
        width = known.left.shape[1]
        geometry = StereoGeometry(1.2 * width, width / 2, width / 2, known.left.shape[0] / 2, baseline_m=0.1)
        pair = RectifiedPair(known.left, known.right, *gray, geometry, RectificationQuality("given"))
        truth = np.where(known.mask, known.disparity, np.float32(np.nan))
        yield from matched(known.name, pair, truth, known.max_disparity, kz2)


def near_edges(truth: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Pixels next to a discontinuity of the truth."""
    edge = np.zeros(truth.shape, np.uint8)
    edge[:, 1:] |= np.abs(np.diff(truth, axis=1)) > 1
    edge[1:] |= np.abs(np.diff(truth, axis=0)) > 1
    return cv2.dilate(edge, np.ones((2 * NEAR_EDGE_PX + 1,) * 2, np.uint8)) > 0


def disparity_of(depth: DepthMap) -> NDArray[np.float32]:
    """Back from depth."""
    return depth.geometry.disparity_from_depth(depth.depth)


def filter_scores(case: Case, params: ReconstructParams) -> Scores:
    """Errors of the filtered map in disparity, and of its normals where the true ones are known."""
    depth = Reconstruct(params).depth(case.disparity)
    error = np.abs(disparity_of(depth) - case.truth)
    known = np.isfinite(error)
    edges = near_edges(case.truth) & known
    inner = error[known & ~edges]
    scores = {
        "rms of inliers px": float(np.sqrt(np.mean(inner[inner < 1] ** 2))),
        "bad-0.5 %": 100 * float(np.mean(error[known] > 0.5)),
        "bad-1 %": 100 * float(np.mean(error[known] > 1)),
        "bad-1 at edges %": 100 * float(np.mean(error[edges] > 1)),
        "density %": 100 * float(known.sum() / np.isfinite(case.truth).sum()),
    }
    return {**scores, "normals deg": normal_error(case, depth)} if case.simulated else scores


def normal_error(case: Case, depth: DepthMap) -> float:
    """Median angle to the true normals."""
    true_depth = case.disparity.geometry.depth_from_disparity(case.truth)
    sigma = np.full_like(true_depth, 1e-3)
    true = organised_cloud(replace(depth, depth=true_depth, sigma=sigma), case.picture).normals
    found = organised_cloud(depth, case.picture).normals
    return float(np.rad2deg(np.nanmedian(np.arccos(np.clip((true * found).sum(-1), -1, 1)))))


def surface_scores(case: Case, params: ReconstructParams) -> Scores:
    """How the surface, seen from the camera, departs from the truth, and how much of the map it covers."""
    stage = Reconstruct(params)
    depth = stage.depth(case.disparity)
    started = time.process_time()
    surface = stage.surface(depth, case.picture)
    seconds = time.process_time() - started
    height, width = depth.depth.shape
    drawn = draw(surface.uv, surface.vertices, surface.faces, depth, (height, width))
    error, own = np.abs(drawn - case.truth), np.abs(drawn - disparity_of(depth))
    known = np.isfinite(error)
    edges = near_edges(case.truth) & known
    return {
        "vertices": float(len(surface.vertices)),
        "to depth map, rms px": float(np.sqrt(np.nanmean(np.minimum(own, 1) ** 2))),
        "to truth, rms px": float(np.sqrt(np.mean(np.minimum(error[known], 3) ** 2))),
        "bad-1 at edges %": 100 * float(np.mean(error[edges] > 1)),
        "covered %": 100 * float(np.isfinite(drawn).sum() / np.isfinite(depth.depth).sum()),
        "CPU s": seconds,
    }


def draw(uv, vertices, faces, depth, shape) -> NDArray[np.float32]:
    """Disparity of the surface at every pixel centre; NaN beside it."""
    out = np.full(shape, np.nan, np.float32)
    pixels = np.stack([uv[:, 0] * shape[1] - 0.5, (1 - uv[:, 1]) * shape[0] - 0.5], axis=1).round().astype(int)
    level = disparity_of(depth)[pixels[:, 1], pixels[:, 0]]
    for face in faces:
        (u0, v0), (u1, v1), (u2, v2) = pixels[face]
        v, u = np.mgrid[min(v0, v1, v2) : max(v0, v1, v2) + 1, min(u0, u1, u2) : max(u0, u1, u2) + 1]
        area = (u1 - u0) * (v2 - v0) - (u2 - u0) * (v1 - v0)
        b = ((u - u0) * (v2 - v0) - (u2 - u0) * (v - v0)) / area
        c = ((u1 - u0) * (v - v0) - (u - u0) * (v1 - v0)) / area
        inside = (b >= 0) & (c >= 0) & (b + c <= 1)
        out[v[inside], u[inside]] = ((1 - b - c) * level[face[0]] + b * level[face[1]] + c * level[face[2]])[inside]
    return out


FILTERS = {
    "off": {"depth_filter_levels": 0},
    **{f"levels {n}": {"depth_filter_levels": n} for n in (2, 3, 4, 5, 6)},
    **{f"sigmas {s:g}": {"depth_filter_sigmas": s} for s in (2.0, 3.0, 7.0, 10.0)},
}
SPECKLES = {
    **{f"area {n}": {"speckle_area_px": n} for n in (0, 30, 100, 300, 1000)},
    **{f"jump {j:g} px": {"speckle_jump_px": j} for j in (0.5, 1.5, 2.0, 3.0)},
}
SURFACES = {
    **{f"tolerance {t:g} px": {"surface_tolerance_px": t} for t in (0.05, 0.1, 0.15, 0.25, 0.5)},
    **{f"jump {j:g} px": {"surface_max_jump_px": j} for j in (0.5, 0.75, 1.5, 2.0)},
    **{f"obliqueness {a:g}": {"surface_max_obliqueness": a} for a in (75.0, 80.0, 90.0)},
    **{f"vertices {n}": {"surface_max_vertices": n} for n in (2000, 5000, 10_000)},
}


def table(settings: dict[str, dict[str, object]], score, known: list[Case]) -> None:
    """One line a setting and kind of map, means over the scenes."""
    for kind in dict.fromkeys(case.kind for case in known):
        here = [case for case in known if case.kind == kind]
        for name, changes in {"default": {}, **settings}.items():
            rows = [score(case, ReconstructParams(**changes)) for case in here]
            keys = dict.fromkeys(key for row in rows for key in row)
            means = {key: np.mean([row[key] for row in rows if key in row]) for key in keys}
            print(f"{kind:10}{name:18}" + "  ".join(f"{key} {value:.3f}" for key, value in means.items()), flush=True)


def spread(known: list[Case]) -> None:
    """What the matchers' standard deviation is, gross errors aside, and what they state."""
    for case in known:
        error = np.abs(case.disparity.disparity - case.truth)
        inner = error[error < GROSS_PX]
        stated = float(np.nanmedian(case.disparity.sigma))
        print(f"{case.name:22}{case.kind:12}rms px {np.sqrt(np.mean(inner**2)):.3f}  stated {stated:.3f}")


def main() -> None:
    """Run what was asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("what", nargs="?", choices=("filter", "speckles", "surface", "sigma"), default="filter")
    parser.add_argument("--kz2", action="store_true")
    arguments = parser.parse_args()
    known = list(cases(arguments.kz2))
    if arguments.what == "sigma":
        spread(known)
        return
    settings, score = {
        "filter": (FILTERS, filter_scores), "speckles": (SPECKLES, filter_scores), "surface": (SURFACES, surface_scores)
    }[arguments.what]  # fmt: skip
    table(settings, score, known)


if __name__ == "__main__":
    main()
