"""A simulated dive as bag, as one video with both views, and as two videos whose clocks differ: one depth."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.dives import PARAMS, make_dive
from helpers.videos import write_video

from uw_recon_ros.cli import main
from uw_recon_ros.files.calibrations import write_calibration
from uw_recon_ros.recordings.recording import Recording

FRAMES, LATE = 4, 1  # the right camera of the two videos was started so many frames before the left one


@pytest.fixture(scope="module")
def dive(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Recordings of one dive."""
    room = tmp_path_factory.mktemp("dive")
    (room / "small.yaml").write_text(PARAMS)
    make_dive(room / "bag", FRAMES, width=160, height=120)
    with Recording(room / "bag") as recording:
        pairs = list(recording.pairs())
    for name in ("both", "two"):
        (room / name).mkdir()
        write_calibration(pairs[0].calibration, room / name / "calibration.yaml")  # type: ignore[arg-type]
    joined = [np.concatenate([pair.left, pair.right], axis=1) for pair in pairs]
    write_video(room / "both" / "dive.mp4", joined, 2, quality=4)
    write_video(room / "two" / "GX01_left.mp4", [pair.left for pair in pairs[LATE:]], 2, quality=4)
    write_video(room / "two" / "GX07_right.mp4", [pair.right for pair in pairs], 2, quality=4)
    return room


def depths(dive: Path, name: str, *more: str) -> list[np.ndarray]:
    out = dive / f"survey_{name}"
    arguments = ["--params", str(dive / "small.yaml"), "--write", "depth", "--jobs", "1", "--quiet", *more]
    assert main(["survey", str(dive / name), "-o", str(out), *arguments]) == 0
    return [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted((out / "depth").glob("*.tiff"))]


@pytest.mark.slow
def test_videos_and_bag_give_one_depth(dive: Path) -> None:
    of_bag = depths(dive, "bag")
    assert len(of_bag) == FRAMES
    for found, expected in ((depths(dive, "both", "--layout", "side-by-side"), of_bag),
                            (depths(dive, "two", "--clock-offset", str(LATE / 2)), of_bag[LATE:])):  # fmt: skip
        assert len(found) == len(expected)
        for one, other in zip(found, expected, strict=True):
            both = np.isfinite(one) & np.isfinite(other)
            assert both.mean() > 0.5 * np.isfinite(other).mean()
            assert np.median(np.abs(one[both] / other[both] - 1)) < 0.02  # half a pixel of disparity is 0.03
