"""What matches cost in a pair and what chance costs: from it follows where a pixel's cost is cut."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.planes.census import Pattern
from uw_recon_ros.match.planes.gray import Gray
from uw_recon_ros.types import FloatImage, Mask

SAMPLES = 4000  #: pixels looked at
FEWEST = 50  #: with less, the usual is assumed
USUAL = (0.24, 0.56)  #: parts of the largest possible cost that good pairs in air have
LEAST_CUT = 0.25  #: where even chance matches well

Indices = NDArray[np.intp]


class TypicalCosts(NamedTuple):
    """Costs of single pixels as parts of the largest possible.

    Parameters
    ----------
    cut : float
        Half-way between what a match and what chance costs: more tells nothing.
    matched : float
        Mean of matches, cut there.
    """

    cut: float
    matched: float


def typical_costs(
    left: Gray, right: Gray, pattern: Pattern, softness: int, sign: int, disparity: FloatImage, usable: Mask
) -> TypicalCosts:
    """Compare pixels with where the start puts them, and with where it puts others.

    Parameters
    ----------
    left, right : (H, W) int16
        Of `gray.gray_pair`.
    pattern, softness, sign
        As in `data_cost.CostData`.
    disparity : (H, W) float32
        The start, px; `usable` (H, W) bool says where both views agree.
    """
    v, u = np.nonzero(usable)
    step = max(1, len(v) // SAMPLES)
    v, u = v[::step], u[::step]
    matched, chance = (np.full(1, part) for part in USUAL)
    if len(v) >= FEWEST:
        at = np.round(u - disparity[v, u]).astype(np.intp)
        matched = _costs(left, right, pattern, softness, sign, (v, u), (v, at))
        other = np.roll(np.arange(len(v)), len(v) // 2)
        chance = _costs(left, right, pattern, softness, sign, (v, u), (v[other], at[other]))
    cut = max((float(np.median(matched)) + float(np.median(chance))) / 2, LEAST_CUT)
    return TypicalCosts(cut, float(np.minimum(matched, cut).mean()))


def _costs(
    left: Gray, right: Gray, pattern: Pattern, softness: int, sign: int,
    here: tuple[Indices, Indices], there: tuple[Indices, Indices],
) -> NDArray[np.float64]:  # fmt: skip
    """Part of the largest possible cost, of each pixel of the left view at one of the right view."""
    total = np.zeros(len(here[0]), np.int64)
    for offset in pattern:
        mine, other = _brighter(left, here, offset), _brighter(right, there, offset)
        total += np.minimum(np.abs(mine - other), softness) + sign * ((mine > 0) != (other > 0))
    part: NDArray[np.float64] = total / (len(pattern) * (softness + sign))
    return part


def _brighter(gray: Gray, at: tuple[Indices, Indices], offset: NDArray[np.int64]) -> NDArray[np.int64]:
    """By how much a neighbour is brighter; the image is continued at its border."""
    height, width = gray.shape
    v, u = at[0].clip(0, height - 1), at[1].clip(0, width - 1)
    near = gray[(v + offset[0]).clip(0, height - 1), (u + offset[1]).clip(0, width - 1)]
    difference: NDArray[np.int64] = near.astype(np.int64) - gray[v, u]
    return difference
