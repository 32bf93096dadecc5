"""The matching stage: a rectified pair in, disparity with status and uncertainty out."""

from __future__ import annotations

import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.masks import only_where
from uw_recon_ros.match.disparity_range import find_disparity_range
from uw_recon_ros.match.methods import EFFORTS, METHODS, NETWORK_VALUES
from uw_recon_ros.match.planes.confidence import confidence_of, signs_of_error
from uw_recon_ros.match.planes.initial_disparity import Beginning
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.planes.previous_frame import FrameBefore
from uw_recon_ros.match.row_correction import Mended, mend_rows
from uw_recon_ros.match.status import explain
from uw_recon_ros.match.window import paste, window_to_match
from uw_recon_ros.params import Params, param
from uw_recon_ros.types import (
    ByteImage,
    DisparityMap,
    FloatImage,
    Mask,
    Matches,
    MatchingPair,
    RectifiedPair,
    RowOffset,
    Status,
    Window,
)
from uw_recon_ros.unseen_pixels import continued, unseen

if TYPE_CHECKING:
    from uw_recon_ros.match.stereo_network import StereoNetwork

#: Standard deviation of a whole-pixel graph cut's disparity, px: rounding (0.29) and the stairs it makes of slanted
#: surfaces; 0.37 to 0.56 on six scenes (``test/benchmark/reconstruct_defaults.py sigma --kz2``).
WHOLE_PIXEL_SIGMA = 0.55
T = TypeVar("T", bound=np.generic)
_MOST_UNSEEN = 0.98  # of an image that is matched all the same
_WIDEST = 16384  # px: labels are 16-bit integers


@dataclass(frozen=True)
class MatchParams(Params):
    """Parameters of `Match`."""

    method: str = param("graph_cut", "Matching method.", choices=METHODS)
    effort: str = param(
        "balanced",
        "Effort of graph_cut: navigation takes a tenth of a second, balanced about one, quality many.",
        choices=EFFORTS,
    )
    min_disparity: int = param(
        0,
        "Smallest disparity searched, inclusive; equal to max_disparity: both are found from the images.",
        unit="px",
        low=-_WIDEST,
        high=_WIDEST,
    )
    max_disparity: int = param(0, "Greatest disparity searched, inclusive.", unit="px", low=-_WIDEST, high=_WIDEST)
    kz2_sweeps: int = param(4, "Most rounds of expansions over all labels (kz2).", low=1, high=100)
    match_seed: int = param(
        0, "Random seed: order of the labels (kz2), choice of the planes (graph_cut).", low=0, high=2**31 - 1
    )
    occlusion_cost: float = param(
        0.0,
        "Cost of a pixel left unmatched (K of kz2); 0: estimated from the images.",
        unit="squared gray levels",
        low=0,
        high=1e4,
    )
    smoothness: float = param(
        0.0,
        "Cost of a disparity step at an edge, three times as much elsewhere (lambda of kz2); 0: a fifth of "
        "occlusion_cost.",
        unit="squared gray levels",
        low=0,
        high=1e4,
    )
    use_previous: bool = param(
        False,
        "Nodes start graph_cut from the last frame's surfaces, moved along: a fourth less time, about as accurate; but "
        "what a frame gives then depends on those before it.",
    )
    mend_rows: bool = param(
        True,
        "Rows of the right view that lie too high or low, as the pair itself shows, are mended for graph_cut.",
    )
    start_network: str = param(
        "",
        "ONNX file of a stereo network of yours that stands in for the semi-global start of graph_cut (extra "
        "`network`); empty: none. Nothing is downloaded.",
    )
    start_network_values: str = param(
        NETWORK_VALUES[0], "What that network wants gray levels from 0 to 255 to be.", choices=NETWORK_VALUES
    )
    start_network_output: str = param(
        "", "Name of that network's disparity; empty: its only output as large as the images."
    )
    match_threads: int = param(
        0, "Threads that share the work; 0: one a processor. The result does not depend on it.", low=0, high=64
    )

    def check_together(self) -> None:
        """Refuse an empty range, and a network that is not there."""
        if self.max_disparity < self.min_disparity:
            raise ValueError(
                f"max_disparity: expected at least min_disparity = {self.min_disparity} px, got {self.max_disparity}"
            )
        if self.start_network and self.method != "graph_cut":
            raise ValueError(f"start_network: expected method graph_cut, which alone starts from it, got {self.method}")
        if self.start_network and not Path(self.start_network).is_file():
            raise ValueError(f"start_network: expected an ONNX file, got {self.start_network!r}, which is none")


@dataclass(frozen=True, eq=False)
class _Solution:
    """What either method finds, rows matching: NaN = no match, and the reason where the method knows it, else 0."""

    disparity: FloatImage
    sigma: FloatImage
    confidence: FloatImage
    reason: ByteImage
    energy: float
    frame: FrameBefore | None = None


@dataclass(frozen=True)
class Match:
    """Dense matching (paper section 2.3).

    The same pair and parameters give the same bits, whatever the number of threads.

    Parameters
    ----------
    params : MatchParams
    """

    params: MatchParams = field(default_factory=MatchParams)

    def __call__(self, pair: RectifiedPair) -> DisparityMap:
        """Match what the pair shows the matcher.

        Parameters
        ----------
        pair : RectifiedPair
            ``left_matching`` and ``right_matching`` may be mono (H, W) or RGB (H, W, 3).

        Returns
        -------
        DisparityMap
            Energy in the units of the method: for kz2, the energy times the denominator of its constants; for
            graph_cut, that of its planes, NaN for the effort that has none.

        Raises
        ------
        EstimationError
            An image shows nothing; no limits are given, and the images do not show them; the views' valid windows
            share no rows; or the user's network cannot be loaded or fails.
        """
        return self.follow(pair, None)[0]

    def follow(self, pair: RectifiedPair, before: FrameBefore | None) -> tuple[DisparityMap, FrameBefore | None]:
        """Match a pair that continues another.

        Parameters
        ----------
        pair : RectifiedPair
        before : FrameBefore or None
            What this method gave for a pair shortly before. One of another size counts as none.

        Returns
        -------
        disparity : DisparityMap
            As of a call, with fewer planes tried where `before` is given.
        frame : FrameBefore or None
            For the next pair; None: the method or effort has nothing to hand on.
        """
        found, frame = self.images(pair.to_match, before)
        disparity = DisparityMap(
            disparity=found.disparity,
            sigma=found.sigma,
            confidence=found.confidence,
            rows=found.rows,
            status=found.status,
            min_disparity=found.min_disparity,
            max_disparity=found.max_disparity,
            geometry=pair.geometry,
            method=found.method,
            energy=found.energy,
            stamp_ns=pair.stamp_ns,
            frame_id=pair.frame_id,
        )
        return disparity, frame

    def images(self, pair: MatchingPair, before: FrameBefore | None = None) -> tuple[Matches, FrameBefore | None]:
        """As `follow`, for images alone: matching needs no cameras."""
        vertical = pair.axis == "vertical"
        window = window_to_match(pair)
        shape = pair.left.shape[:2]
        unseen_parts = _unseen_parts(pair)
        left, right = (
            _along_rows(continued(image, part)[window.slices], vertical)
            for image, part in zip((pair.left, pair.right), unseen_parts, strict=True)
        )
        hidden = _hidden(unseen_parts, window, vertical)
        low, high = self._limits(left, right)
        mended = self._mended(left, right, low, high)
        start = self._network_start(left, mended.right, low, high) or mended.start
        result = self._solve(left, mended.right, low, high, before, start, hidden)
        nan = np.float32(np.nan)
        disparity, *trust = (
            paste(_as_seen(found, vertical), window, shape, nan)
            for found in (result.disparity, result.sigma, result.confidence)
        )
        reason = paste(_as_seen(result.reason, vertical), window, shape, np.uint8(0))
        status = explain(disparity, low, high, pair)
        known = (status == Status.OCCLUDED) & (reason != 0)
        status[known] = reason[known]
        valid = status == 0
        disparity, sigma, confidence = (only_where(valid, values) for values in (disparity, *trust))
        method, energy = self.params.method, result.energy
        return Matches(
            disparity, sigma, status, low, high, method, energy, confidence=confidence, rows=mended.offset
        ), result.frame

    def _mended(self, left: ByteImage, right: ByteImage, low: int, high: int) -> Mended:
        """The right view with its rows as those of the left; kz2 takes images as they are."""
        if not self.params.mend_rows or self.params.method == "kz2":
            return Mended(right, RowOffset(), None)
        return mend_rows(left, right, low, high, self._threads)

    def _network_start(self, left: ByteImage, right: ByteImage, low: int, high: int) -> Beginning | None:
        """Of the user's network, if there is one."""
        if not self.params.start_network:
            return None
        from uw_recon_ros.match.network_start import begin_with  # few have one

        return begin_with(self._network(), left, right, low, high, self._threads)

    def _network(self) -> StereoNetwork:
        from uw_recon_ros.match.stereo_network import load_network

        given = self.params
        return load_network(given.start_network, given.start_network_values, given.start_network_output, self._threads)

    @property
    def _threads(self) -> int:
        return self.params.match_threads or _processors()

    def warm_up(self) -> None:
        """Have everything compiled that a call needs: a moment from the cache, half a minute the first time ever.

        Raises
        ------
        EstimationError
            A network is to be used, and cannot be loaded.
        """
        if self.params.start_network:
            self._network()
        noise = np.random.RandomState(0).randint(0, 256, (64, 96), np.uint8)
        find_disparity_range(noise, noise)
        for image in (noise, np.dstack([noise] * 3)):
            self._solve(image, image, 0, 1)

    def _limits(self, left: ByteImage, right: ByteImage) -> tuple[int, int]:
        low, high = self.params.min_disparity, self.params.max_disparity
        return (low, high) if low < high else find_disparity_range(_gray(left), _gray(right))

    def _solve(
        self,
        left: ByteImage,
        right: ByteImage,
        low: int,
        high: int,
        before: FrameBefore | None = None,
        start: Beginning | None = None,
        hidden: tuple[Mask, Mask] | None = None,
    ) -> _Solution:
        threads = self._threads
        if self.params.method == "kz2":
            return self._kz2(left, right, low, high, threads)
        if before is not None and before.gray.shape != left.shape[:2]:
            before = None
        seed, effort = self.params.match_seed, self.params.effort
        result = graph_cut(
            left, right, low, high,
            effort=effort, seed=seed, threads=threads, before=before, start=start, hidden=hidden,
        )  # fmt: skip
        trust = result.sigma, result.confidence
        return _Solution(result.disparity, *trust, result.status, result.energy, result.frame)

    def _kz2(self, left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> _Solution:
        from uw_recon_ros.match.kz2.matcher import kz2  # the other method need not load it

        params = self.params
        result = kz2(
            left,
            right,
            low,
            high,
            sweeps=params.kz2_sweeps,
            seed=params.match_seed,
            occlusion_cost=params.occlusion_cost,
            smoothness=params.smoothness,
            threads=threads,
        )
        sigma = np.full(result.disparity.shape, WHOLE_PIXEL_SIGMA, np.float32)
        disparity, known = result.disparity, np.isfinite(result.disparity)
        none = np.zeros(sigma.shape, np.uint8)
        signs = signs_of_error(disparity, sigma, disparity, none, 0.0)
        confidence = np.where(known, confidence_of(signs, "navigation"), np.float32(np.nan))
        return _Solution(disparity, sigma, confidence, none, float(result.energy))


def _unseen_parts(pair: MatchingPair) -> tuple[Mask, Mask]:
    """Where the left and the right image show nothing: they are continued there, so that no edge of that is matched.

    Raises
    ------
    EstimationError
        An image shows nothing, or next to nothing.
    """
    parts = unseen(pair.left), unseen(pair.right)
    for name, part in zip(("left", "right"), parts, strict=True):
        if part.mean() > _MOST_UNSEEN:
            raise EstimationError(
                f"{name} image: expected a scene on at least {1 - _MOST_UNSEEN:.0%} of its pixels, got "
                f"{1 - part.mean():.1%}, the others show nothing: check camera, cable and transfer",
                Code.MATCH_NOTHING_SEEN,
            )
    return parts


def _hidden(unseen_parts: tuple[Mask, Mask], window: Window, vertical: bool) -> tuple[Mask, Mask] | None:
    """The same of the window that is matched, rows matching; None where both views are whole there."""
    left, right = (_along_rows(part[window.slices], vertical) for part in unseen_parts)
    return (left, right) if left.any() or right.any() else None


def _processors() -> int:
    """How many this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _along_rows(image: NDArray[T], vertical: bool) -> NDArray[T]:
    """The image so that matching pixels share a row."""
    return np.ascontiguousarray(np.swapaxes(image, 0, 1) if vertical else image)


def _as_seen(found: NDArray[T], vertical: bool) -> NDArray[T]:
    """Undo `_along_rows`."""
    return np.ascontiguousarray(found.T) if vertical else found


def _gray(image: ByteImage) -> ByteImage:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY), np.uint8)
