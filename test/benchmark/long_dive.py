"""What a model of a long dive costs: memory and time against the number of frames, ``uw_recon model`` whole.

python test/benchmark/long_dive.py 250 1000 4000
python test/benchmark/long_dive.py 250 1000 --area 100

The frames are drawn straight into a survey's folder, as its matching would have left them (small ones, of a bottom that
does not repeat itself), so that nothing is simulated or matched. A lawn-mower track: legs of 15 m, 0.6 m apart; with
`--area N` the first N frames of it, there and back, again and again.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import threading
from pathlib import Path

import cv2
import numpy as np
from graph_growth import lawnmower

from uw_recon_ros.survey.kept_frame import kept_name, write_kept
from uw_recon_ros.trajectory import DisparityFrame, trajectory_of
from uw_recon_ros.types import StereoGeometry

_ALTITUDE_M, _BASELINE_M = 1.2, 0.12
_NOISE_PX, _STEP_NS = 0.15, 500_000_000
_TEXEL_M, _SIDES = 0.006, (2048, 1531)  # two pictures that repeat with different periods do not repeat together
HEAD = "| frames | CPU s a frame | peak MB, of which anonymous | kept meanwhile, MB | ATE, mm | triangles |"


class Bottom:
    """A bottom without end: waves of a few lengths, and two pictures of noise."""

    def __init__(self) -> None:
        rng = np.random.default_rng(5)
        self.waves = np.column_stack([rng.normal(0, 5, (8, 2)), rng.uniform(0, 7, 8), rng.uniform(0.005, 0.02, 8)])
        self.noises = [self._noise(rng, side) for side in _SIDES]

    @staticmethod
    def _noise(rng: np.random.Generator, side: int) -> np.ndarray:
        fine = rng.normal(size=(side, side)).astype(np.float32)
        coarse = cv2.resize(rng.normal(size=(side // 5, side // 5)).astype(np.float32), (side, side))
        return cv2.GaussianBlur(fine, (0, 0), 1.0) * 2 + coarse

    def heights(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return sum(a * np.sin(kx * x + ky * y + p) for kx, ky, p, a in self.waves)

    def colors(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        level = np.full(x.shape, 110.0, np.float32)
        for side, noise in zip(_SIDES, self.noises, strict=True):
            u, v = ((c / _TEXEL_M % side).astype(np.float32) for c in (x, y))
            level += 22 * cv2.remap(noise, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)
        return np.dstack([level * 0.8, level, level * 0.9]).clip(1, 254).astype(np.uint8)


class Diver:
    """Draws what a survey keeps of a frame."""

    def __init__(self, width: int, height: int) -> None:
        self.bottom, self.size = Bottom(), (height, width)
        self.geometry = StereoGeometry(0.9 * width, width / 2 - 0.5, width / 2 - 0.5, height / 2 - 0.5, _BASELINE_M)
        v, u = np.mgrid[:height, :width]
        self.across, self.down = ((c - m) / (0.9 * width) for c, m in ((u, width / 2 - 0.5), (v, height / 2 - 0.5)))

    def frame(self, number: int, pose: np.ndarray) -> DisparityFrame:
        rng = np.random.default_rng(number)
        rays = np.stack([self.across, self.down, np.ones(self.size)], axis=-1) @ pose[:3, :3].T
        depth = np.full(self.size, pose[2, 3])
        for _ in range(6):
            x, y = (pose[k, 3] + depth * rays[..., k] for k in (0, 1))
            depth = (self.bottom.heights(x, y) - pose[2, 3]) / rays[..., 2]
        disparity = self.geometry.focal_times_baseline / depth + rng.normal(0, _NOISE_PX, self.size)
        left = self.bottom.colors(x, y)
        sigma = np.full(self.size, _NOISE_PX, np.float32)
        return DisparityFrame((1 + number) * _STEP_NS, left, disparity.astype(np.float32), sigma, self.geometry)


def track(count: int, area: int) -> np.ndarray:
    """(N, 4, 4) true poses; `area` frames of the way there, then back, and again (0: never back)."""
    if not 0 < area < count:
        return lawnmower(count)
    turn = np.arange(count) % (2 * area - 2)
    poses = lawnmower(area)[np.minimum(turn, 2 * area - 2 - turn)]
    poses[:, 1, 3] += 0.08 * np.sin(0.11 * np.arange(count))  # nobody swims the same way twice
    return poses


def draw(survey: Path, count: int, width: int, height: int, area: int = 0) -> np.ndarray:
    """Fill a survey's folder; returns the true poses."""
    bag = survey.with_name("bag")
    if not bag.exists():
        small = ("--width", "160", "--height", "120", "--frames", "2")
        run("simulate", "--track", "line", *small, "-o", str(bag), "--truth", str(survey.with_name("truth")))
    run("survey", str(bag), "-o", str(survey), "--write", "model", "--overwrite", "--quiet")
    for kept in (survey / "model_frames").glob("*.frame"):
        kept.unlink()
    poses, diver = track(count, area), Diver(width, height)
    poses[:, 2, 3] = _ALTITUDE_M
    for number, pose in enumerate(poses):
        write_kept(survey / kept_name(f"{number:06d}"), diver.frame(number, pose))
    return poses


def run(*words: str) -> None:
    subprocess.run([sys.executable, "-m", "uw_recon_ros.cli", *words], check=True)


def watched(words: list[str], work: Path) -> tuple[float, int, int, int]:
    """CPU seconds, most memory (MB) in all and anonymous, most that lay in a folder (MB), while a command ran."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done, most = threading.Event(), [0, 0, 0]
    with subprocess.Popen([sys.executable, "-m", "uw_recon_ros.cli", *words]) as process:
        watcher = threading.Thread(target=_watch, args=(process.pid, work, done, most))
        watcher.start()
        code = process.wait()
        done.set()
        watcher.join()
    if code:
        raise SystemExit(code)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, most[0], most[1], most[2]


def _watch(pid: int, work: Path, done: threading.Event, most: list[int]) -> None:
    turn = 0
    while not done.wait(0.1):
        try:
            status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
        except OSError:
            return
        found = dict(line.split(":", 1) for line in status.splitlines() if ":" in line)
        for k, name in enumerate(("VmHWM", "RssAnon")):
            most[k] = max(most[k], int(found.get(name, "0").split()[0]) // 1024)
        if turn % 50 == 0:
            most[2] = max(most[2], sum(_size(path) for path in work.rglob("*")) // 2**20)
        turn += 1


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0


def row(count: int, folder: Path, width: int, height: int, area: int, options: list[str]) -> str:
    from uw_recon_ros.evaluate_trajectory import trajectory_errors
    from uw_recon_ros.files.trajectories import read_tum

    survey = folder / f"survey_{count}"
    poses = draw(survey, count, width, height, area)
    words = ["model", str(survey), "--quiet", *options]
    cpu, most, anonymous, kept = watched(words, survey / "model")
    truth = trajectory_of([(1 + k) * _STEP_NS for k in range(count)], poses)
    errors = trajectory_errors(read_tum(survey / "model" / "trajectory.txt"), truth)
    made = json.loads((survey / "model" / "model.json").read_text(encoding="utf-8"))
    best = max(errors.segments, key=lambda s: s.frames)
    return (
        f"| {count} | {cpu / count:.3f} | {most}, {anonymous} | {kept} | {1e3 * best.ate_m:.1f} "
        f"| {made['models'][0]['triangles_before_simplification']} |"
    )


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("counts", nargs="*", type=int, default=[250, 1000, 4000])
    parser.add_argument("--width", type=int, default=160)
    parser.add_argument("--height", type=int, default=120)
    parser.add_argument("--area", type=int, default=0, help="frames of the way that is swum again and again")
    parser.add_argument("--folder", type=Path, help="where surveys are kept; else they are removed")
    args, options = parser.parse_known_args()
    sys.stdout.write(HEAD + "\n|" + " --- |" * 6 + "\n")
    with tempfile.TemporaryDirectory() as room:
        folder = args.folder or Path(room)
        folder.mkdir(parents=True, exist_ok=True)
        for count in args.counts:
            sys.stdout.write(row(count, folder, args.width, args.height, args.area, options) + "\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
