"""How long the pose graph of a lawn-mower dive takes: frames joined to their neighbours, legs to the one before.

python test/benchmark/graph_growth.py 1000 10000
"""

from __future__ import annotations

import argparse
import resource
import sys
import time

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.align.loops import candidates, footprints
from uw_recon_ros.align.pose_graph import Edges, solve_graph

_LEG = 100  # frames
_STEP_M, _BETWEEN_M = 0.15, 0.6
_SIGMA_M, _SIGMA_RAD = 0.001, 0.0008


def lawnmower(count: int) -> np.ndarray:
    """(N, 4, 4) poses, looking down."""
    leg, along = np.divmod(np.arange(count), _LEG)
    poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (count, 1, 1))
    poses[:, 0, 3] = _STEP_M * np.where(leg % 2 == 0, along, _LEG - 1 - along)
    poses[:, 1, 3] = _BETWEEN_M * leg
    return poses


def measured(true: np.ndarray, first: np.ndarray, second: np.ndarray, loop: np.ndarray) -> Edges:
    """Relations with noise."""
    sigmas = np.r_[np.full(3, _SIGMA_M), np.full(3, _SIGMA_RAD)]
    noise = np.random.default_rng(1).normal(size=(len(first), 6)) * sigmas
    motions = rigid.inverse(true[first]) @ true[second] @ rigid.exp(noise)
    return Edges(first, second, motions, np.tile(np.diag(sigmas**2), (len(first), 1, 1)), loop)


def row(count: int) -> str:
    true = lawnmower(count)
    began = time.process_time()
    pairs = candidates(footprints(true, np.ones(count)), np.full(count, 0.9), np.zeros(count, np.int64), 3, set())
    sought = time.process_time() - began
    loops = np.array(pairs).reshape(-1, 2)
    first = np.concatenate([np.arange(count - 1), loops[:, 0]])
    second = np.concatenate([np.arange(1, count), loops[:, 1]])
    edges = measured(true, first, second, np.arange(len(first)) >= count - 1)
    start = np.tile(true[0], (count, 1, 1))
    for k in range(1, count):
        start[k] = start[k - 1] @ edges.motions[k - 1]
    began = time.process_time()
    nearly = solve_graph(start, edges, np.zeros(1, np.int64), final=False)
    solved = solve_graph(nearly.poses, edges, np.zeros(1, np.int64), rounds=10)
    seconds = time.process_time() - began
    missed = np.linalg.norm((rigid.inverse(true[0]) @ true)[:, :3, 3] - (rigid.inverse(solved.poses[0]) @ solved.poses)[:, :3, 3], axis=1)  # fmt: skip # noqa: E501
    drift = np.linalg.norm(start[:, :3, 3] - true[:, :3, 3], axis=1).max()
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    return (
        f"| {count} | {len(loops)} | {sought:.1f} | {seconds:.1f} | {nearly.rounds} + {solved.rounds} "
        f"| {drift:.3f} | {missed.max():.3f} | {most} |"
    )


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("counts", nargs="*", type=int, default=[1000, 3000, 10000])
    say = sys.stdout.write
    say("| poses | loops | candidates, CPU s | graph, s | rounds | worst error before, m | after, m | MB |\n"
        "|" + " --- |" * 8 + "\n")  # fmt: skip
    for count in parser.parse_args().counts:
        say(row(count) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
