"""Where key points are said to be: blobs whose middle is known."""

from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros.track.keypoints import find_keypoints
from uw_recon_ros.track.params import TrackParams


@pytest.mark.parametrize("spread", [2.0, 4.0, 8.0])
def test_a_blob_is_found_where_it_is(spread: float) -> None:
    """OpenCV's SIFT tells a quarter of a pixel too much: a camera that turns would see the bottom move."""
    v, u = np.mgrid[:200, :200]
    image = 60 + 150 * np.exp(-((u - 100.3) ** 2 + (v - 90.6) ** 2) / (2 * spread**2))
    flat = np.full(u.shape, 20.0, np.float32)
    found = find_keypoints(image.round().astype(np.uint8), flat, flat / 100, TrackParams(clahe_clip=0.0))
    assert len(found) > 0
    near = found.measured[np.linalg.norm(found.measured[:, :2] - (100.3, 90.6), axis=1) < 2]
    assert len(near) > 0
    assert np.abs(near[:, :2] - (100.3, 90.6)).max() < 0.1
