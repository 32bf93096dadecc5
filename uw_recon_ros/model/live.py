"""What a live model leaves on the disk: key frames as they come, and the model's files when they are asked for."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from uw_recon_ros import __version__
from uw_recon_ros.errors import ModelError
from uw_recon_ros.files.atomic import is_taken, write_json
from uw_recon_ros.files.trajectories import write_tum
from uw_recon_ros.findings import Code
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.model.compose import compose
from uw_recon_ros.model.kept_frames import placed
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.work import TileTask, World
from uw_recon_ros.survey.kept_frame import read_kept, write_kept
from uw_recon_ros.system_errors import explain
from uw_recon_ros.trajectory import DisparityFrame, PoseStatus, trajectory_of
from uw_recon_ros.types import Matrix

_PARTIAL = ".part"


class KeyFrameFolder:
    """Key frames in a folder of their own, which goes when they are no longer needed."""

    def __init__(self) -> None:
        self.folder = Path(tempfile.mkdtemp(prefix="uw_recon_model_"))

    def path(self, stamp_ns: int) -> Path:
        """Of the frame of that stamp."""
        return self.folder / f"{stamp_ns:020d}.frame"

    def add(self, frame: DisparityFrame) -> None:
        """Keep a frame.

        Raises
        ------
        OSError
            It cannot be written.
        """
        write_kept(self.path(frame.stamp_ns), frame)

    def remove(self) -> None:
        """Free the disk."""
        shutil.rmtree(self.folder, ignore_errors=True)


class _Posed(Sequence[PosedFrame]):
    """Kept frames where they were taken, read when asked for."""

    def __init__(self, paths: list[Path], poses: Matrix) -> None:
        self.paths, self.poses = paths, poses

    def __len__(self) -> int:
        return len(self.paths)

    def __getitem__(self, index: Any) -> Any:
        return placed(read_kept(self.paths[index]), self.poses[index])


def expect_room(folder: str | Path) -> None:
    """Refuse a folder that holds something already.

    Raises
    ------
    ModelError
    """
    place = Path(folder)
    if is_taken(place):
        raise ModelError(f"{place}: expected an empty folder or none, got one that holds something", Code.MODEL_EXISTS)


def save_model(
    folder: str | Path, paths: list[Path], stamps_ns: list[int], poses: Matrix, tell: Callable[[str, int, int], None]
) -> dict[str, Any]:
    """Fuse kept frames as ``uw_recon model`` does, and write mesh, cloud, maps and ``trajectory.txt``.

    Parameters
    ----------
    folder : path
        Appears when all is written; empty or not there before.
    paths : list of path
        Kept frames.
    stamps_ns, poses : (N,), (N, 4, 4)
        Map <- left rectified view of each.
    tell : callable
        Called with a step's name, how much of it is done, and how much there is.

    Raises
    ------
    ModelError
        There is no surface, the folder holds something, or the disk is full.
    """
    expect_room(folder)
    place = Path(folder)
    partial = place.with_name(place.name + _PARTIAL)
    try:
        shutil.rmtree(partial, ignore_errors=True)
        partial.mkdir(parents=True)
        made = compose(TileTask(_Posed(paths, poses), partial, DiveModelParams(), World(), tell))
        write_tum(partial / "trajectory.txt", trajectory_of(stamps_ns, poses, status=PoseStatus.TRACKED))
        summary = {
            "scale": "metric", "poses": "map <- left rectified optical frame; z up as odometry's frame has it",
            "files": [*made.files, "trajectory.txt"], "versions": {"uw_recon_ros": __version__}, **made.statistics,
            "warnings": [finding.as_dict() for finding in made.findings],
        }  # fmt: skip
        write_json(partial / "model.json", summary, durable=False)
        if place.is_dir():
            place.rmdir()
        os.replace(partial, place)
    except OSError as error:
        raise ModelError(f"{place}: not written: {explain(error)}", Code.MODEL_DISK) from error
    return summary
