"""Expansion of one plane over a region: every pixel keeps its plane or takes the new one, by a minimum cut.

    E = sum of the planes' costs  +  sum over 8-neighbours p, q of
        smoothness * weight(p, q) * min(|d_p(f_p) - d_p(f_q)| + |d_q(f_p) - d_q(f_q)|, bend)

with d_p(f) the disparity of plane f at pixel p (the curvature term of Olsson, Ulen and Boykov, 2013, as used by Taniai
et al., 2018). It is a metric on planes, so each expansion is a minimum cut; terms are cut to whole units and all sums
are exact, so no move raises the energy.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.min_cut import MOVE, GridGraph, clear, cut
from uw_recon_ros.types import FloatImage

Real = float | np.float32
#: A cut that takes more steps than this for each of its nodes is given up, and nothing moves. The hardest of pairs in
#: haze take 32: none is given up, and no input can hold the matcher up.
MOST_STEPS = 128


class Labelling(NamedTuple):
    """The planes, and what the energy needs.

    Parameters
    ----------
    planes : (3, H, W) float32
        a, b, c of the disparity ``a u + b v + c``.
    costs : (H, W) float32
        Data cost of each pixel's plane.
    weights : (4, H, W) float32
        See `cross_support.edge_weights`.
    smoothness : float32
        Energy of a disparity step of 1 px, where the weight is 1.
    bend : float32
        Summed disparity step at which the smoothness is cut, px.
    units : float32
        Integer units that an energy of 1 is counted in: the more, the finer, and the longer the cuts take.
    """

    planes: FloatImage
    costs: FloatImage
    weights: FloatImage
    smoothness: np.float32
    bend: np.float32
    units: np.float32


@kernel(allocates=False, inline=True)
def units(cost: Real, scale: Real) -> int:
    """A cost in integer units of energy."""
    return int(cost * scale)


@kernel(allocates=False, inline=True)
def step(a: Real, b: Real, c: Real, u: Real, v: Real, x: Real, y: Real, weight: Real, bend: Real) -> int:
    """Smoothness between pixels (u, v) and (x, y) whose planes differ by (a, b, c)."""
    apart = abs(a * u + b * v + c) + abs(a * x + b * y + c)
    return int(weight * min(apart, bend))


@kernel(allocates=False)
def possible_gain(cost: FloatImage, top: int, bottom: int, left: int, right: int, costs: FloatImage) -> float:
    """Data cost that a plane could save in a region at most."""
    gain = np.float32(0)
    for v in range(top, bottom):
        for u in range(left, right):
            gain += max(costs[v, u] - cost[v - top, u - left], np.float32(0))
    return float(gain)


@kernel(allocates=False)
def take_cheaper(
    a: float, b: float, c: float, top: int, bottom: int, left: int, right: int, cost: FloatImage, state: Labelling
) -> None:
    """Give the plane to all pixels of a region where it costs less, smoothness apart: how the first labels are made."""
    for v in range(top, bottom):
        for u in range(left, right):
            if cost[v - top, u - left] < state.costs[v, u]:
                _assign(a, b, c, v, u, cost[v - top, u - left], state)


@kernel(allocates=False, inline=True)
def _assign(a: float, b: float, c: float, v: int, u: int, cost: float, state: Labelling) -> None:
    state.planes[0, v, u], state.planes[1, v, u], state.planes[2, v, u] = a, b, c
    state.costs[v, u] = cost


@kernel
def expand(
    a: float, b: float, c: float, top: int, bottom: int, left: int, right: int, cost: FloatImage, state: Labelling,
    grid: GridGraph,
) -> int:  # fmt: skip
    """Expand the plane (a, b, c) over a region, its data cost there given; returns the pixels that took it."""
    row = right - left + 2
    nodes = row * (bottom - top + 2)
    clear(grid, nodes)
    _build(a, b, c, top, bottom, left, right, cost, state, grid, nodes, row)
    if not cut(grid, nodes, row, MOST_STEPS * nodes):
        return 0
    moved = 0
    for v in range(top, bottom):
        for u in range(left, right):
            if grid.tree[(v - top + 1) * row + u - left + 1] == MOVE:
                _assign(a, b, c, v, u, cost[v - top, u - left], state)
                moved += 1
    return moved


@kernel(allocates=False)
def _build(  # type: ignore[no-untyped-def]
    a, b, c, top, bottom, left, right, cost, state, grid, nodes, row
):
    """Data terms and pairs. Of a pair with energies E00, E01, E10, 0: see Kolmogorov and Zabih (2004)."""
    height, width = state.costs.shape
    planes, weights = state.planes, state.weights
    scale, bend = state.smoothness * state.units, state.bend
    for v in range(top, bottom):
        for u in range(left, right):
            i = (v - top + 1) * row + u - left + 1
            grid.excess[i] += units(cost[v - top, u - left], state.units) - units(state.costs[v, u], state.units)
            a0, b0, c0 = planes[0, v, u], planes[1, v, u], planes[2, v, u]
            fu, fv = np.float32(u), np.float32(v)
            for direction in range(8):
                x = u + (1, 1, 0, -1, -1, -1, 0, 1)[direction]
                y = v + (0, 1, 1, 1, 0, -1, -1, -1)[direction]
                if x < 0 or x >= width or y < 0 or y >= height:
                    continue
                inside = top <= y < bottom and left <= x < right
                if inside and direction >= 4:
                    continue
                weight = scale * (weights[direction, v, u] if direction < 4 else weights[direction - 4, y, x])
                a1, b1, c1 = planes[0, y, x], planes[1, y, x], planes[2, y, x]
                fx, fy = np.float32(x), np.float32(y)
                keep = step(a0 - a1, b0 - b1, c0 - c1, fu, fv, fx, fy, weight, bend)
                ours = step(a - a1, b - b1, c - c1, fu, fv, fx, fy, weight, bend)
                grid.excess[i] += ours - keep
                if inside:
                    j = i + (1, row + 1, row, row - 1)[direction]
                    theirs = step(a0 - a, b0 - b, c0 - c, fu, fv, fx, fy, weight, bend)
                    grid.excess[j] -= ours
                    grid.arcs[direction * nodes + i] = max(theirs + ours - keep, 0)


@kernel
def energy(state: Labelling) -> tuple[int, int]:
    """Data and smoothness terms of a labelling, in units, from the definition."""
    height, width = state.costs.shape
    data, smooth = 0, 0
    scale = state.smoothness * state.units
    for v in range(height):
        for u in range(width):
            data += units(state.costs[v, u], state.units)
            for direction in range(4):
                x, y = u + (1, 1, 0, -1)[direction], v + (0, 1, 1, 1)[direction]
                if 0 <= x < width and y < height:
                    a = state.planes[0, v, u] - state.planes[0, y, x]
                    b = state.planes[1, v, u] - state.planes[1, y, x]
                    c = state.planes[2, v, u] - state.planes[2, y, x]
                    weight = scale * state.weights[direction, v, u]
                    smooth += step(
                        a, b, c, np.float32(u), np.float32(v), np.float32(x), np.float32(y), weight, state.bend
                    )
    return data, smooth
