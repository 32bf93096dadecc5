"""Key points kept in a file are those that were kept, and nothing of the file is left."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from uw_recon_ros.model.keypoint_file import KeypointFile
from uw_recon_ros.track.keypoints import PackedKeypoints


def made(count: int, seed: int) -> PackedKeypoints:
    rng = np.random.default_rng(seed)
    return PackedKeypoints(
        rng.normal(size=(count, 3)).astype(np.float32), rng.normal(size=count).astype(np.float32),
        rng.integers(0, 256, (count, 128)).astype(np.uint8),
    )  # fmt: skip


def test_each_frames_are_read_again_in_any_order(tmp_path: Path) -> None:
    frames = [made(count, k) for k, count in enumerate((5, 0, 600, 1))]
    with KeypointFile(tmp_path) as shelf:
        for frame in frames[:3]:
            shelf.append(frame)
        assert (shelf[2].descriptors == frames[2].descriptors).all()
        shelf.append(frames[3])  # written after it was read from
        for number in (3, 0, 2, 1):
            found = shelf[number]
            for name in ("measured", "sigma", "descriptors"):
                assert np.array_equal(getattr(found, name), getattr(frames[number], name))
    assert not list(tmp_path.iterdir())
