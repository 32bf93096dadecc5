"""Twelve megapixels: coarse to fine, in bounded memory. In a process of its own, whose peak is its own."""

import json
import subprocess
import sys

import pytest

MOST_MB = 1600  # 12 megapixels and 200 labels at once would be 12 GB
SCRIPT = """
import json, resource
import cv2
import numpy as np
from uw_recon_ros.match.planes.matcher import graph_cut

height, width = 3001, 4003
left = cv2.resize(np.random.default_rng(3).integers(0, 256, (height // 3, width // 3), np.uint8), (width, height))
rows, columns = np.mgrid[0:height, 0:width].astype(np.float32)
truth = 40 + np.float32(0.03) * rows[:, :1]  # a floor
right = cv2.remap(left, columns + truth, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
del rows, columns
result = graph_cut(left, right, 0, 200, effort="navigation", threads=2)
inside = slice(None), slice(200, None)
error = np.abs(result.disparity - truth)[inside]
print(json.dumps({
    "shape": result.disparity.shape, "density": float(np.isfinite(error).mean()), "median": float(np.nanmedian(error)),
    "bad": float((error > 2).mean()), "mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
}))
"""


@pytest.mark.slow
def test_twelve_megapixels_in_bounded_memory() -> None:
    done = subprocess.run([sys.executable, "-c", SCRIPT], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["shape"] == [3001, 4003]
    assert found["density"] > 0.95
    assert found["median"] < 0.6  # the start is made of images a quarter as large: 0.15 of its pixels
    assert found["bad"] < 0.02
    assert found["mb"] < MOST_MB
