"""What of a long model's memory grows with its frames: the most each stage takes, and how it grows with the length.

    OPENBLAS_NUM_THREADS=1 python test/benchmark/memory_by_stage.py 300 900

The frames of `long_dive.py`, drawn when they are asked for, in one process for each count. Anonymous memory at its most
while a stage runs, MB; what a stage of 10,000 frames would take is the line through the two lengths, and is an
extrapolation. The mesh is whole up to a million triangles and taken column by column beyond: its line ends there.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, overload

import numpy as np
from long_dive import Diver, track
from model_stages import STAGES

from uw_recon_ros.fuse.frame import PosedFrame, posed_frame
from uw_recon_ros.locate.estimate import estimate_trajectory
from uw_recon_ros.model.compose import compose
from uw_recon_ros.model.keypoint_file import KeypointFile
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.work import TileTask, World
from uw_recon_ros.trajectory import DisparityFrame

_LONG = 10_000
_SIZE = (160, 120)


class Drawn(Sequence[PosedFrame]):
    """Frames at their true poses."""

    def __init__(self, poses: np.ndarray) -> None:
        self.poses, self.diver = poses, Diver(*_SIZE)

    def __len__(self) -> int:
        return len(self.poses)

    @overload
    def __getitem__(self, number: int) -> PosedFrame: ...
    @overload
    def __getitem__(self, number: slice) -> list[PosedFrame]: ...
    def __getitem__(self, number: int | slice) -> PosedFrame | list[PosedFrame]:
        if isinstance(number, slice):
            return [self[k] for k in range(*number.indices(len(self)))]
        if not 0 <= number < len(self):
            raise IndexError(number)
        frame, g = self.diver.frame(number, self.poses[number]), self.diver.geometry
        lens = np.array([g.focal_px, g.focal_px, g.cx_left, g.cy])
        return posed_frame(frame, self.poses[number], lens, g.focal_times_baseline, g.offset_px)

    def walk(self) -> Iterator[DisparityFrame]:
        """As they come."""
        for number, pose in enumerate(self.poses):
            yield self.diver.frame(number, pose)


def anonymous_mb() -> float:
    """What this process holds now that is no file's."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return float(status.split("RssAnon:")[1].split()[0]) / 1024


class Watch:
    """The most memory while each stage runs."""

    def __init__(self) -> None:
        self.most: dict[str, float] = {}

    def over(self, name: str, room: Any, function: str) -> None:
        """Watch a function of a module from now on."""
        plain = getattr(room, function)

        def watched(*args: Any, **kwargs: Any) -> Any:
            done, high = threading.Event(), [anonymous_mb()]

            def look() -> None:
                while not done.wait(0.02):
                    high[0] = max(high[0], anonymous_mb())

            looker = threading.Thread(target=look)
            looker.start()
            try:
                result = plain(*args, **kwargs)
                return list(result) if function == "_plain" else result
            finally:
                done.set()
                looker.join()
                self.most[name] = max(self.most.get(name, 0.0), high[0], anonymous_mb())

        setattr(room, function, watched)


def alone(count: int) -> None:
    """One length; a line a stage on standard output."""
    poses = track(count, 0)
    poses[:, 2, 3] = 1.2
    watch, frames = Watch(), Drawn(poses)
    for stage in STAGES:
        watch.over(*stage)
    with tempfile.TemporaryDirectory() as room:
        with KeypointFile(room) as shelf:
            estimate_trajectory(frames.walk(), shelf=shelf)
        compose(TileTask(frames, Path(room), DiveModelParams(voxel_m=0.02), World()))
    for name, most in watch.most.items():
        sys.stdout.write(f"{name}={most:.1f}\n")


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("counts", nargs=2, type=int)
    parser.add_argument("--alone", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    few, many = sorted(args.counts)
    if args.alone:
        return alone(few)
    found = []
    for count in (few, many):
        words = [sys.executable, __file__, "--alone", str(count), str(count)]
        said = subprocess.run(words, check=True, capture_output=True, text=True).stdout
        found.append(
            {name: float(most) for name, most in (line.split("=") for line in said.splitlines() if "=" in line)}
        )
    sys.stdout.write(
        f"| stage | {few} frames, MB | {many} frames, MB | kB a frame | {_LONG:,} frames, MB |\n" + "| --- " * 5 + "|\n"
    )
    for name, low in found[0].items():
        slope = (found[1][name] - low) / (many - few)
        whole = found[1][name] + slope * (_LONG - many)
        sys.stdout.write(f"| {name} | {low:.0f} | {found[1][name]:.0f} | {1024 * slope:.0f} | {whole:.0f} |\n")
    return None


if __name__ == "__main__":
    main()
