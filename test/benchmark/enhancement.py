"""Is what is shown pleasant and true? Beside raw, the paper's chain, gray world with CLAHE and multi-scale fusion.

Usage: python test/benchmark/enhancement.py [--sheets FOLDER]

Simulated scenes, against the same surfaces under even white light without water: mean angle between colours in linear
light (degrees), mean CIE76 difference after one exposure for the picture, both of areas of 4 x 4 px, and the structural
part of SSIM of the luminance. Real pairs (../shared/data): share of pixels under 8 and over 250 of 255, and grain:
noise in the plainest blocks over the picture's contrast. CPU time of a 640 x 480 pair. `--sheets` writes contact sheets
(raw, ours, paper, gray world, fusion, truth).
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np
from enhancers import Byte, Float, gray_world_clahe, multi_scale_fusion
from simulated_colors import color_errors, colored_scenes, structure

from uw_recon_ros.preprocess.appearance import improve_appearance
from uw_recon_ros.preprocess.image_pairs import TwoThreads
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import StereoPair

DATA = Path(__file__).resolve().parents[2].parent / "shared" / "data"
REAL = {
    "canyon": ("underwater/flsea_canyon/left.png", "underwater/flsea_canyon/right.png"),
    "diver": ("underwater/caddy_diver/left.jpg", "underwater/caddy_diver/right.jpg"),
    "reef": ("underwater_dim/reef/left.png", "underwater_dim/reef/right.png"),
    "tank": ("calibration/tank_water/left/01.png", "calibration/tank_water/right/01.png"),
}
SHEET_WIDTH = 480


def versions(pair: StereoPair) -> dict[str, Byte]:
    """The left image by each method."""
    ours, paper = (Preprocess(PreprocessParams(appearance=name))(pair).left for name in ("water", "paper"))
    left = pair.left
    return {"raw": left, "ours": ours, "paper": paper, "gray world": gray_world_clahe(left),
            "fusion": multi_scale_fusion(left)}  # fmt: skip


def real_figures(image: Byte) -> tuple[float, float, float]:
    """Dark and burnt share, percent; grain relative to contrast, percent."""
    light = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY).astype(np.float32)
    bent = np.abs(cv2.filter2D(light, -1, np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32) / 6))
    blocks = cv2.resize(bent, (light.shape[1] // 16, light.shape[0] // 16), interpolation=cv2.INTER_AREA)
    grain = 1.2533 * float(np.percentile(blocks, 10)) / max(float(light.std()), 1e-6)
    return 100 * float((light < 8).mean()), 100 * float((light > 250).mean()), 100 * grain


def sheet(pictures: list[Byte]) -> Byte:
    """Pictures side by side."""
    height = round(pictures[0].shape[0] * SHEET_WIDTH / pictures[0].shape[1])
    return np.hstack([cv2.resize(p, (SHEET_WIDTH, height), interpolation=cv2.INTER_AREA) for p in pictures])


def simulated(sheets: list[Byte]) -> None:
    """Print what is true."""
    totals: dict[str, list[tuple[float, ...]]] = {}
    print(f"{'simulated':18s}" + "".join(f"{name:>22s}" for name in ("raw", "ours", "paper", "gray world", "fusion")))
    for name, scene in colored_scenes().items():
        shown = versions(StereoPair(scene.left, scene.right))
        row = {key: (*color_errors(image, scene.light), structure(image, scene.light)) for key, image in shown.items()}
        print(f"{name:18s}" + "".join(f"{a:8.1f}{e:7.1f}{s:7.2f}" for a, e, s in row.values()), flush=True)
        for key, values in row.items():
            totals.setdefault(key, []).append(values)
        sheets.append(sheet([*shown.values(), _picture(scene.light)]))
    means = [np.mean(values, axis=0) for values in totals.values()]
    print(f"{'mean':18s}" + "".join(f"{a:8.1f}{e:7.1f}{s:7.2f}" for a, e, s in means))


def _picture(light: Float) -> Byte:
    return (255 * np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.uint8)


def real(sheets: list[Byte]) -> None:
    """Print what can be said without a truth."""
    print(f"{'real: <8, >250, grain':22s}")
    for name, files in REAL.items():
        if not all((DATA / file).exists() for file in files):
            print(f"{name:18s}absent: {DATA / files[0]}")
            continue
        shown = versions(StereoPair(*(cv2.imread(str(DATA / file))[..., ::-1] for file in files)))
        print(f"{name:18s}" + "".join("{:8.1f}{:7.1f}{:7.1f}".format(*real_figures(i)) for i in shown.values()))
        sheets.append(sheet([*shown.values(), np.zeros_like(shown["raw"])]))


def speed(repeat: int = 7) -> None:
    """CPU time of all threads for a pair, least of several."""
    rng = np.random.default_rng(1)
    views = tuple(cv2.resize(rng.random((60, 80, 3), np.float32), (640, 480)) for _ in range(2))
    nothing = (np.zeros((480, 640), bool),) * 2
    taken = []
    with TwoThreads() as both:
        for _ in range(repeat):
            started = time.process_time()
            improve_appearance(both, views, nothing)
            taken.append(1e3 * (time.process_time() - started))
    print(f"enhancement of a 640 x 480 pair: {min(taken):.1f} ms CPU, {min(taken) / 2:.1f} an image (limit 30)")


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sheets", type=Path, help="folder for contact sheets")
    folder = parser.parse_args().sheets
    simulated_sheets: list[Byte] = []
    real_sheets: list[Byte] = []
    simulated(simulated_sheets)
    real(real_sheets)
    speed()
    for name, sheets in (("simulated", simulated_sheets), ("real", real_sheets)):
        if folder and sheets:
            folder.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(folder / f"{name}.png"), np.vstack(sheets)[..., ::-1])


if __name__ == "__main__":
    main()
