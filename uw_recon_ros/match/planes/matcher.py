"""The graph-cut matcher: local planes as labels, moved by minimum cuts over tiles from a semi-global start.

Why it is built so, and what it was measured against, is told in the documentation of the matcher.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.masks import only_where
from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes.census import CLOSE, WIDE
from uw_recon_ros.match.planes.confidence import DOUBTFUL_SIGMA, confidence_of, doubtful, signs_of_error
from uw_recon_ros.match.planes.cost_truncation import typical_costs
from uw_recon_ros.match.planes.cross_support import edge_weights, inverse_size, measure_arms
from uw_recon_ros.match.planes.data_cost import (
    FORBIDDEN,
    OUTSIDE,
    OUTSIDE_SEEN,
    QUARTERS,
    WORST,
    CostData,
    cost_weights,
    extend_borders,
    trust_in,
)
from uw_recon_ros.match.planes.disparity_sigma import plain_gray, sigma_of, with_disagreement
from uw_recon_ros.match.planes.expansion import Labelling, energy
from uw_recon_ros.match.planes.gray import MOST, Gray
from uw_recon_ros.match.planes.initial_disparity import Beginning, View, begin
from uw_recon_ros.match.planes.left_right_check import (
    enforce_uniqueness,
    fill_background,
    outside_by_surface,
    remove_small_segments,
)
from uw_recon_ros.match.planes.open_water import OpenWater, open_water
from uw_recon_ros.match.planes.previous_frame import FrameBefore, move_planes
from uw_recon_ros.match.planes.proposals import BEFORE, FIT, NEAR, OWN, POINTS, SHAKEN, Sources
from uw_recon_ros.match.planes.refinement import Pass, disparity_of, refine
from uw_recon_ros.match.planes.sharpness import equally_sharp
from uw_recon_ros.match.planes.texture import Texture, untextured_mask
from uw_recon_ros.match.planes.thread_pool import row_bands, run_parallel
from uw_recon_ros.match.planes.unsupported import unfounded
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Status


@dataclass(frozen=True)
class Schedule:
    """What an effort spends.

    Parameters
    ----------
    passes : tuple of Pass
        None: the start, checked, is the result.
    least_gain : float
        See `refinement.refine`.
    units, smoothness, bend : float
        See `expansion.Labelling`. An effort that searches longer needs less smoothness to find the same surfaces.
    following : tuple of Pass
        The passes for a frame that continues one whose planes are known.
    trust : float
        See `data_cost.trust_in`; who searches longer finds surfaces that the start did not see.
    """

    passes: tuple[Pass, ...]
    least_gain: float = 4.0
    units: float = 10.0
    following: tuple[Pass, ...] = ()
    smoothness: float = 1.0
    bend: float = 2.0
    trust: float = 0.2


_FIRST = (Pass(FIT, 6, False), Pass(POINTS, 6, False))
_ROUND = (Pass(POINTS, 2, True), Pass(FIT, 2, True), Pass(OWN, 2, True), Pass(NEAR, 2, True), Pass(SHAKEN, 2, True))
_FOLLOWING = (
    *(Pass(FIT, 4, False), Pass(POINTS, 4, False), Pass(BEFORE, 2, False)),
    *(Pass(BEFORE, 2, True), Pass(OWN, 1, True), Pass(NEAR, 2, True), Pass(FIT, 1, True)),
)
SCHEDULES = {
    "navigation": Schedule(()),
    "balanced": Schedule(_FIRST + _ROUND, following=_FOLLOWING),
    "quality": Schedule(_FIRST + 8 * _ROUND, 1.0, 64.0, _FOLLOWING + 3 * _ROUND, 0.7, 1.5, 0.1),
}


@dataclass(frozen=True, eq=False)
class GraphCutResult:
    """What `graph_cut` found.

    Parameters
    ----------
    disparity : (H, W) float32
        Left view, px; NaN = no match.
    sigma : (H, W) float32
        px; NaN where `disparity` is.
    confidence : (H, W) float32
        See `confidence.confidence_of`; NaN where `disparity` is.
    status : (H, W) uint8
        `Status` bits.
    energy : float
        Of the planes; NaN for the effort that has none.
    frame : FrameBefore or None
        What the next frame of a sequence may start from; None for the effort that has no planes.
    """

    disparity: FloatImage
    sigma: FloatImage
    confidence: FloatImage
    status: ByteImage
    energy: float
    frame: FrameBefore | None = None


def graph_cut(
    left: ByteImage,
    right: ByteImage,
    min_disparity: int,
    max_disparity: int,
    *,
    effort: str = "balanced",
    seed: int = 0,
    threads: int = 1,
    before: FrameBefore | None = None,
    start: Beginning | None = None,
    hidden: tuple[Mask, Mask] | None = None,
) -> GraphCutResult:
    """Match a rectified pair.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Mono or RGB.
    min_disparity, max_disparity : int
        Limits, inclusive, px.
    effort : {'navigation', 'balanced', 'quality'}
    seed : int
        Of the planes proposed.
    threads : int
        The result does not depend on it.
    before : FrameBefore, optional
        Of a frame of the same size shortly before: fewer planes are tried then.
    start : Beginning, optional
        Of these very images and limits, where it was made already.
    hidden : two (H, W) bool, optional
        Where the left and the right image show nothing: no surface is judged by what was found there.

    Raises
    ------
    ValueError
        Shapes differ, limits are exchanged, or the effort is unknown.
    """
    _require(left, right, min_disparity, max_disparity, effort)
    limits = (min_disparity, max_disparity)
    if start is None:
        start = begin(left, right, *limits, threads)
    schedule = SCHEDULES[effort]
    if start.learned:
        schedule = replace(schedule, trust=0.0)
    images, seen, usable, status = start.images, start.disparity, start.usable, start.status.copy()
    texture = Texture(images[0].pixels, images[1].pixels)
    water = open_water(texture, seen, usable)
    blank = untextured_mask(texture) | water.shown
    if not schedule.passes:
        _leave_out(blank, status)
        outside_by_surface(seen, blank, status)
        return _result(seen, start, status, water, limits, float("nan"), effort, threads, hidden)
    gray = images[0].as_bytes()
    moved = None if before is None else move_planes(before, gray, seen, usable)
    state = _planes(*images, seen, usable, blank, moved, limits, schedule, seed, threads)
    disparity = np.clip(disparity_of(state.planes), *limits)
    run_parallel(
        lambda b: enforce_uniqueness(disparity, state.costs, *b, status), row_bands(status.shape[0], threads), threads
    )
    _leave_out(blank, status)
    remove_small_segments(disparity, status)
    outside_by_surface(disparity, blank, status)
    value = sum(energy(state)) / schedule.units
    result = _result(disparity, start, status, water, limits, value, effort, threads, hidden)
    return replace(result, frame=FrameBefore(gray, state.planes))


def _require(left: ByteImage, right: ByteImage, low: int, high: int, effort: str) -> None:
    if left.shape != right.shape or left.ndim not in (2, 3) or left.dtype != np.uint8 or right.dtype != np.uint8:
        got = f"{left.dtype} {left.shape} and {right.dtype} {right.shape}"
        raise ValueError(f"left and right: expected two uint8 images of one shape, (H, W) or (H, W, 3), got {got}")
    if low > high:
        raise ValueError(f"min_disparity: expected at most max_disparity = {high}, got {low}")
    if effort not in EFFORTS:
        raise ValueError(f"effort: expected one of {', '.join(EFFORTS)}, got {effort!r}")


def _leave_out(blank: Mask, status: ByteImage) -> None:
    """Nothing is known of what has no texture, but that it would lie outside the other view."""
    status[blank & (status != Status.OUTSIDE)] = Status.LOW_TEXTURE


def _planes(
    image: View,
    other: View,
    seen: FloatImage,
    usable: Mask,
    blank: Mask,
    moved: FloatImage | None,
    limits: tuple[int, int],
    schedule: Schedule,
    seed: int,
    threads: int,
) -> Labelling:
    """Cover a view with planes."""
    first = fill_background(np.where(usable, seen, np.float32(np.nan)))
    trust = trust_in(usable, image.noise, schedule.trust)
    view = _view(image, other, seen, usable, trust, limits, threads)
    state = Labelling(
        np.stack([np.zeros_like(first), np.zeros_like(first), first]),
        np.full(first.shape, FORBIDDEN, np.float32),
        edge_weights(image.pixels, image.noise),
        np.float32(schedule.smoothness),
        np.float32(schedule.bend),
        np.float32(schedule.units),
    )
    passes = schedule.passes if moved is None else schedule.following
    sources = Sources(first, usable, state.planes if moved is None else moved)
    refine(passes, schedule.least_gain, seed, sources, blank, view, state, threads)
    return state


def _view(
    image: View, other: View, seen: FloatImage, usable: Mask, trust: FloatImage, limits: tuple[int, int], threads: int
) -> CostData:
    shape = image.gray.shape
    gray, other_gray = equally_sharp(image.gray, other.gray)
    arms, inverse = np.empty((4, *shape), np.uint8), np.empty(shape, np.float32)
    run_parallel(lambda b: measure_arms(image.pixels, *b, arms), row_bands(shape[0], threads), threads)
    inverse_size(arms, inverse)
    softness, sign = cost_weights(image.noise)
    pattern = WIDE if image.noise > 0.5 else CLOSE
    usual = typical_costs(gray, other_gray, pattern, softness, sign, seen, usable)
    largest = len(pattern) * (softness + sign)
    outside = np.maximum(np.where(usable, OUTSIDE_SEEN, OUTSIDE) / WORST * usual.cut, usual.matched)
    return CostData(
        extend_borders(gray), np.int16(softness), np.int16(sign), np.int16(round(usual.cut * largest)),
        np.round(outside * largest).astype(np.int16), pattern, _between_pixels(other_gray, threads), arms, inverse,
        np.float32(limits[0]), np.float32(limits[1]), seen, trust,
    )  # fmt: skip


def _between_pixels(gray: Gray, threads: int) -> NDArray[np.int16]:
    """Four samples a pixel along the rows, by cubic interpolation."""
    height, width = gray.shape
    source = gray.astype(np.float32)
    flags = cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP
    samples = np.empty((height, width, QUARTERS), np.int16)

    def move(i: int) -> None:
        shift = np.array([[1, 0, i / QUARTERS], [0, 1, 0]], np.float32)
        moved = cv2.warpAffine(source, shift, (width, height), flags=flags, borderMode=cv2.BORDER_REPLICATE)
        samples[..., i] = np.round(moved).clip(-MOST, MOST)

    run_parallel(move, range(QUARTERS), threads)
    return np.ascontiguousarray(samples.reshape(height, -1)[:, : QUARTERS * (width - 1) + 1])


def _result(
    disparity: FloatImage,
    start: Beginning,
    status: ByteImage,
    water: OpenWater,
    limits: tuple[int, int],
    value: float,
    effort: str,
    threads: int,
    hidden: tuple[Mask, Mask] | None,
) -> GraphCutResult:
    valid = status == 0
    left, right = (plain_gray(view.pixels, view.noise) for view in start.images)
    sigma = only_where(valid, sigma_of(left, right, disparity, status, effort, threads))
    disparity = only_where(valid, disparity)
    signs = signs_of_error(disparity, sigma, start.disparity, start.status, start.images[0].grain)
    likely = confidence_of(signs, effort)
    confidence = only_where(valid, likely)
    if SCHEDULES[effort].passes:
        sigma = with_disagreement(sigma, disparity, start.disparity, start.usable)
    sigma = np.maximum(sigma, doubtful(signs, effort, likely) * np.float32(DOUBTFUL_SIGMA))
    shown = disparity if hidden is None else only_where(~_in_hidden(disparity, *hidden), disparity)
    lost = unfounded(shown, confidence, water, limits)
    status[lost] = np.where(water.faint[lost], int(Status.LOW_TEXTURE), int(Status.INCONSISTENT))
    disparity, sigma, confidence = (only_where(~lost, found) for found in (disparity, sigma, confidence))
    return GraphCutResult(disparity, sigma, confidence, status, value)


def _in_hidden(disparity: FloatImage, left: Mask, right: Mask) -> Mask:
    """Pixels of the left view that lie, or whose match lies, where nothing is shown."""
    height, width = disparity.shape
    match = np.rint(np.arange(width) - np.nan_to_num(disparity)).clip(0, width - 1).astype(np.intp)
    return np.asarray(left | right[np.arange(height)[:, None], match])
