"""Planes worth trying in a tile."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Mask

FIT, POINTS, OWN, NEAR, SHAKEN, BEFORE = 0, 1, 2, 3, 4, 5  #: ways to propose a plane
STEEPEST = 2.0  #: px of disparity a px
AGREEING = 1.0  #: disparities this near to a plane are used to fit it, px

Random = NDArray[np.uint64]


class Sources(NamedTuple):
    """Where planes come from, besides the labelling itself.

    Parameters
    ----------
    disparity : (H, W) float32
        Map that planes are fitted to, px, NaN nowhere.
    usable : (H, W) bool
        Where it is to be trusted.
    before : (3, H, W) float32
        Planes of the frame before, NaN where there are none; for the passes that propose these.
    """

    disparity: FloatImage
    usable: Mask
    before: FloatImage


@kernel(allocates=False)
def seed_random(number: int, row: int, column: int, random: Random) -> None:
    """A stream of its own for every tile and pass."""
    state = np.uint64(number) * np.uint64(0x9E3779B97F4A7C15)
    state += np.uint64(row * 100003 + column) * np.uint64(0xD1B54A32D192ED03) + np.uint64(1)
    random[0] = state
    for _ in range(4):
        draw(1, random)


@kernel(allocates=False)
def draw(count: int, random: Random) -> int:
    """A number from 0 to ``count - 1`` (xorshift64; Marsaglia, 2003)."""
    x = random[0]
    x ^= x >> np.uint64(12)
    x ^= x << np.uint64(25)
    x ^= x >> np.uint64(27)
    random[0] = x
    return int((x >> np.uint64(33)) % np.uint64(count))


@kernel(allocates=False)
def _signed(random: Random) -> np.float32:
    """Evenly from -1 to 1."""
    value: np.float32 = np.float32(draw(1 << 24, random) * (2.0 / (1 << 24)) - 1.0)
    return value


@kernel
def propose(  # type: ignore[no-untyped-def]
    way, trial, top, bottom, left, right, reach, planes, sources, random
):
    """A plane (a, b, c) for a tile, and whether there is one.

    `planes` is the labelling, `reach` how far beyond the tile to look.
    """
    disparity, usable = sources.disparity, sources.usable
    height, width = disparity.shape
    v, u = top + draw(bottom - top, random), left + draw(right - left, random)
    if way == NEAR:
        v = min(max(top - reach + draw(bottom - top + 2 * reach, random), 0), height - 1)
        u = min(max(left - reach + draw(right - left + 2 * reach, random), 0), width - 1)
    a, b, c = planes[0, v, u], planes[1, v, u], planes[2, v, u]
    if way == SHAKEN:
        return _shake(a, b, c, v, u, trial, random)
    if way == BEFORE:
        a, b, c = sources.before[0, v, u], sources.before[1, v, u], sources.before[2, v, u]
        return a, b, c, np.isfinite(c)
    if way == FIT:
        return _fit(v, u, 4 + draw(12, random), disparity, usable)
    if way == POINTS:
        rows = max(top - reach // 2, 0), min(bottom + reach // 2, height)
        columns = max(left - reach // 2, 0), min(right + reach // 2, width)
        return _through_points(rows, columns, disparity, usable, random)
    return a, b, c, True


@kernel(allocates=False)
def _shake(a, b, c, v, u, trial, random):  # type: ignore[no-untyped-def]
    """The plane of a pixel, moved and tilted, less from trial to trial."""
    size = np.float32(1.0) / np.float32(1 << min(trial, 6))
    d = a * np.float32(u) + b * np.float32(v) + c + _signed(random) * size
    a += _signed(random) * size * np.float32(0.1)
    b += _signed(random) * size * np.float32(0.1)
    return a, b, d - a * np.float32(u) - b * np.float32(v), True


@kernel
def _through_points(rows, columns, disparity, usable, random):  # type: ignore[no-untyped-def]
    """The plane through three pixels."""
    us, vs, found = np.empty(3, np.int64), np.empty(3, np.int64), 0
    for _ in range(30):
        v, u = rows[0] + draw(rows[1] - rows[0], random), columns[0] + draw(columns[1] - columns[0], random)
        if usable[v, u]:
            vs[found], us[found] = v, u
            found += 1
            if found == 3:
                break
    none = np.float32(0), np.float32(0), np.float32(0), False
    if found < 3:
        return none
    u1, v1, u2, v2 = us[1] - us[0], vs[1] - vs[0], us[2] - us[0], vs[2] - vs[0]
    area = u1 * v2 - u2 * v1
    if abs(area) < 6:
        return none
    first = disparity[vs[0], us[0]]
    d1, d2 = disparity[vs[1], us[1]] - first, disparity[vs[2], us[2]] - first
    a, b = np.float32((d1 * v2 - d2 * v1) / area), np.float32((d2 * u1 - d1 * u2) / area)
    if abs(a) > STEEPEST or abs(b) > STEEPEST:
        return none
    return a, b, np.float32(first - a * us[0] - b * vs[0]), True


@kernel
def _fit(v, u, radius, disparity, usable):  # type: ignore[no-untyped-def]
    """The plane through the disparities around a pixel that agree with it, found in three rounds.

    The slopes' variances are raised by half a px^2, so that a few pixels cannot tilt it.
    """
    height, width = disparity.shape
    a, b, c = 0.0, 0.0, np.float64(disparity[v, u])
    for _ in range(3):
        n, sx, sy, sd, sxx, syy, sxy, sxd, syd = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for j in range(max(0, v - radius), min(height, v + radius + 1)):
            for i in range(max(0, u - radius), min(width, u + radius + 1)):
                x, y, d = np.float64(i - u), np.float64(j - v), np.float64(disparity[j, i])
                if usable[j, i] and abs(d - (a * x + b * y + c)) <= AGREEING:
                    n += 1.0
                    sx += x
                    sy += y
                    sd += d
                    sxx += x * x
                    syy += y * y
                    sxy += x * y
                    sxd += x * d
                    syd += y * d
        if n < 6:
            break
        mx, my, md = sx / n, sy / n, sd / n
        cxx, cyy, cxy = sxx / n - mx * mx + 0.5, syy / n - my * my + 0.5, sxy / n - mx * my
        cxd, cyd = sxd / n - mx * md, syd / n - my * md
        determinant = cxx * cyy - cxy * cxy
        a = min(max((cxd * cyy - cyd * cxy) / determinant, -STEEPEST), STEEPEST)
        b = min(max((cyd * cxx - cxd * cxy) / determinant, -STEEPEST), STEEPEST)
        c = md - a * mx - b * my
    return np.float32(a), np.float32(b), np.float32(c - a * u - b * v), True


@kernel
def disparities(planes: FloatImage, first: int, last: int, disparity: FloatImage) -> None:
    """Write the disparity of every pixel's plane, rows `first` to `last`."""
    for v in range(first, last):
        for u in range(disparity.shape[1]):
            disparity[v, u] = planes[0, v, u] * np.float32(u) + planes[1, v, u] * np.float32(v) + planes[2, v, u]
