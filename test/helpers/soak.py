"""Thousands of pairs through a running graph, as fast as they are taken, and what its processes hold meanwhile."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from helpers.process_watch import Usage, mapped_segments, segments, usage
from helpers.sea_trial import STEP, SeaTrial

#: Pairs on their way at a time: enough to keep every node busy, and none is overtaken.
_UNDER_WAY = 2


@dataclass(frozen=True)
class Sample:
    """What the processes held after so many pairs.

    Parameters
    ----------
    pairs : int
    nodes : dict
        `Usage` by name.
    segments : int
        Segments of shared memory that the processes have mapped and that still exist.
    """

    pairs: int
    nodes: dict[str, Usage]
    segments: int


def soak(trial: SeaTrial, pids: dict[str, int], pairs: int, every: int) -> Iterator[Sample]:
    """Send `pairs` pairs, each when the one before the last has come through; look at the processes now and then."""
    begun, done = trial.stamp, 0
    while done < pairs:
        trial.send(trial.stamp + STEP)
        waited_for = trial.stamp - (_UNDER_WAY - 1) * STEP
        if waited_for > begun:
            trial.graph.spin_until(_arrived(trial, waited_for), f"pair {done + 1} of {pairs}")
            trial.depths.clear()
            trial.clouds.clear()
            done += 1
            if done % every == 0:
                yield sample(pids, done)


def _arrived(trial: SeaTrial, stamp: int) -> Callable[[], bool]:
    """Whether depth and cloud of a pair, or of a later one, are there."""
    return lambda: all(any(at >= stamp for at in kept) for kept in (trial.depths, trial.clouds))


def sample(pids: dict[str, int], pairs: int) -> Sample:
    """Look at the processes once."""
    mapped = set().union(*(mapped_segments(pid) for pid in pids.values()))
    return Sample(pairs, {name: usage(pid) for name, pid in pids.items()}, len(mapped & segments()))


def growth_kb(samples: list[Sample], node: str) -> float:
    """Private memory a node gains a pair, kB: the slope of a straight line through the samples."""
    pairs = np.array([s.pairs for s in samples], float)
    return float(np.polyfit(pairs, [1e3 * s.nodes[node].private_mb for s in samples], 1)[0])
