"""Depth error of a calibration in air behind a dome whose centre is not the lens's, by the simulator's tracer.

``python test/benchmark/dome_table.py``: domes of 50 mm inner radius, 5 mm thick, points at 0.5 to 3 m.
"""

from __future__ import annotations

import sys

import numpy as np

from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.ports import Dome, look_through, pixels_of
from uw_recon_ros.simulate.rig import make_rig


def depth_error(off_mm: float, axis: int, range_m: float) -> float:
    """Largest relative error of depth over drawn points."""
    rig = make_rig(SimulateParams(seed=3, fov_deg=62.0))
    dome = Dome(0.05, 0.005, off_mm / 1e3 * np.eye(3)[axis])
    rng = np.random.default_rng(0)
    pixels = np.stack([rng.uniform(150, 600, 12), rng.uniform(40, 440, 12)], axis=1)
    origins, directions = look_through(rig.calibration.left, dome)(pixels)
    points = origins + ((range_m - origins[:, 2]) / directions[:, 2])[:, None] * directions
    left, right = pixels_of(rig, points, (dome, dome))
    made = rectification_from_calibration(rig.calibration, RectifyParams())
    rectified = made.left.rectified(left), made.right.rectified(right)
    depth = made.geometry.depth_from_disparity(rectified[0][:, 0] - rectified[1][:, 0])
    return float(np.abs(depth / (points @ made.left.r.T)[:, 2] - 1).max())


def main() -> None:
    """Print the table."""
    write = sys.stdout.write
    write("| off centre | along the axis, 1 m | 3 m | across it, 1 m | 3 m |\n| --- | --- | --- | --- | --- |\n")
    for off in (1, 2, 5, 10):
        cells = [f"{100 * depth_error(off, axis, r):.1f} %" for axis in (2, 0) for r in (1.0, 3.0)]
        write(f"| {off} mm | {' | '.join(cells)} |\n")


if __name__ == "__main__":
    main()
