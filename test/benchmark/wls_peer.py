"""SGBM and the weighted-least-squares filter of OpenCV's contributed modules (Apache-2.0), for `peers.py`.

    PYTHON_WITH_CONTRIB wls_peer.py FOLDER

Reads ``in.npz`` (left, right, labels, threads), leaves ``out.npz`` (disparity, and spent: wall s, CPU s, MB).
"""

from __future__ import annotations

import resource
import sys
import time
from pathlib import Path

import cv2
import numpy as np


def match(left, right, labels):  # type: ignore[no-untyped-def]
    """Disparity, px, dense."""
    settings = {"blockSize": 3, "P1": 8 * 27, "P2": 32 * 27, "mode": cv2.STEREO_SGBM_MODE_SGBM_3WAY}
    matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=labels, **settings)
    back = cv2.ximgproc.createRightMatcher(matcher)
    wls = cv2.ximgproc.createDisparityWLSFilter(matcher)
    wls.setLambda(8000)
    wls.setSigmaColor(1.5)
    padded = [cv2.copyMakeBorder(i, 0, 0, labels, 0, cv2.BORDER_REPLICATE) for i in (left, right)]
    there, here = matcher.compute(*padded), back.compute(*padded[::-1])
    filtered = wls.filter(there, padded[0], disparity_map_right=here)
    return filtered[:, labels:].astype(np.float32) / 16


def main() -> int:
    """Match three times; the least times count."""
    folder = Path(sys.argv[1])
    with np.load(folder / "in.npz") as given:
        left, right, labels, threads = given["left"], given["right"], int(given["labels"]), int(given["threads"])
    cv2.setNumThreads(threads)
    match(left[:48, :64], right[:48, :64], 16)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    spent = []
    for _ in range(3):
        cpu, wall = time.process_time(), time.perf_counter()
        disparity = match(left, right, labels)
        spent.append((time.perf_counter() - wall, time.process_time() - cpu))
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    np.savez(
        folder / "out.npz", disparity=disparity, spent=[*(min(times) for times in zip(*spent, strict=True)), memory]
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
