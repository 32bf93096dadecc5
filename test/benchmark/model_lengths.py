"""Lengths on models of simulated dives against the truth, with the share of them within the stated sigma.

For each end a pixel of a true view is drawn: the true place is where its ray meets the true ground. The model's place
is where a mark there lies on the textured model: where the ray to it, of the frame that sees the place best, meets the
model from that frame's own camera. ``uw_recon simulate --track ... --truth TRUTH`` and ``survey --model`` make both.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
import trimesh

from uw_recon_ros.files.trajectories import read_tum
from uw_recon_ros.measure_files import OpenedModel, measure_on, open_model
from uw_recon_ros.types import Matrix

_RAYS = 120


class Ground:
    """Triangles that rays are cast on."""

    def __init__(self, path: Path) -> None:
        mesh = trimesh.load(path, process=False)
        self.a, self.b, self.c = np.moveaxis(np.asarray(mesh.triangles, np.float64), 1, 0)

    def meet(self, eye: Matrix, way: Matrix) -> Matrix:
        """(3,) the first place on a ray; NaN: none (Moeller and Trumbore)."""
        across, aside = np.cross(way, self.c - self.a), eye - self.a
        other = np.cross(aside, self.b - self.a)
        with np.errstate(divide="ignore", invalid="ignore"):
            whole = ((self.b - self.a) * across).sum(axis=1)
            u, v = (aside * across).sum(axis=1) / whole, other @ way / whole
            t = ((self.c - self.a) * other).sum(axis=1) / whole
        hit = (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        return eye + t[hit].min() * way if hit.any() else np.full(3, np.nan)


def ends_of(model: Path, truth: Path, opened: OpenedModel, rng: np.random.Generator) -> tuple[Matrix, Matrix]:
    """Places of the true ground, and the same on the model, its origin included: (N, 3) each."""
    true, own = read_tum(truth / "trajectory.txt"), read_tum(model / "trajectory.txt")
    _, ours, theirs = np.intersect1d(own.stamps_ns, true.stamps_ns, return_indices=True)
    real, made = true.poses[theirs], own.poses[ours]
    made[:, :3, 3] -= opened.origin
    ground, surface = Ground(truth / "surface.ply"), Ground(model / "mesh.ply")
    found = []
    for _ in range(_RAYS):
        k, ray = rng.integers(len(ours)), np.array([*rng.uniform(-0.35, 0.35, 2), 1.0])
        place = ground.meet(real[k, :3, 3], real[k, :3, :3] @ ray)
        about = surface.meet(made[k, :3, 3], made[k, :3, :3] @ ray)
        if not np.isfinite([place, about]).all():
            continue
        camera = opened.spots.cameras[np.linalg.norm(opened.spots.places - about, axis=1).argmin()]
        best = int(np.linalg.norm(made[:, :3, 3] - camera, axis=1).argmin())
        seen = real[best, :3, :3].T @ (place - real[best, :3, 3])
        found.append([place, surface.meet(made[best, :3, 3], made[best, :3, :3] @ seen) + opened.origin])
    both = np.array(found)
    both = both[np.isfinite(both).all(axis=(1, 2))]
    return both[:, 0], both[:, 1]


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pairs", nargs="+", metavar="MODEL:TRUTH", help="folders of a model and of its dive's truth")
    parser.add_argument("--lengths", type=int, default=400)
    parser.add_argument("--click-mm", type=float, default=0.0, help="noise put on each coordinate of a click, and told")
    args = parser.parse_args()
    sys.stdout.write("| model | lengths, m | error, mm: mean, 95 % | of the length: mean, 95 % | sigma, mm, median "
                     "(surface, trajectory) | within 1, 2 sigma |\n|" + " --- |" * 6 + "\n")  # fmt: skip
    for pair in args.pairs:
        model, truth = map(Path, pair.split(":"))
        rng, opened = np.random.default_rng(0), open_model(model)
        true, own = ends_of(model, truth, opened, rng)
        own = own + args.click_mm / 1e3 * rng.standard_normal(own.shape)
        rows = []
        for _ in range(args.lengths):
            i, j = rng.choice(len(true), 2, replace=False)
            length = float(np.linalg.norm(true[i] - true[j]))
            if length > 0.05:
                (m,) = measure_on(opened, "length", [tuple(own[i]), tuple(own[j])], click=args.click_mm / 1e3)
                rows.append((length, m.value - length, m.sigma, m.sigma_surface, m.sigma_trajectory))
        length, error, sigma, surface, way = np.array(rows).T
        held = [100 * float((np.abs(error) <= k * sigma).mean()) for k in (1, 2)]
        away, share = 1e3 * np.abs(error), 100 * np.abs(error) / length
        sys.stdout.write(
            f"| {model} | {length.min():.2f} to {length.max():.2f} | {away.mean():.2f}, {np.percentile(away, 95):.2f} "
            f"| {share.mean():.2f}, {np.percentile(share, 95):.2f} % | {1e3 * np.median(sigma):.2f} "
            f"({1e3 * np.median(surface):.2f}, {1e3 * np.median(way):.2f}) | {held[0]:.0f}, {held[1]:.0f} % |\n"
        )


if __name__ == "__main__":
    main()
