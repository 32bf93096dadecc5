"""Lengths measured in simulated pairs against the truth.

``python test/benchmark/measure_lengths.py [--sizes 480x360 960x720] [--distances 0.7 1.3 2.5] [--effort balanced]``:
point to point between drawn pixels of the true surface, 0.2 to 1 m apart, through all stages with the true calibration;
exact clicks, so that what is left is the depth's. Of all lengths; of those whose ends both lie over 4 px from a
silhouette (a step of the true disparity by 2 px); of those at whose ends no other surface is told (`other`), which a
user can tell; of these, where the stated sigma of the disparity is under 2 % of the length, with their share of all
that were asked for, refused ones included. A length counts as within its sigma without the part of clicking.
`--ends-px 0.1`: no matching; the true disparity of each end errs by that standard deviation: what lengths cannot be
better than.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from dataclasses import dataclass

import numpy as np
from sigma_calibration import View, view_of

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.measure.quantities import measure_polyline, point_of
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.trajectory import DisparityFrame

_AWAY_PX = 4
_STATED = 0.02  # sigma over length


def by_silhouette(disparity: np.ndarray, u: int, v: int) -> bool:
    """Whether the true surface steps within 4 px."""
    return bool(np.ptp(disparity[max(v - _AWAY_PX, 0) : v + _AWAY_PX + 1, max(u - _AWAY_PX, 0) : u + _AWAY_PX + 1]) > 2)


@dataclass(frozen=True, eq=False)
class Errors:
    """Of lengths in a view.

    Parameters
    ----------
    relative, over : (N,) float64
        Error over length; error over sigma.
    off, edge : (N,) bool
        Both ends are off true silhouettes; another surface is told at an end.
    stated : (N,) float64
        Sigma over length, of the disparity.
    refused : int
    """

    relative: np.ndarray
    over: np.ndarray
    off: np.ndarray
    edge: np.ndarray
    stated: np.ndarray
    refused: int


def seen_by(view: View, effort: str) -> DisparityFrame:
    """What is measured in, through all stages."""
    found = Match(MatchParams(effort=effort))(view.pair)
    depth = Reconstruct().depth(found)
    kept = np.where(np.isfinite(depth.depth), found.disparity, np.float32(np.nan))
    return DisparityFrame(0, view.pair.left, kept, found.sigma, found.geometry)


def errors_in(view: View, frame: DisparityFrame, count: int, seed: int) -> Errors:
    """Errors of as many drawn lengths."""
    rng, rows, refused = np.random.default_rng(seed), [], 0
    height, width = frame.disparity.shape
    while len(rows) < count and refused < 3 * count:
        (u0, u1), (v0, v1) = rng.integers(5, width - 5, 2), rng.integers(5, height - 5, 2)
        ends = [point_of(frame.geometry, u, v, float(view.disparity[v, u])) for u, v in ((u0, v0), (u1, v1))]
        true = float(np.linalg.norm(ends[1] - ends[0]))
        if not 0.2 <= true <= 1.0:
            continue
        try:
            made = measure_polyline(frame, [(float(u0), float(v0)), (float(u1), float(v1))])
        except EstimationError:
            refused += 1
            continue
        off = not any(by_silhouette(view.disparity, *end) for end in ((u0, v0), (u1, v1)))
        stated = made.sigma_disparity / made.value
        rows.append((made.value / true - 1, (made.value - true) / made.sigma_disparity, off, made.other, stated))
    table = np.array(rows, np.float64)
    return Errors(table[:, 0], table[:, 1], table[:, 2] > 0, np.isfinite(table[:, 3]), table[:, 4], refused)


def errors_of_ends(
    scene: str, distance_m: float, count: int, seed: int, ends_px: float, size: tuple[int, int]
) -> np.ndarray:
    """Relative errors of lengths between ends whose disparities err by a standard deviation."""
    view = view_of(scene=scene, distance_m=distance_m, seed=seed, width=size[0], height=size[1])
    rng, rows = np.random.default_rng(seed), []
    height, width = view.disparity.shape
    while len(rows) < count:
        (u0, u1), (v0, v1) = rng.integers(5, width - 5, 2), rng.integers(5, height - 5, 2)
        lengths = []
        for noise in (np.zeros(2), ends_px * rng.standard_normal(2)):
            ends = [
                point_of(view.pair.geometry, u, v, float(view.disparity[v, u]) + off)
                for u, v, off in ((u0, v0, noise[0]), (u1, v1, noise[1]))
            ]
            lengths.append(float(np.linalg.norm(ends[1] - ends[0])))
        if 0.2 <= lengths[0] <= 1.0:
            rows.append(lengths[1] / lengths[0] - 1)
    return np.array(rows)


def _size(text: str) -> tuple[int, int]:
    width, height = text.split("x")
    return int(width), int(height)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--distances", type=float, nargs="+", default=[0.7, 1.3, 2.5])
    parser.add_argument("--scenes", nargs="+", default=["amphora", "reef"])
    parser.add_argument("--sizes", type=_size, nargs="+", default=[(480, 360)])
    parser.add_argument("--effort", default="balanced")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--lengths", type=int, default=60)
    parser.add_argument("--ends-px", type=float, default=0.0)
    args = parser.parse_args()
    write = sys.stdout.write
    if args.ends_px:
        for scene in args.scenes:
            for distance in args.distances:
                errors = 100 * np.abs(
                    errors_of_ends(scene, distance, args.lengths, args.seed, args.ends_px, args.sizes[0])
                )
                write(f"{scene}, {distance:g} m, ends off by {args.ends_px:g} px: mean error {errors.mean():.2f} %, ")
                write(f"95 % under {np.quantile(errors, 0.95):.2f} %\n")
        return
    write("| px | scene | distance, m | lengths | refused | mean, % | 95 %, % | off silhouettes: mean, % | 95 %, % | ")
    write("no other surface: share | mean, % | 95 %, % | and sigma under 2 %: share | mean, % | 95 %, % | ")
    write("within 1 sigma |\n|" + " --- |" * 16 + "\n")
    for size, scene, distance in itertools.product(args.sizes, args.scenes, args.distances):
        view = view_of(scene=scene, distance_m=distance, seed=args.seed, width=size[0], height=size[1])
        found = errors_in(view, seen_by(view, args.effort), args.lengths, args.seed)
        errors, asked = 100 * np.abs(found.relative), len(found.relative) + found.refused
        sure = ~found.edge & (found.stated < _STATED)
        parts = [errors, errors[found.off], errors[~found.edge], errors[sure]]
        told = [f"{part.mean():.2f} | {np.quantile(part, 0.95):.2f}" if len(part) else "| " for part in parts]
        write(
            f"| {size[0]}x{size[1]} | {scene} | {distance:g} | {len(errors)} | {found.refused} | {told[0]} | "
            f"{told[1]} | "
            f"{np.sum(~found.edge) / asked:.0%} | {told[2]} | {sure.sum() / asked:.0%} | {told[3]} | "
            f"{np.mean(np.abs(found.over) <= 1):.0%} |\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
