"""The graph-cut matcher: local planes as labels, moved by minimum cuts over tiles from a semi-global start.

Why it is built so, and what it was measured against, is told in the documentation of the matcher.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes.census import CLOSE, WIDE
from uw_recon_ros.match.planes.certainty import plain_gray, sigma_of, with_disagreement
from uw_recon_ros.match.planes.confidence import DOUBTFUL, DOUBTFUL_SIGMA, confidence_of
from uw_recon_ros.match.planes.cost_truncation import typical_costs
from uw_recon_ros.match.planes.cross_support import edge_weights, inverse_size, measure_arms
from uw_recon_ros.match.planes.data_cost import (
    FORBIDDEN,
    OUTSIDE,
    QUARTERS,
    WORST,
    CostData,
    cost_weights,
    extend_borders,
)
from uw_recon_ros.match.planes.expansion import Labelling, energy
from uw_recon_ros.match.planes.gray import MOST, Gray, gray_pair
from uw_recon_ros.match.planes.left_right_check import (
    enforce_uniqueness,
    fill_background,
    left_right_check,
    remove_small_segments,
)
from uw_recon_ros.match.planes.motion import FrameBefore, move_planes
from uw_recon_ros.match.planes.open_water import Water, open_water
from uw_recon_ros.match.planes.proposals import BEFORE, FIT, NEAR, OWN, POINTS, SHAKEN, Sources
from uw_recon_ros.match.planes.refinement import Pass, disparity_of, refine
from uw_recon_ros.match.planes.semiglobal import semiglobal_start
from uw_recon_ros.match.planes.texture import untextured_mask
from uw_recon_ros.match.planes.threads import row_bands, run_parallel
from uw_recon_ros.match.planes.unfounded import unfounded
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Status

VOXEL_BYTES, MOST_BYTES = 5, 1.0e9  #: of the start's cost volume, and what it may take before images are made smaller


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
    """

    passes: tuple[Pass, ...]
    least_gain: float = 4.0
    units: float = 10.0
    following: tuple[Pass, ...] = ()
    smoothness: float = 1.0
    bend: float = 2.0


_FIRST = (Pass(FIT, 6, False), Pass(POINTS, 6, False))
_ROUND = (Pass(POINTS, 2, True), Pass(FIT, 2, True), Pass(OWN, 2, True), Pass(NEAR, 2, True), Pass(SHAKEN, 2, True))
_FOLLOWING = (
    *(Pass(FIT, 4, False), Pass(POINTS, 4, False), Pass(BEFORE, 2, False)),
    *(Pass(BEFORE, 2, True), Pass(OWN, 1, True), Pass(NEAR, 2, True), Pass(FIT, 1, True)),
)
SCHEDULES = {
    "navigation": Schedule(()),
    "balanced": Schedule(_FIRST + _ROUND, following=_FOLLOWING),
    "quality": Schedule(_FIRST + 8 * _ROUND, 1.0, 64.0, _FOLLOWING + 3 * _ROUND, 0.7, 1.5),
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

    Raises
    ------
    ValueError
        Shapes differ, limits are exchanged, or the effort is unknown.
    """
    _require(left, right, min_disparity, max_disparity, effort)
    images = _Image.pair(left, right, threads)
    limits = (min_disparity, max_disparity)
    start, status = _start(images, limits, threads)
    shown = images[0].pixels, images[1].pixels
    water = open_water(*shown, start, status == 0)
    blank = untextured_mask(*shown) | water.shown
    schedule = SCHEDULES[effort]
    usable, gray = status == 0, images[0].as_bytes()
    if not schedule.passes:
        _leave_out(blank, status)
        return _result(start, (start, usable), images, status, water, limits, float("nan"), effort, threads)
    moved = None if before is None else move_planes(before, gray, start, usable)
    state = _planes(*images, start, usable, blank, moved, limits, schedule, seed, threads)
    disparity = np.clip(disparity_of(state.planes), *limits)
    run_parallel(
        lambda b: enforce_uniqueness(disparity, state.costs, *b, status), row_bands(status.shape[0], threads), threads
    )
    _leave_out(blank, status)
    remove_small_segments(disparity, status)
    value = sum(energy(state)) / schedule.units
    result = _result(disparity, (start, usable), images, status, water, limits, value, effort, threads)
    return replace(result, frame=FrameBefore(gray, state.planes))


def _require(left: ByteImage, right: ByteImage, low: int, high: int, effort: str) -> None:
    if left.shape != right.shape or left.ndim not in (2, 3) or left.dtype != np.uint8 or right.dtype != np.uint8:
        got = f"{left.dtype} {left.shape} and {right.dtype} {right.shape}"
        raise ValueError(f"left and right: expected two uint8 images of one shape, (H, W) or (H, W, 3), got {got}")
    if low > high:
        raise ValueError(f"min_disparity: expected at most max_disparity = {high}, got {low}")
    if effort not in EFFORTS:
        raise ValueError(f"effort: expected one of {', '.join(EFFORTS)}, got {effort!r}")


def _start(images: tuple[_Image, _Image], limits: tuple[int, int], threads: int) -> tuple[FloatImage, ByteImage]:
    """The semi-global start and its status; of smaller images where the cost volume would not fit."""
    height, width = images[0].gray.shape
    shrink = 1
    while VOXEL_BYTES * height * width * (limits[1] - limits[0] + 1) / shrink**3 > MOST_BYTES:
        shrink *= 2
    left, right = images
    if shrink > 1:
        left, right = _Image.pair(_shrink(left.pixels, shrink), _shrink(right.pixels, shrink), threads)
    scale = width / left.gray.shape[1]
    small = math.floor(limits[0] / scale), math.ceil(limits[1] / scale)
    start = semiglobal_start(left.planes, right.planes, left.gray, right.gray, left.noise, *small, threads)
    status = _compare(start.disparity, start.right, small, threads)
    if shrink == 1:
        return start.disparity, status
    status = np.asarray(cv2.resize(status, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)
    disparity = _enlarge(start.disparity, (width, height), scale)
    return np.asarray(disparity.clip(*limits), np.float32), status


def _enlarge(disparity: FloatImage, size: tuple[int, int], scale: float) -> FloatImage:
    """A map for images that are `scale` times as large: between its pixels on surfaces, never across their edges."""
    spread = cv2.dilate(disparity, np.ones((3, 3))) - cv2.erode(disparity, np.ones((3, 3)))
    even = cv2.resize((spread < 1).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 1
    linear, nearest = (cv2.resize(disparity, size, interpolation=i) for i in (cv2.INTER_LINEAR, cv2.INTER_NEAREST))
    return np.asarray(np.where(even, linear, nearest) * np.float32(scale), np.float32)


def _shrink(image: ByteImage, factor: int) -> ByteImage:
    """Smaller by a factor, (H, W, C)."""
    size = max(image.shape[1] // factor, 1), max(image.shape[0] // factor, 1)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8).reshape(size[1], size[0], -1)


@dataclass(frozen=True, eq=False)
class _Image:
    """One image in the forms that are needed: (H, W, C), (C, H, W), gray."""

    pixels: ByteImage
    planes: ByteImage
    gray: Gray
    noise: float

    @classmethod
    def pair(cls, left: ByteImage, right: ByteImage, threads: int) -> tuple[_Image, _Image]:
        """Both, made alike."""
        pixels = [np.ascontiguousarray(np.atleast_3d(image)) for image in (left, right)]
        *grays, noise = gray_pair(pixels[0], pixels[1], threads)
        first, second = (
            cls(p, np.ascontiguousarray(p.transpose(2, 0, 1)), g, noise) for p, g in zip(pixels, grays, strict=True)
        )
        return first, second

    def as_bytes(self) -> ByteImage:
        """Gray, (H, W)."""
        if self.pixels.shape[2] == 1:
            return self.pixels[..., 0]
        return np.asarray(cv2.cvtColor(self.pixels, cv2.COLOR_RGB2GRAY), np.uint8)


def _compare(disparity: FloatImage, right: FloatImage, limits: tuple[int, int], threads: int) -> ByteImage:
    status = np.empty(disparity.shape, np.uint8)
    run_parallel(
        lambda b: left_right_check(disparity, right, *limits, *b, status),
        row_bands(disparity.shape[0], threads),
        threads,
    )
    return status


def _leave_out(blank: Mask, status: ByteImage) -> None:
    """Nothing is known of what has no texture, but that it would lie outside the other view."""
    status[blank & (status != Status.OUTSIDE)] = Status.LOW_TEXTURE


def _planes(
    image: _Image,
    other: _Image,
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
    view = _view(image, other, seen, usable, limits, threads)
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
    image: _Image, other: _Image, seen: FloatImage, usable: Mask, limits: tuple[int, int], threads: int
) -> CostData:
    shape = image.gray.shape
    arms, inverse = np.empty((4, *shape), np.uint8), np.empty(shape, np.float32)
    run_parallel(lambda b: measure_arms(image.pixels, *b, arms), row_bands(shape[0], threads), threads)
    inverse_size(arms, inverse)
    softness, sign = cost_weights(image.noise)
    pattern = WIDE if image.noise > 0.5 else CLOSE
    usual = typical_costs(image.gray, other.gray, pattern, softness, sign, seen, usable)
    largest = len(pattern) * (softness + sign)
    outside = max(usual.matched, OUTSIDE / WORST * usual.cut)
    return CostData(
        extend_borders(image.gray), np.int16(softness), np.int16(sign), np.int16(round(usual.cut * largest)),
        np.int16(round(outside * largest)), pattern, _between_pixels(other.gray, threads), arms, inverse,
        np.float32(limits[0]), np.float32(limits[1]),
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
    start: tuple[FloatImage, Mask],
    images: tuple[_Image, _Image],
    status: ByteImage,
    water: Water,
    limits: tuple[int, int],
    value: float,
    effort: str,
    threads: int,
) -> GraphCutResult:
    valid = status == 0
    nan = np.float32(np.nan)
    left, right = (plain_gray(image.pixels, image.noise) for image in images)
    sigma = np.where(valid, sigma_of(left, right, disparity, status, effort, threads), nan)
    disparity = np.where(valid, disparity, nan)
    confidence = confidence_of(disparity, sigma, *start, effort)
    if SCHEDULES[effort].passes:
        sigma = with_disagreement(sigma, disparity, *start)
    sigma = np.where(confidence < DOUBTFUL, np.maximum(sigma, np.float32(DOUBTFUL_SIGMA)), sigma)
    lost = unfounded(disparity, confidence, water, limits[0])
    status[lost] = np.where(water.faint[lost], int(Status.LOW_TEXTURE), int(Status.INCONSISTENT))
    disparity, sigma, confidence = (np.where(lost, nan, found) for found in (disparity, sigma, confidence))
    return GraphCutResult(disparity, sigma, confidence, status, value)
