"""Obstacles and range of simulated dives against the dives' truth.

Usage: python test/benchmark/obstacles.py [--frames 10] [--size 640x480] [--output FILE.json]
       python test/benchmark/obstacles.py --scenes ahead snow wreck surface lamps --waters 3C

A rig that looks slightly down swims at things that lie on the bottom, in several waters; navigation's matcher. The
dives of `OPEN_WATER` look into open water instead: level, into drifting particles, past a wreck, at the surface from
below, at the lamps of others. For each dive, over the sectors of all its frames:

- false: told nearer than the nearest true surface of that sector and its neighbours, up to 0.1 m above and below the
  slice of heights, by more than 15 % and 0.1 m; in percent of the told sectors;
- scans: how many hold a false sector, of how many; the sums below the table are also told by the minute at the rate of
  the preset, as if each scan were as likely to be false as these;
- silent: sectors that are unknown, in percent;
- edge: told, and false only if the slice is taken exactly: surfaces up to 0.1 m outside it that noise lifted into it
  (the bottom, mostly). A rule that is lenient about heights shows here and not under false;
- seen: of the sectors whose nearest true surface within the image is closer than 3 m, how many are told, within 15 %
  or 0.1 m;
- thin: of those not seen, how many show both cameras fewer pixels of that surface, within 15 % of its distance, than
  must agree before anything is told (``obstacle_min_share``): a corner of the slice of heights, an edge of a thing, the
  rim of the view that the right camera does not see. Counted as missed all the same;
- far: of those not seen, how many are told a distance beyond it: only these look free where something stands, the
  others are unknown;
- range: median of |told - true| / true of the distance down, and frames without one, in percent.

The truth is the simulator's depth, searched without the code under test. Lamps of others are things that the depth does
not hold: told where one is, or beside it, is not false.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import itertools
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.errors import ReconError
from uw_recon_ros.pipeline import Pipeline, PipelineParams, read_values
from uw_recon_ros.reconstruct.obstacles import FindObstacles, ObstacleParams
from uw_recon_ros.simulate.backdrop import place_lamps
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.types import StereoPair

SCENES, WATERS = ("pipe", "amphora", "reef"), ("I", "3C", "7C")
PITCH_DEG = 25.0
_DAY = {"lamp": 0.0, "daylight": 1.0}
#: Dives that look up from the bottom, half of the view or more into water; as in ``open_water.py``.
OPEN_WATER: dict[str, dict[str, Any]] = {
    "ahead": {"scene": "reef", "look_up_deg": 25.0},
    "snow": {"scene": "reef", "look_up_deg": 25.0, "snow_per_m3": 2500.0},
    "wreck": {"scene": "wreck", "look_up_deg": 12.0, **_DAY},
    "surface": {"scene": "amphora", "look_up_deg": 40.0, "surface_above": True, "water_depth_m": 3.0, **_DAY},
    "lamps": {"scene": "amphora", "look_up_deg": 25.0, "other_lamps": 3},
}
PARAMS = ObstacleParams(
    obstacle_field_deg=60.0, obstacle_min_height_m=-0.45,
    range_axis="down", range_cone_deg=90.0,
)  # fmt: skip
NAVIGATION = Path(__file__).resolve().parents[2] / "config" / "navigation.yaml"
NEAR_M, SHARE, SLACK_M = 3.0, 0.15, 0.1


def true_sectors(
    depth: np.ndarray, geometry: Any, mount: MountParams, slack_m: float = 0.0
) -> tuple[np.ndarray, float, np.ndarray]:
    """Nearest true surface by sector, in a slice higher and deeper by `slack_m`; the nearest one down; its pixels.

    The last are those of each sector that both cameras see and that lie within `SHARE` of its nearest.
    """
    k = geometry.intrinsics_left
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(depth.shape)], axis=-1)
    optical = (rays * depth[..., None]) @ np.asarray(geometry.rect_from_raw_left)
    known = np.isfinite(depth)
    base = (optical @ mount.base_from_optical.T)[known]
    in_both = (u - geometry.disparity_from_depth(depth) >= 0)[known]
    down = -base[:, 2]
    in_cone = down > np.cos(np.deg2rad(PARAMS.range_cone_deg / 2)) * np.linalg.norm(base, axis=1)
    low, high = PARAMS.obstacle_min_height_m - slack_m, PARAMS.obstacle_max_height_m + slack_m
    in_slice = (base[:, 2] >= low) & (base[:, 2] <= high)
    level, in_both = base[in_slice], in_both[in_slice]
    number = round(PARAMS.obstacle_field_deg / PARAMS.obstacle_sector_deg)
    bearing = (
        np.rad2deg(np.arctan2(level[:, 1], level[:, 0])) + PARAMS.obstacle_field_deg / 2
    ) / PARAMS.obstacle_sector_deg
    flat = np.hypot(level[:, 0], level[:, 1])
    sectors = [(bearing >= i) & (bearing < i + 1) for i in range(number)]
    nearest = np.array([min(flat[sector], default=np.nan) for sector in sectors])
    pixels = np.array([
        (flat[sector & in_both] <= near * (1 + SHARE)).sum() for sector, near in zip(sectors, nearest, strict=True)
    ])  # fmt: skip
    return nearest, min(down[in_cone], default=np.nan), pixels


def with_lamps(nearest: np.ndarray, dive: Dive, index: int, mount: MountParams) -> np.ndarray:
    """The nearest by sector, lamps of others included: `true_sectors` of a dive's frame, with `SLACK_M`."""
    p, pose = dive.params, dive.pose(index)
    places = place_lamps(p.other_lamps, p.seed, p.distance_m, dive.pose(0))
    base = (places - pose.position) @ pose.rotation @ mount.base_from_optical.T
    low, high = PARAMS.obstacle_min_height_m - SLACK_M, PARAMS.obstacle_max_height_m + SLACK_M
    nearest = nearest.copy()
    for x, y, _ in base[(base[:, 2] >= low) & (base[:, 2] <= high)]:
        bearing = np.rad2deg(np.arctan2(y, x)) + PARAMS.obstacle_field_deg / 2
        sector = int(bearing // PARAMS.obstacle_sector_deg)
        if 0 <= sector < len(nearest):
            nearest[sector] = np.fmin(nearest[sector], np.hypot(x, y))
    return nearest


def too_near(sectors: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Sectors told nearer than the truth of themselves and both neighbors; unknown ones are not."""
    padded = np.pad(np.nan_to_num(truth, nan=np.inf), 1, constant_values=np.inf)
    allowed = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    return sectors < np.minimum(allowed * (1 - SHARE), allowed - SLACK_M)


def run(scene: str, water: str, frames: int, size: tuple[int, int], seed: int) -> dict[str, float]:
    """Errors of one dive."""
    params = SimulateParams(**{
        "scene": scene, "water": water, "frames": frames, "pitch_deg": PITCH_DEG, "distance_m": 1.6, "speed_m_s": 0.2,
        "rate_hz": 2.0, "width": size[0], "height": size[1], "seed": seed, **OPEN_WATER.get(scene, {}),
    })  # fmt: skip
    dive = Dive(params)
    mount = MountParams(base_frame="base_link", camera_pitch_deg=params.pitch_deg - params.look_up_deg)
    pipeline, find = Pipeline(PipelineParams.from_mapping(read_values(NAVIGATION))), FindObstacles(PARAMS, mount)
    false = edge = told = near = seen = thin = far = sectors_all = scans_false = 0
    fewest = round(PARAMS.obstacle_min_share * size[0] * size[1])
    errors: list[float] = []
    for index in range(frames):
        frame = dive.frame(index)
        raw = StereoPair(frame.left, frame.right, stamp_ns=frame.stamp_ns, calibration=dive.calibration)
        try:
            products = pipeline(raw)
            depth, metric = products.depth, products.depth.geometry.metric
        except ReconError:  # a pair that is refused, as where nothing can be matched
            metric = False
        geometry = depth.geometry if metric else dive.geometry  # without metres: silent
        true_depth = dive.true_depth(index, geometry, *size)
        truth, below, pixels = true_sectors(true_depth, geometry, mount)
        nearby = with_lamps(true_sectors(true_depth, geometry, mount, SLACK_M)[0], dive, index, mount)
        around = find.look(depth, products.disparity) if metric else None
        sectors = around.sectors().ranges if around else np.full(len(truth), np.nan)
        told += int(np.isfinite(sectors).sum())
        wrong = too_near(sectors, nearby)
        false += int(wrong.sum())
        scans_false += int(wrong.any())
        sectors_all += len(sectors)
        edge += int((too_near(sectors, truth) & ~wrong).sum())
        close = truth < NEAR_M
        near += int(close.sum())
        found = np.abs(sectors - truth) <= np.maximum(SLACK_M, SHARE * truth)
        seen += int((close & found).sum())
        thin += int((close & ~found & (pixels < fewest)).sum())
        far += int((close & ~found & (sectors > truth)).sum())
        down = around.along_axis() if around else None
        errors.append(abs(down.distance - below) / below if down is not None else np.nan)
    return {
        "scans": frames, "scans_false": scans_false, "sectors": sectors_all, "told": told, "false": false, "edge": edge,
        "silent_percent": 100 * (1 - told / sectors_all), "false_percent": 100 * false / max(told, 1),
        "near": near, "seen_percent": 100 * seen / max(near, 1), "thin": thin, "far": far,
        "range_error_percent": float(100 * np.nanmedian(errors)) if np.isfinite(errors).any() else float("nan"),
        "no_range_percent": float(100 * np.isnan(errors).mean()),
    }  # fmt: skip


def rates(table: dict[str, dict[str, float]]) -> str:
    """What is false of all scans and sectors, and in a minute of dive at the preset's rate.

    Where none is false, up to 3 / N of N may be (95 %), if they were independent.
    """
    scans, scans_false, sectors, told, false, near, far = (
        sum(row[name] for row in table.values())
        for name in ("scans", "scans_false", "sectors", "told", "false", "near", "far")
    )
    seen = sum(row["near"] * row["seen_percent"] / 100 for row in table.values())
    rate = read_values(NAVIGATION)["max_rate_hz"]
    possible = "" if scans_false else f"; up to {min(100, 300 / scans):.1f} % possible"
    return (
        f"false: {scans_false:.0f} of {scans:.0f} scans ({100 * scans_false / scans:.2f} %{possible}), "
        f"{false:.0f} of {told:.0f} told and of {sectors:.0f} sectors ({100 * false / sectors:.3f} %)\n"
        f"a minute at {rate:g} Hz: {60 * rate * scans_false / scans:.1f} of {60 * rate:.0f} scans with a false sector, "
        f"{60 * rate * false / scans:.1f} of {60 * rate * sectors / scans:.0f} sectors\n"
        f"seen: {seen:.0f} of {near:.0f} nearer than {NEAR_M:g} m ({100 * seen / max(near, 1):.1f} %); "
        f"{far:.0f} told too far, the other missed ones are unknown"
    )


def main() -> int:
    """Run all dives; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--seed", type=int, default=3, help="of the dives; defaults were chosen on 3")
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=(*SCENES, *OPEN_WATER))
    parser.add_argument("--waters", nargs="+", default=WATERS)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    print("scene    water  scans  silent %  told  false %  edge  near  seen %  thin  far  range err %  no range %")
    table = {}
    for scene, water in itertools.product(args.scenes, args.waters):
        row = table[f"{scene} {water}"] = run(scene, water, args.frames, (width, height), args.seed)
        print(
            f"{scene:8} {water:5} {row['scans_false']:2.0f}/{row['scans']:<3.0f} {row['silent_percent']:8.1f} "
            f"{row['told']:5.0f} {row['false_percent']:8.2f} {row['edge']:5.0f} {row['near']:5.0f} "
            f"{row['seen_percent']:7.1f} {row['thin']:5.0f} {row['far']:4.0f} "
            f"{row['range_error_percent']:12.2f} {row['no_range_percent']:11.1f}",
            flush=True,
        )
    print(rates(table))
    if args.output:
        args.output.write_text(json.dumps(table, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
