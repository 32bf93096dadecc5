"""What tie points of real pairs say of the lenses' radial distortion, and what becomes of the rows.

    python test/benchmark/lens_distortion.py [FOLDER ...] [--bend K1 ...]

A folder holds a left and a right image, or folders ``left`` and ``right`` of them; without any, the real underwater
pairs and tank sessions of ``../shared/data`` are taken. With ``--bend`` both images are first warped as lenses of that
k1 would have taken them, and turned by about a degree (for pairs that are rectified and without distortion, such as
Middlebury's: 0 must come out as "none"). Columns: k1 at a focal length of (w + h) / sqrt(3), or none; root mean square
error at tie points left out of the fit, without the lens and with it, px; focal length, px; processor time, s.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from drowned_pairs import STEREO, Image

from uw_recon_ros.errors import ReconError
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.rectify import lens_search
from uw_recon_ros.rectify.lens import Lens
from uw_recon_ros.rectify.model_selection import choose_axis, rows_already_aligned
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.shape import USUAL_FOCAL
from uw_recon_ros.rectify.tie_points import find_tie_points, thinned
from uw_recon_ros.types import StereoPair

DATA = STEREO.parent
SHARED = ("underwater/flsea_canyon", "underwater/caddy_diver", "underwater_dim/reef", "calibration/tank_water",
          "calibration/tank_air")  # fmt: skip
TURNS = ((0.6, -1.0, 0.5), (-0.3, 1.0, -0.7))  # deg
PARAMS = RectifyParams()


def files(folder: Path) -> Iterator[tuple[str, Path, Path]]:
    """Name, left and right of the pairs in a folder."""
    if (folder / "left").is_dir():
        for left in sorted((folder / "left").iterdir()):
            yield f"{folder.name} {left.stem}", left, folder / "right" / left.name
    else:
        yield folder.name, next(folder.glob("left.*")), next(folder.glob("right.*"))


def as_bent(image: Image, k1: float, turn_deg: tuple[float, float, float]) -> Image:
    """As a lens of that distortion, turned, would have taken it."""
    height, width = image.shape[:2]
    focal = USUAL_FOCAL * (width + height)
    k = np.array([[focal, 0, (width - 1) / 2], [0, focal, (height - 1) / 2], [0, 0, 1.0]])
    turn = cv2.Rodrigues(np.radians(np.array(turn_deg)))[0]
    maps = cv2.initUndistortRectifyMap(k, None, turn, k, (width, height), cv2.CV_32FC1)
    turned = cv2.remap(image, *maps, cv2.INTER_CUBIC)
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), -1).reshape(-1, 1, 2).astype(np.float64)
    places = cv2.undistortPoints(grid, k, np.array([k1, 0, 0, 0, 0.0]), P=k).reshape(height, width, 2)
    return np.asarray(cv2.remap(turned, places.astype(np.float32), None, cv2.INTER_CUBIC), np.uint8)


def row(name: str, left: Image, right: Image) -> str:
    """The table's row of a pair."""
    tie_points = find_tie_points(Preprocess(PreprocessParams())(StereoPair(left, right)), PARAMS)
    without = choose_axis(thinned(tie_points, PARAMS.tie_points_max, PARAMS.rectify_seed), PARAMS)
    if rows_already_aligned(without, PARAMS):
        return f"| {name} | rows as given: not asked |" + " |" * 4
    begun = time.process_time()
    found = lens_search.find_lens(without, PARAMS)
    spent = time.process_time() - begun
    width, height = without.everything.width, without.everything.height
    k1 = found.lens.distortion(USUAL_FOCAL * (width + height), width, height)[0]
    before = lens_search.left_over(without.fit, without.held_out)
    after = lens_search.left_over(found.fit, found.lens.straightened(found.held_out))
    told = f"{k1:.2f}" if found.lens != Lens() and k1 else "none"
    return (
        f"| {name} | {told} | {before:.3f} | {after:.3f} | {without.fit.focal_px:.0f} | {found.fit.focal_px:.0f} | "
        f"{spent:.1f} |"
    )


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, default=[DATA / name for name in SHARED])
    parser.add_argument("--bend", nargs="*", type=float)
    args = parser.parse_args()
    columns = ("pair", "k1", "left over, px", "with the lens", "focal, px", "with the lens", "CPU, s")
    sys.stdout.write(f"| {' | '.join(columns)} |\n" + "|" + " --- |" * len(columns) + "\n")
    for folder in args.folders:
        for name, *paths in files(folder):
            images = [np.ascontiguousarray(cv2.imread(str(path))[..., ::-1]) for path in paths]
            for k1 in args.bend or [None]:
                seen = images if k1 is None else [as_bent(i, k1, t) for i, t in zip(images, TURNS, strict=True)]
                try:
                    told = row(name if k1 is None else f"{name}, bent by {k1:g}", *seen)
                except ReconError as error:
                    told = f"| {name} | refused: {error.code} |" + " |" * 5
                sys.stdout.write(told + "\n")
                sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
