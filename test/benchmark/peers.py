"""The project's matchers and those that one gets from PyPI, all called alike."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from drowned_pairs import Image
from numpy.typing import NDArray

from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair, Status, StereoGeometry

ROOT = Path(__file__).resolve().parents[2]
GEOMETRY = StereoGeometry(focal_px=500.0, cx_left=0.0, cx_right=0.0, cy=0.0)
#: A Python with OpenCV's contributed modules, which cannot be installed beside plain OpenCV.
CONTRIB = Path(os.environ.get("CONTRIB_PYTHON", ROOT / ".venv-contrib" / "bin" / "python"))
CONTRIB_HINT = (
    "python -m venv .venv-contrib && .venv-contrib/bin/pip install opencv-contrib-python-headless"
    "  (or CONTRIB_PYTHON=/elsewhere/bin/python)"
)


@dataclass(frozen=True)
class Found:
    """Disparity (H, W), px, NaN = none; sigma, px, energy, and what it calls occluded where the method has them.

    Whoever works in a process of its own says itself what it spent: wall and CPU seconds, MB.
    """

    disparity: NDArray[np.float32]
    sigma: NDArray[np.float32] | None = None
    energy: float = float("nan")
    occluded: NDArray[np.bool_] | None = None
    spent: tuple[float, float, float] | None = None


Matcher = Callable[[Image, Image, int], Found]


def ours(threads: int, **choice: str) -> Matcher:
    """Labels from 0 to one less than are given."""

    def match(left: Image, right: Image, labels: int) -> Found:
        pair = RectifiedPair(left, right, left, right, GEOMETRY, RectificationQuality("given"))
        params = MatchParams(min_disparity=0, max_disparity=labels - 1, match_threads=threads, **choice)  # type: ignore[arg-type]
        result = Match(params)(pair)
        occluded = (result.status & (Status.OCCLUDED | Status.OUTSIDE | Status.INCONSISTENT)) > 0
        return Found(result.disparity, result.sigma, result.energy, occluded)

    return match


def _rounded_up(labels: int) -> int:
    return -(-labels // 16) * 16


def sgbm(threads: int, mode: int, pad: bool = True, **settings: int) -> Matcher:
    """OpenCV's; padded on the left, so that it has no dead border there."""

    def match(left: Image, right: Image, labels: int) -> Found:
        border = _rounded_up(labels) if pad else 0
        left, right = (cv2.copyMakeBorder(i, 0, 0, border, 0, cv2.BORDER_REPLICATE) for i in (left, right))
        matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=_rounded_up(labels), mode=mode, **settings)
        return Found(_in_pixels(matcher.compute(left, right)[:, border:]))

    cv2.setNumThreads(threads)
    return match


def block_matching(threads: int) -> Matcher:
    """OpenCV's StereoBM as disparity_node of stereo_image_proc sets it."""

    def match(left: Image, right: Image, labels: int) -> Found:
        matcher = cv2.StereoBM_create(_rounded_up(labels), 15)
        matcher.setPreFilterCap(31)
        matcher.setUniquenessRatio(15)
        matcher.setTextureThreshold(10)
        matcher.setSpeckleWindowSize(100)
        matcher.setSpeckleRange(4)
        grays = (cv2.cvtColor(i, cv2.COLOR_RGB2GRAY) if i.ndim == 3 else i for i in (left, right))
        return Found(_in_pixels(matcher.compute(*grays)))

    cv2.setNumThreads(threads)
    return match


def _in_pixels(sixteenths: NDArray[np.int16]) -> NDArray[np.float32]:
    disparity = sixteenths.astype(np.float32) / 16
    return np.where(disparity < 0, np.float32(np.nan), disparity)


def weighted_least_squares(threads: int) -> Matcher:
    """Tuned SGBM, both ways, and OpenCV's contributed filter, in the other Python's process."""

    def match(left: Image, right: Image, labels: int) -> Found:
        with tempfile.TemporaryDirectory() as folder:
            np.savez(Path(folder) / "in.npz", left=left, right=right, labels=_rounded_up(labels), threads=threads)
            script = Path(__file__).with_name("wls_peer.py")
            subprocess.run([CONTRIB, script, folder], check=True, env={**os.environ, "PYTHONPATH": ""})
            with np.load(Path(folder) / "out.npz") as out:
                return Found(out["disparity"], spent=tuple(float(x) for x in out["spent"]))  # type: ignore[arg-type]

    return match


#: For the Middlebury pairs; `P1` and `P2` are for three channels.
TUNED = {"blockSize": 3, "P1": 8 * 27, "P2": 32 * 27, "disp12MaxDiff": 1, "uniquenessRatio": 10,
         "speckleWindowSize": 100, "speckleRange": 2}  # fmt: skip
#: Of disparity_node in stereo_image_proc.
ROS_DEFAULTS = {"blockSize": 15, "P1": 200, "P2": 400, "disp12MaxDiff": 0, "preFilterCap": 31, "uniquenessRatio": 15,
                "speckleWindowSize": 100, "speckleRange": 4}  # fmt: skip

METHODS: dict[str, Callable[[int], Matcher]] = {
    "graph_cut navigation": lambda t: ours(t, method="graph_cut", effort="navigation"),
    "graph_cut balanced": lambda t: ours(t, method="graph_cut", effort="balanced"),
    "graph_cut quality": lambda t: ours(t, method="graph_cut", effort="quality"),
    "kz2": lambda t: ours(t, method="kz2"),
    "SGBM 3WAY": lambda t: sgbm(t, cv2.STEREO_SGBM_MODE_SGBM_3WAY, **TUNED),
    "SGBM HH": lambda t: sgbm(t, cv2.STEREO_SGBM_MODE_HH, **TUNED),
    "SGBM + WLS": weighted_least_squares,
    "stereo_image_proc SGBM": lambda t: sgbm(t, cv2.STEREO_SGBM_MODE_SGBM, pad=False, **ROS_DEFAULTS),
    "stereo_image_proc BM": block_matching,
}
SLOW = ("kz2", "graph_cut quality")  #: measured once


def available(methods: list[str]) -> list[str]:
    """Those that can run here; says what is left out, and how to have it."""
    if "SGBM + WLS" in methods and not CONTRIB.is_file():
        sys.stderr.write(f"SGBM + WLS is left out: no {CONTRIB}; to have it: {CONTRIB_HINT}\n")
        return [name for name in methods if name != "SGBM + WLS"]
    return methods
