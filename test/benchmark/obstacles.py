"""Obstacles and range of simulated dives against the dives' truth.

Usage: python test/benchmark/obstacles.py [--frames 10] [--size 640x480] [--output FILE.json]

A rig that looks slightly down swims at things that lie on the bottom, in several waters; navigation's matcher. For each
dive, over the sectors of all its frames:

- false: told nearer than the nearest true surface of that sector and its neighbours, up to 0.1 m above and below the
  slice of heights, by more than 15 % and 0.1 m;
- edge: told, and false only if the slice is taken exactly: surfaces up to 0.1 m outside it that noise lifted into it
  (the bottom, mostly). A rule that is lenient about heights shows here and not under false;
- seen: of the sectors whose nearest true surface within the image is closer than 3 m, how many are told, within 15 %
  or 0.1 m;
- thin: of those not seen, how many show fewer pixels of that surface, within 15 % of its distance, than must agree
  before anything is told (``obstacle_min_share``): a corner of the slice of heights, an edge of a thing. Counted as
  missed all the same;
- range: median of |told - true| / true of the distance down, and frames without one, in percent.

The truth is the simulator's depth, searched without the code under test.
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
from uw_recon_ros.pipeline import Pipeline, PipelineParams, read_values
from uw_recon_ros.reconstruct.obstacles import FindObstacles, ObstacleParams
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.types import StereoPair

SCENES, WATERS = ("pipe", "amphora", "reef"), ("I", "3C", "7C")
PITCH_DEG = 25.0
MOUNT = MountParams(base_frame="base_link", camera_pitch_deg=PITCH_DEG)
PARAMS = ObstacleParams(
    obstacle_field_deg=60.0, obstacle_min_height_m=-0.45,
    range_axis="down", range_cone_deg=90.0,
)  # fmt: skip
NAVIGATION = Path(__file__).resolve().parents[2] / "config" / "navigation.yaml"
NEAR_M, SHARE, SLACK_M = 3.0, 0.15, 0.1


def true_sectors(depth: np.ndarray, geometry: Any, slack_m: float = 0.0) -> tuple[np.ndarray, float, np.ndarray]:
    """Nearest true surface by sector, in a slice higher and deeper by `slack_m`; the nearest one down; its pixels.

    The last are those of each sector that lie within `SHARE` of its nearest.
    """
    k = geometry.intrinsics_left
    v, u = np.mgrid[: depth.shape[0], : depth.shape[1]]
    rays = np.stack([(u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], np.ones(depth.shape)], axis=-1)
    optical = (rays * depth[..., None]) @ np.asarray(geometry.rect_from_raw_left)
    base = (optical @ MOUNT.base_from_optical.T)[np.isfinite(depth)]
    down = -base[:, 2]
    in_cone = down > np.cos(np.deg2rad(PARAMS.range_cone_deg / 2)) * np.linalg.norm(base, axis=1)
    low, high = PARAMS.obstacle_min_height_m - slack_m, PARAMS.obstacle_max_height_m + slack_m
    level = base[(base[:, 2] >= low) & (base[:, 2] <= high)]
    number = round(PARAMS.obstacle_field_deg / PARAMS.obstacle_sector_deg)
    bearing = (
        np.rad2deg(np.arctan2(level[:, 1], level[:, 0])) + PARAMS.obstacle_field_deg / 2
    ) / PARAMS.obstacle_sector_deg
    flat = np.hypot(level[:, 0], level[:, 1])
    sectors = [flat[(bearing >= i) & (bearing < i + 1)] for i in range(number)]
    nearest = np.array([min(sector, default=np.nan) for sector in sectors])
    pixels = np.array([(sector <= near * (1 + SHARE)).sum() for sector, near in zip(sectors, nearest, strict=True)])
    return nearest, min(down[in_cone], default=np.nan), pixels


def too_near(sectors: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Sectors told nearer than the truth of themselves and both neighbors; unknown ones are not."""
    padded = np.pad(np.nan_to_num(truth, nan=np.inf), 1, constant_values=np.inf)
    allowed = np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])
    return sectors < np.minimum(allowed * (1 - SHARE), allowed - SLACK_M)


def run(scene: str, water: str, frames: int, size: tuple[int, int], seed: int) -> dict[str, float]:
    """Errors of one dive."""
    dive = Dive(SimulateParams(
        scene=scene, water=water, frames=frames, pitch_deg=PITCH_DEG, distance_m=1.6, speed_m_s=0.2, rate_hz=2.0,
        width=size[0], height=size[1], seed=seed,
    ))  # fmt: skip
    pipeline, find = Pipeline(PipelineParams.from_mapping(read_values(NAVIGATION))), FindObstacles(PARAMS, MOUNT)
    false = edge = told = near = seen = thin = 0
    fewest = round(PARAMS.obstacle_min_share * size[0] * size[1])
    errors: list[float] = []
    for index in range(frames):
        frame = dive.frame(index)
        raw = StereoPair(frame.left, frame.right, stamp_ns=frame.stamp_ns, calibration=dive.calibration)
        products = pipeline(raw)
        depth = products.depth
        true_depth = dive.true_depth(index, depth.geometry, *size)
        truth, below, pixels = true_sectors(true_depth, depth.geometry)
        nearby, _, _ = true_sectors(true_depth, depth.geometry, SLACK_M)
        around = find.look(depth, products.disparity)
        sectors = around.sectors().ranges
        told += int(np.isfinite(sectors).sum())
        wrong = too_near(sectors, nearby)
        false += int(wrong.sum())
        edge += int((too_near(sectors, truth) & ~wrong).sum())
        close = truth < NEAR_M
        near += int(close.sum())
        found = np.abs(sectors - truth) <= np.maximum(SLACK_M, SHARE * truth)
        seen += int((close & found).sum())
        thin += int((close & ~found & (pixels < fewest)).sum())
        down = around.along_axis()
        errors.append(abs(down.distance - below) / below if down is not None else np.nan)
    return {
        "told": told, "false_percent": 100 * false / max(told, 1), "edge": edge,
        "near": near, "seen_percent": 100 * seen / max(near, 1), "thin": thin,
        "range_error_percent": float(100 * np.nanmedian(errors)) if np.isfinite(errors).any() else float("nan"),
        "no_range_percent": float(100 * np.isnan(errors).mean()),
    }  # fmt: skip


def main() -> int:
    """Run all dives; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=10)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--seed", type=int, default=3, help="of the dives; defaults were chosen on 3")
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--waters", nargs="+", default=WATERS)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    print("scene    water  told  false %  edge  near  seen %  thin  range err %  no range %")
    table = {}
    for scene, water in itertools.product(args.scenes, args.waters):
        row = table[f"{scene} {water}"] = run(scene, water, args.frames, (width, height), args.seed)
        print(
            f"{scene:8} {water:5} {row['told']:5.0f} {row['false_percent']:8.2f} {row['edge']:5.0f} {row['near']:5.0f} "
            f"{row['seen_percent']:7.1f} {row['thin']:5.0f} "
            f"{row['range_error_percent']:12.2f} {row['no_range_percent']:11.1f}",
            flush=True,
        )
    if args.output:
        args.output.write_text(json.dumps(table, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
