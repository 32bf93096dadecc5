"""Draw the pictures of docs/gallery.md from simulated dives, and print its table.

    python tools/gallery_pictures.py [NAME ...] [--output docs/images]

Leaves a ``gallery_NAME.jpg`` a scene: the raw left image; what is shown of it, rectified; the true disparity; ours; and
the surface, shaded by its normals. Gray stays what has no disparity, by its reason. Nothing of it is a real picture.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uw_recon_ros.files.images import write_image
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.report.colors import colorize
from uw_recon_ros.report.figures import colorize_disparity, disparity_bar
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import ByteImage, PointCloud, StereoPair

ROOT = Path(__file__).resolve().parents[1]
WIDTH, GAP, SUN, NOTHING = 230, 6, (-0.4, -0.7, -0.6), 70
DAY: dict[str, Any] = {"lamp": 0.0, "daylight": 1.0}
AHEAD: dict[str, Any] = {"pitch_deg": 15.0, "distance_m": 1.5, **DAY}
SCENES: dict[str, dict[str, Any]] = {
    "lamp": {"scene": "amphora", "water": "3C"},
    "open_water": {"scene": "reef", "water": "II", "look_up_deg": 28.0, **DAY},
    "wreck": {"scene": "wreck", "water": "IB", "look_up_deg": 12.0, **AHEAD},
    "surface": {
        "scene": "reef",
        "water": "IB",
        "surface_above": True,
        "look_up_deg": 28.0,
        "water_depth_m": 3.0,
        **AHEAD,
    },
    "other_lamps": {
        "scene": "reef",
        "water": "3C",
        "other_lamps": 3,
        "look_up_deg": 10.0,
        **AHEAD,
        "lamp": 1.0,
        "daylight": 0.35,
    },
    "dead_red": {"scene": "pipe", "water": "IB", "dead_channel": "red", "caustics": 0.4, "fish": 4, **DAY},
    "murk": {"scene": "pipe", "water": "9C"},
    "snow": {"scene": "amphora", "water": "3C", "snow_per_m3": 2500.0, "look_up_deg": 20.0},
    "mud": {"scene": "plane", "water": "5C", "texture": "weak"},
    "letterbox": {"scene": "reef", "water": "1C", "letterbox_share": 0.12, "distortion": -0.5, "port_dirt": 0.8},
}


def shaded(cloud: PointCloud) -> ByteImage:
    """An organised cloud's colours under a light from above."""
    assert cloud.normals is not None
    facing = np.clip(cloud.normals @ (np.array(SUN) / np.linalg.norm(SUN)), 0, 1)
    lit = cloud.colors * (0.25 + 0.9 * facing)[..., None]
    return np.where(np.isfinite(lit), np.clip(lit, 0, 255), NOTHING).astype(np.uint8)


def sheet(pictures: list[ByteImage]) -> ByteImage:
    """Side by side, one height."""
    height = min(round(WIDTH * p.shape[0] / p.shape[1]) for p in pictures)
    scaled = [cv2.resize(p, (WIDTH, height), interpolation=cv2.INTER_AREA) for p in pictures]
    white = np.full((height, GAP, 3), 255, np.uint8)
    return np.hstack([part for picture in scaled for part in (picture, white)][:-1])


def draw(name: str, folder: Path) -> str:
    """Write a scene's picture; its row of the table."""
    dive = Dive(SimulateParams(width=400, height=300, frames=1, **SCENES[name]))
    taken = dive.frame(0)
    enhanced = Preprocess()(StereoPair(taken.left, taken.right, taken.stamp_ns, "left", dive.calibration))
    pair = Rectify(RectifyParams())(enhanced, RigTracker(RectifyParams()).update(enhanced))
    height, width = pair.left.shape[:2]
    truth = dive.true_disparity(0, pair.geometry, width, height)
    found = Match(MatchParams())(pair)
    stage = Reconstruct()
    cloud = stage.cloud(stage.depth(found), pair.left)
    bar = disparity_bar(found)
    pictures = [taken.left, pair.left, colorize(truth, bar), colorize_disparity(found, bar), shaded(cloud)]
    write_image(folder / f"gallery_{name}.jpg", sheet(pictures))
    known, real = np.isfinite(found.disparity), np.isfinite(truth)
    wrong = np.abs(found.disparity - truth)[known & real] > 1
    claimed = f"{100 * known[~real].mean():.1f}" if (~real).mean() > 0.02 else "-"
    return f"| {name} | {100 * known[real].mean():.0f} | {100 * wrong.mean():.1f} | {claimed} |"


def main() -> int:
    """Draw all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "docs" / "images")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(SCENES))
    args = parser.parse_args()
    for name in args.names or SCENES:
        sys.stdout.write(draw(name, args.output) + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
