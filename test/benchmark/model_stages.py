"""What a model costs beyond matching, stage by stage: processor seconds a frame of a simulated dive.

OPENBLAS_NUM_THREADS=1 python test/benchmark/model_stages.py rich
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from dive_frames import DiveFrame, dive_frames
from dive_fusion import posed
from dive_model import DIVES, tracked

from uw_recon_ros.locate import estimate
from uw_recon_ros.model import compose
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.work import TileTask, World

#: What a stage is called here, where it is, the function.
STAGES: tuple[tuple[str, Any, str], ...] = (
    ("frame to frame", estimate, "_walked"),
    ("loops", estimate, "_loops"),
    ("the rig's error", estimate, "calibrate"),
    ("graph", estimate, "_solved"),
    ("bundles", estimate, "adjusted_links"),
    ("frames looked through", compose, "look_through"),
    ("fusion", compose, "fuse_all"),
    ("colours balanced", compose, "balance_of"),
    ("colours", compose, "color_all"),
    ("mesh", compose, "whole_mesh"),
    ("mesh and cloud written", compose, "_plain"),
    ("maps", compose, "write_maps"),
    ("texture", compose, "_glb"),
)


def timed(spent: dict[str, float], name: str, room: Any, function: str) -> None:
    """Count the processor time of a function of a module from now on."""
    plain = getattr(room, function)

    def counted(*args: Any, **kwargs: Any) -> Any:
        began = time.process_time()
        result = plain(*args, **kwargs)
        if function == "_plain":
            result = list(result)
        spent[name] += time.process_time() - began
        return result

    setattr(room, function, counted)


def model(frames: list[DiveFrame]) -> float:
    """Make one; processor seconds."""
    began = time.process_time()
    estimate.estimate_trajectory(tracked(frames))
    with tempfile.TemporaryDirectory() as room:
        compose.compose(TileTask([posed(frame) for frame in frames], Path(room), DiveModelParams(), World()))
    return time.process_time() - began


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dives", nargs="*", default=["rich"], help=f"of {', '.join(DIVES)}")
    parser.add_argument("--frames", type=Path, default=Path("bench_out/dives"), help="where frames are kept")
    parser.add_argument("--first", type=int, help="only so many frames")
    args = parser.parse_args()
    spent: dict[str, float] = defaultdict(float)
    for stage in STAGES:
        timed(spent, *stage)
    for name in args.dives:
        course, params = DIVES[name]
        frames = dive_frames(args.frames, "navigation", course, args.first, **params)
        model(frames[:6])  # kernels compiled
        spent.clear()
        whole = model(frames)
        sys.stdout.write(f"| {name}, {len(frames)} frames | CPU s a frame |\n| --- | --- |\n")
        for stage, _, _ in STAGES:
            sys.stdout.write(f"| {stage} | {spent[stage] / len(frames):.3f} |\n")
        sys.stdout.write(f"| all, reading of frames included | {whole / len(frames):.3f} |\n\n")


if __name__ == "__main__":
    main()
