"""Small dives to survey, and what stands for 'the same bytes'."""

from __future__ import annotations

import csv
import hashlib
from dataclasses import replace
from pathlib import Path

from uw_recon_ros.bags import RawMessage, open_bag
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.write import simulate

FRAMES = 6
#: Small enough for a frame in half a second.
PARAMS = """/**:
  ros__parameters:
    min_disparity: 2
    max_disparity: 18
    kz2_sweeps: 1
    surface_max_vertices: 300
    speckle_area_px: 20
"""


def make_dive(path: Path, frames: int = FRAMES, **given: object) -> Path:
    """A calibrated dive of 96x72 px."""
    chosen = {"width": 96, "height": 72, "snow_per_m3": 5.0, "frames": frames, **given}
    simulate(path, SimulateParams(**chosen))  # type: ignore[arg-type]
    return path


def recorded(path: Path) -> list[RawMessage]:
    """The cameras' messages of a dive."""
    with open_bag(path) as bag:
        return [m for m in bag.raw_messages() if not m.topic.startswith("/truth")]


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of everything that is the same whenever input, parameters and versions are: see `tables.TIMES`."""
    found = {}
    for path in sorted(root.rglob("*")):
        name = path.relative_to(root).as_posix()
        if path.is_dir() or name.startswith(("state/", ".")) or name in ("timing.csv", "run.json", "report.html"):
            continue
        data = path.read_bytes() if name != "frames.csv" else repr(without_seconds(path)).encode()
        found[name] = hashlib.sha256(data).hexdigest()
    return found


def without_seconds(path: Path) -> list[dict[str, str]]:
    """Rows of ``frames.csv`` but for the times."""
    return [{name: value for name, value in row.items() if name != "seconds"} for row in table(path)]


def table(path: Path) -> list[dict[str, str]]:
    with path.open(newline="", encoding="utf-8") as stream:
        return list(csv.DictReader(stream))


def with_half_a_camera(messages: list[RawMessage]) -> list[RawMessage]:
    """The same recording, but the right image's lower half black in the second frame and frozen in the last one."""
    images = [i for i, m in enumerate(messages) if m.topic == "/right/image_raw"]
    broken = list(messages)
    for at, part in ((images[1], b""), (images[-1], messages[images[-2]].data)):
        data = messages[at].data
        half = 36 * 96 * 3  # bytes, at the end of the message
        broken[at] = replace(messages[at], data=data[:-half] + (part[-half:] or bytes(half)))
    return broken
