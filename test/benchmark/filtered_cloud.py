"""CPU time of the filtered cloud at its worst: voxels, ranges and shapes that no dive shows.

    python test/benchmark/filtered_cloud.py [--points 307200 2073600]

One thread; the median of three runs, the defaults of the stage but for what a line names. "passes" is how often the
voxels had to grow.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.reconstruct import cloud as module
from uw_recon_ros.reconstruct.cloud import thin_cloud
from uw_recon_ros.reconstruct.stage import ReconstructParams
from uw_recon_ros.types import PointCloud

DEFAULT = ReconstructParams()


def shapes(count: int) -> dict[str, tuple[NDArray[Any], dict[str, float]]]:
    """Clouds of `count` points, and what is set besides the defaults."""
    rng = np.random.default_rng(0)
    side = int(np.ceil(count ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)[:count] - side / 2 + 0.5
    width = int(np.sqrt(count * 4 / 3))
    u, v = np.meshgrid(np.linspace(-0.6, 0.6, width), np.linspace(-0.45, 0.45, count // width))
    z = 1.5 + 0.3 * v + 0.05 * rng.standard_normal(u.shape)
    floor = np.stack([u * z, v * z, z], axis=-1).reshape(-1, 3)
    far = {"max_range": 1000.0, "voxel": 1e-4}
    return {
        "a noisy floor, defaults": (floor, {}),
        "all NaN": (np.full((count, 3), np.nan), {}),
        "all in one voxel": (np.full((count, 3), 0.7), {}),
        "white noise in 20 m": (rng.uniform(-11, 11, (count, 3)), {}),
        "white noise in 1 km, voxel 0.1 mm": (rng.uniform(-570, 570, (count, 3)), far),
        "a lattice just over the limit": (grid * 1.0, {**far, "max_points": int(0.95 * count)}),
        "a lattice far over the limit": (grid * 1.0, {**far, "max_points": 8}),
    }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--points", type=int, nargs="+", default=[640 * 480, 1920 * 1080])
    args = parser.parse_args()
    passes = [0]
    number = module._occupied

    def counted(cells: NDArray[np.int32]) -> tuple[NDArray[np.int32], int]:
        passes[0] += 1
        return number(cells)

    module._occupied = counted
    sys.stdout.write("| points | cloud | kept | passes | CPU s |\n| --- | --- | --- | --- | --- |\n")
    for count in args.points:
        for name, (points, special) in shapes(count).items():
            cloud = PointCloud(points.astype(np.float32), np.zeros(points.shape, np.uint8), metric=True)
            limits: dict[str, Any] = {
                "min_range": DEFAULT.cloud_min_range, "max_range": DEFAULT.cloud_max_range,
                "voxel": DEFAULT.cloud_voxel, "max_points": DEFAULT.cloud_max_points, **special,
            }  # fmt: skip
            spent = []
            for _ in range(3):
                passes[0], started = 0, time.process_time()
                thin = thin_cloud(cloud, **limits)
                spent.append(time.process_time() - started)
            seconds = statistics.median(spent)
            sys.stdout.write(f"| {count} | {name} | {len(thin.points)} | {passes[0]} | {seconds:.3f} |\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
