"""What the paths of the semi-global aggregation cost: four directions at once, a byte a label.

A path's cost beyond the least of the pixel before is at most `JUMP`, the cost of a match is at most half of what is
left of a byte: so the sums never overflow, and a vector register holds twice as many labels as of 16-bit integers.
Only where the pixel before had none of the labels that cost least at the one before it, its least and a jump may leave
the byte: the jump, modulo 256, then costs less than any other way, and what it costs beyond the least is right again.
Indices are unsigned throughout: those that may be negative would be wrapped around one by one.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.cost_volume import Volume

STEP, JUMP = 40, 160  #: penalties of a disparity step of one, and of any larger one
_BYTE = 255
_AT_ONCE = 32  # labels: a loop of known length needs no leftovers

Bytes = NDArray[np.uint8]
Sums = NDArray[np.int16]
Four = tuple[np.uint8, np.uint8, np.uint8, np.uint8]
Three = tuple[np.uintp, np.uintp, np.uintp]
Firsts = NDArray[np.int16]
Shifts = tuple[np.uintp, np.uintp, np.uintp, np.uintp]


class Paths(NamedTuple):
    """What one direction of scanning remembers from row to row; all flat.

    Parameters
    ----------
    costs : (2, 3 (W + 2) (labels + 2 pad)) uint8
        Of the paths that arrive from the last row, and of those that leave this one; rows take turns. Around a pixel's
        labels there is no path: one label more is enough where all pixels have the same labels.
    least : (2, 3 (W + 2)) uint8
        The least of these.
    along : (2 (labels + 2 pad),) uint8
        Of the path along the row, at the pixel before and at this one.
    added : (labels,) uint8
        Half the sum of the second half's paths, at a pixel.
    firsts : (2, W + 2) int16
        The first labels of the pixels of the last row and of this one, in the order of scanning; -1: no pixel.
    """

    costs: Bytes
    least: Bytes
    along: Bytes
    added: Bytes
    firsts: Firsts

    @classmethod
    def begin(cls, width: int, labels: int, alike: bool = True) -> Paths:
        """Before the first row; `alike`: all pixels have the same labels."""
        pad = 1 if alike else labels + 2
        costs = np.full((2, 3, width + 2, labels + 2 * pad), _BYTE, np.uint8)
        costs[..., pad : pad + labels] = 0
        along, least = np.full((2, labels + 2 * pad), _BYTE, np.uint8), np.zeros((2, 3 * (width + 2)), np.uint8)
        firsts = np.full((2, width + 2), -1, np.int16)
        return cls(costs.reshape(2, -1), least, along.ravel(), np.empty(labels, np.uint8), firsts)


@kernel(allocates=False)
def extend_row(
    costs: Volume,
    penalties: Bytes,
    first: Firsts,
    v: int,
    backward: bool,
    second: bool,
    parity: int,
    paths: Paths,
    sums: Volume,
    totals: Sums,
    least: Sums,
) -> None:
    """Extend the four paths that arrive at a row from above (backward: from below).

    Parameters
    ----------
    costs : (H W labels,) uint8
        Of matches, at most (255 - `JUMP`) / 2 + 1.
    penalties : (4, H, W) uint8
        Of jumps, towards the four predecessors.
    first : (H, W) int16
        The disparity of each pixel's first label, from 0.
    v : int
    backward : bool
    second : bool
        Of a row that the other direction has met already: its totals are written. Else half the sum of its
        paths is kept in `sums`.
    parity : int
        Of rows so far.
    paths : Paths
    sums : (H W labels,) uint8
    totals : (W labels,) int16
        Half the costs of all eight paths, each with that of the match; ``least`` (W,) is their least.
    """
    width, labels = np.uintp(penalties.shape[2]), np.uintp(paths.added.size)
    one, two = np.uintp(1), np.uintp(2)
    along = paths.along
    stride, columns = np.uintp(along.size) // two, width + two
    line, pad = columns * stride, (stride - labels) // two
    before_labels = pad - one
    before, now = paths.costs[parity], paths.costs[1 - parity]
    least_before, least_now = paths.least[parity], paths.least[1 - parity]
    firsts_before, firsts_now = paths.firsts[parity], paths.firsts[1 - parity]
    beside, here = before_labels, stride + before_labels
    along[pad : pad + labels] = 0
    row = np.uintp(v) * width
    beyond = np.uint8(0)
    for j in range(width):
        u = width - one - j if backward else j
        at, n = (row + u) * labels, (j + one) * stride + before_labels
        shift = _shifts(first[v, u], firsts_before, firsts_now, np.uintp(j), pad)
        below = (beyond, least_before[j], least_before[columns + j + one], least_before[two * columns + j + two])
        jump = (
            np.uint8(penalties[0, v, u] + below[0]),
            np.uint8(penalties[1, v, u] + below[1]),
            np.uint8(penalties[2, v, u] + below[2]),
            np.uint8(penalties[3, v, u] + below[3]),
        )
        arriving = (
            n - stride + shift[1],
            line + n + shift[2],
            two * line + n + stride + shift[3],
        )
        leaving = (n, line + n, two * line + n)
        halves, m = (paths.added, np.uintp(0)) if second else (sums, at)
        beyond, left, straight, right = _extend(
            costs,
            at,
            along,
            beside + shift[0],
            along,
            here,
            before,
            arriving,
            now,
            leaving,
            below,
            jump,
            halves,
            m,
            labels,
        )
        least_now[j + one], least_now[columns + j + one], least_now[two * columns + j + one] = left, straight, right
        beside, here = here, beside
        if second:
            least[u] = _join(costs, sums, at, halves, totals, u * labels, labels)


@kernel(inline=True, allocates=False)
def _shifts(mine: np.int16, before: Firsts, now: Firsts, j: np.uintp, pad: np.uintp) -> Shifts:
    """From where a label of this pixel stands to where its four predecessors keep the same; notes its first."""
    one, none = np.uintp(1), np.uintp(0)
    if pad == one:
        return none, none, none, none
    now[j + one] = mine
    return (
        _shift(mine, now[j], pad),
        _shift(mine, before[j], pad),
        _shift(mine, before[j + one], pad),
        _shift(mine, before[j + np.uintp(2)], pad),
    )


@kernel(inline=True, allocates=False)
def _shift(mine: np.int16, other: np.int16, pad: np.uintp) -> np.uintp:
    """Of one other pixel; none where there is no pixel."""
    most = np.intp(pad) - 1
    apart = np.intp(mine) - np.intp(other) if other >= 0 else np.intp(0)
    shift: np.uintp = np.uintp(min(max(apart, -most), most))
    return shift


@kernel(inline=True, allocates=False, apart=True)
def _extend(
    costs: Volume, c: np.uintp,
    beside: Bytes, b: np.uintp, here: Bytes, h: np.uintp,
    before: Bytes, arriving: Three, now: Bytes, leaving: Three,
    below: Four, jump: Four,
    halves: Volume, m: np.uintp,
    labels: np.uintp,
) -> Four:  # fmt: skip
    """Path costs of one pixel from those of its predecessors; returns the least of each, writes half of their sum.

    Each array is followed by where in it this pixel's labels begin.
    """
    some = np.uintp(_AT_ONCE)
    if labels < some:
        return _extend_some(
            costs, c, beside, b, here, h, before, arriving, now, leaving, below, jump, halves, m, np.intp(labels)
        )
    least = (np.uint8(_BYTE), np.uint8(_BYTE), np.uint8(_BYTE), np.uint8(_BYTE))
    for i in range((labels + some - np.uintp(1)) // some):
        k = min(i * some, labels - some)  # the last ones may overlap: nothing is read that was written here
        found = _extend_some(
            costs, c + k, beside, b + k, here, h + k,
            before, (arriving[0] + k, arriving[1] + k, arriving[2] + k),
            now, (leaving[0] + k, leaving[1] + k, leaving[2] + k), below, jump, halves, m + k, _AT_ONCE,
        )  # fmt: skip
        least = (min(least[0], found[0]), min(least[1], found[1]), min(least[2], found[2]), min(least[3], found[3]))
    return least


@kernel(inline=True, allocates=False, apart=True)
def _extend_some(
    costs: Volume, c: np.uintp,
    beside: Bytes, b: np.uintp, here: Bytes, h: np.uintp,
    before: Bytes, arriving: Three, now: Bytes, leaving: Three,
    below: Four, jump: Four,
    halves: Volume, m: np.uintp,
    labels: int,
) -> Four:  # fmt: skip
    one, two = np.uintp(1), np.uintp(2)
    least0 = least1 = least2 = least3 = np.uint8(_BYTE)
    for i in range(labels):
        k = np.uintp(i)
        cost = costs[c + k]
        a = b + k
        path0 = _beyond(beside[a], beside[a + one], beside[a + two], below[0], jump[0])
        a = arriving[0] + k
        path1 = _beyond(before[a], before[a + one], before[a + two], below[1], jump[1])
        a = arriving[1] + k
        path2 = _beyond(before[a], before[a + one], before[a + two], below[2], jump[2])
        a = arriving[2] + k
        path3 = _beyond(before[a], before[a + one], before[a + two], below[3], jump[3])
        halves[m + k] = _half_sum(path0, path1, path2, path3)
        path0, path1 = np.uint8(path0 + cost), np.uint8(path1 + cost)
        path2, path3 = np.uint8(path2 + cost), np.uint8(path3 + cost)
        here[h + k + one] = path0
        now[leaving[0] + k + one] = path1
        now[leaving[1] + k + one] = path2
        now[leaving[2] + k + one] = path3
        least0, least1, least2, least3 = min(least0, path0), min(least1, path1), min(least2, path2), min(least3, path3)
    return least0, least1, least2, least3


@kernel(inline=True, allocates=False)
def _beyond(less: np.uint8, same: np.uint8, more: np.uint8, below: np.uint8, jump: np.uint8) -> np.uint8:
    """What a path to here costs beyond the least of the pixel before, which is `below`."""
    near = np.uint8(min(min(less, more), np.uint8(_BYTE - STEP)) + np.uint8(STEP))
    beyond: np.uint8 = np.uint8(min(min(same, jump), near) - below)
    return beyond


@kernel(inline=True, allocates=False)
def _half_sum(along: np.uint8, first: np.uint8, straight: np.uint8, last: np.uint8) -> np.uint8:
    """Of four paths, cut where it leaves the byte: the least over the labels never does, for one path adds nothing.

    Rounded alike whichever way up, or mirrored, the image is.
    """
    none = np.uint8(0)
    return _cut_sum(_cut_sum(_mean(first, last), _mean(straight, none)), _mean(along, none))


@kernel(inline=True, allocates=False)
def _cut_sum(a: np.uint8, b: np.uint8) -> np.uint8:
    """At most 255."""
    total: np.uint8 = np.uint8(min(a, np.uint8(np.uint8(_BYTE) - b)) + b)
    return total


@kernel(inline=True, allocates=False)
def _mean(a: np.uint8, b: np.uint8) -> np.uint8:
    """Rounded up: processors have this for bytes."""
    mean: np.uint8 = np.uint8(np.uint16(np.uint16(np.uint16(a) + np.uint16(b)) + np.uint16(1)) >> np.uint16(1))
    return mean


@kernel(inline=True, allocates=False, apart=True)
def _join(
    costs: Volume, sums: Volume, at: np.uintp, halves: Bytes, totals: Sums, t: np.uintp, labels: np.uintp
) -> np.int16:
    """Write a pixel's totals out of both directions' sums; returns their least."""
    some = np.uintp(_AT_ONCE)
    if labels < some:
        return _join_some(costs, sums, at, halves, np.uintp(0), totals, t, np.intp(labels))
    least: np.int16 = np.int16(32767)
    for i in range((labels + some - np.uintp(1)) // some):
        k = min(i * some, labels - some)
        least = min(least, _join_some(costs, sums, at + k, halves, k, totals, t + k, _AT_ONCE))
    return least


@kernel(inline=True, allocates=False, apart=True)
def _join_some(
    costs: Volume, sums: Volume, at: np.uintp, halves: Bytes, m: np.uintp, totals: Sums, t: np.uintp, labels: int
) -> np.int16:
    least: np.int16 = np.int16(32767)
    for i in range(labels):
        k = np.uintp(i)
        beyond = np.int16(np.int16(sums[at + k]) + np.int16(halves[m + k]))
        total = np.int16(beyond + np.int16(np.int16(costs[at + k]) << np.int16(2)))
        totals[t + k] = total
        least = min(least, total)
    return least
