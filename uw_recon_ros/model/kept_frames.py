"""The frames a survey kept, read one by one."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np

from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code
from uw_recon_ros.fuse.frame import PosedFrame, posed_frame
from uw_recon_ros.survey.kept_frame import KEPT, is_metric, read_kept
from uw_recon_ros.track.keypoints import RigError, constants
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix


class KeptFrames:
    """Kept frames in the order of time; of one scale.

    Parameters
    ----------
    survey : path

    Raises
    ------
    ModelError
        No survey, not finished, or it kept no frames.
    """

    def __init__(self, survey: str | Path) -> None:
        root = Path(survey)
        if not (root / "state" / "settings.json").is_file():
            raise ModelError(f"{root}: expected the folder of a survey, got none", Code.MODEL_NO_SURVEY)
        if not (root / "state" / "finished.json").is_file():
            text = "expected a finished survey, got one under way: the survey's command goes on with it"
            raise ModelError(f"{root}: {text}", Code.MODEL_NO_SURVEY)
        self.paths = sorted((root / KEPT).glob("*.frame"))
        if not self.paths:
            text = f"expected frames in {KEPT}/, got none: survey anew with --write model (or ...,model)"
            raise ModelError(f"{root}: {text}", Code.MODEL_NOT_KEPT)
        if len(self.paths) < 2:
            raise ModelError(f"{root}: expected at least two frames, got one", Code.MODEL_NO_OVERLAP)
        self.dropped = 0
        self.read = lru_cache(maxsize=8)(lambda k: read_kept(self.paths[k]))

    def walk(self) -> Iterator[DisparityFrame]:
        """Each frame once; those of another scale or out of order are dropped."""
        kept, last, metric = [], -1, any(is_metric(path) for path in self.paths)
        for path in self.paths:
            frame = read_kept(path)
            if frame.geometry.metric != metric or frame.stamp_ns <= last:
                self.dropped += 1
                continue
            kept.append(path)
            last = frame.stamp_ns
            yield frame
        self.paths = kept
        self.read.cache_clear()  # numbers mean other frames now

    def posed(self, k: int, pose: Matrix, error: RigError) -> PosedFrame:
        """A frame as it is fused, the rig's error corrected."""
        return placed(self.read(k), pose, error)


def placed(frame: DisparityFrame, pose: Matrix, error: RigError | None = None) -> PosedFrame:
    """A frame as it is fused at `pose`, (4, 4) world <- left rectified view, the rig's error corrected."""
    fx, fy, cx, cy, fb, offset = constants(frame.geometry, error or RigError())
    return posed_frame(frame, pose, np.array([fx, fy, cx, cy]), fb, offset)
