"""The demo's page and table."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from collect import PER_FRAME, Collector
from frames import Frame
from rclpy.serialization import serialize_message

from uw_recon_ros.bags.model import RawMessage
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.files.meshes import write_glb, write_ply
from uw_recon_ros.progress import say
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.report.numbers import measured, percent
from uw_recon_ros.report.page import Section
from uw_recon_ros.report.pair import write_pair_page
from uw_recon_ros.types import EnhancedPair, RectificationQuality, RectifiedPair, StereoPair

Diagnostics = Mapping[str, Mapping[str, str]]
FRAME_HEADER = ("Frame", "Pixels matched", "Pixels with a depth", "Depth error, median", "of the depth",
                "Within 5 %", "Camera to cloud")  # fmt: skip
NODE_HEADER = ("Node", "Work on a frame", "Dropped")


def frame_rows(frames: Sequence[Frame], latency: Mapping[int, float]) -> list[tuple[str, ...]]:
    """A row a frame."""
    rows: list[tuple[str, ...]] = []
    for number, frame in enumerate(frames, 1):
        errors = frame.errors
        rows.append((
            f"{number}", percent(frame.disparity.density), percent(errors.density), measured(errors.median, "m"),
            percent(errors.median_relative), percent(errors.within_5_percent),
            f"{latency.get(frame.stamp_ns, float('nan')):.2f} s",
        ))  # fmt: skip
    return rows


def node_rows(diagnostics: Diagnostics) -> list[tuple[str, ...]]:
    """A row a node, from what it says of itself on /diagnostics."""
    rows = []
    for name, values in sorted(diagnostics.items()):
        dropped = [f"{v} {k.removeprefix('dropped: ')}" for k, v in values.items() if k.startswith("dropped: ")]
        rows.append((name, f"{values.get('work [s]', '')} s", ", ".join(dropped) or "none"))
    return rows


def typical(frames: Sequence[Frame]) -> Frame:
    """A typical frame: of median error."""
    return sorted(frames, key=lambda f: f.errors.median_relative)[len(frames) // 2]


def _as_reported(rectified: RectifiedPair, said: Mapping[str, str]) -> RectifiedPair:
    """The pair with the quality that rectify_node reports on /diagnostics."""
    quality = RectificationQuality(
        said.get("rectification", "unknown"),
        float(said.get("row_error_median_px", "nan")),
        float(said.get("row_error_p95_px", "nan")),
        int(said.get("inliers", "0")),
    )
    return replace(rectified, quality=quality)


def write_demo_page(
    path: Path,
    frames: Sequence[Frame],
    raw: Mapping[int, StereoPair],
    collector: Collector,
) -> Path:
    """Show a typical frame and the numbers of all."""
    frame = typical(frames)
    rectified = _as_reported(frame.rectified, collector.diagnostics.get("rectify_node", {}))
    surface = Reconstruct(ReconstructParams()).surface(frame.depth, frame.rectified.left)
    enhanced = EnhancedPair(*frame.enhanced, frame.rectified.left_matching, frame.rectified.right_matching)
    more = [
        Section("All frames of the replay", "", (), frame_rows(frames, collector.latency), FRAME_HEADER),
        Section("The nodes, as they report on /diagnostics", "", (), node_rows(collector.diagnostics), NODE_HEADER),
    ]
    lead = (
        f"A simulated dive with known depth, replayed from a bag through four ROS 2 nodes, each a process: "
        f"{len(frames)} of {len(raw)} stereo pairs came through. Shown is frame {frames.index(frame) + 1}."
    )
    write_pair_page(
        path, raw[frame.stamp_ns], enhanced, rectified, frame.disparity, frame.depth, surface,
        truth=frame.truth, title="Underwater stereo reconstruction", lead=lead, more=more,
    )  # fmt: skip
    return path


def write_files(output: Path, frame: Frame) -> None:
    """Leave the typical frame's points and textured surface as ``cloud.ply`` and ``mesh.glb``."""
    stage = Reconstruct(ReconstructParams())
    write_ply(output / "cloud.ply", stage.cloud(frame.depth, frame.rectified.left))
    write_glb(output / "mesh.glb", stage.surface(frame.depth, frame.rectified.left))


def write_topics(path: Path, stamps: Sequence[int], collector: Collector) -> None:
    """Write the messages of these frames, as the nodes sent them, to a bag."""
    with BagWriter(path, overwrite=True) as bag:
        for stamp in stamps:
            for topic, kind in PER_FRAME.items():
                data = bytes(serialize_message(collector.frames[stamp][topic]))
                package, name = kind.__module__.split(".")[0], kind.__name__
                bag.raw(RawMessage(f"/{topic}", f"{package}/msg/{name}", stamp, data))


def _aligned(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    widths = [max(len(row[i]) for row in [header, *rows]) for i in range(len(header))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)) for row in [header, *rows]]
    return "\n".join(line.rstrip() for line in [lines[0], "  ".join("-" * width for width in widths), *lines[1:]])


def print_table(frames: Sequence[Frame], expected: int, collector: Collector) -> None:
    """Print what the page tells in numbers."""
    say("\n" + _aligned(FRAME_HEADER, frame_rows(frames, collector.latency)))
    say("\n" + _aligned(NODE_HEADER, node_rows(collector.diagnostics)))
    relative = float(np.median([frame.errors.median_relative for frame in frames]))
    say(f"\n{len(frames)} of {expected} pairs; median depth error {percent(relative)} of the depth")
