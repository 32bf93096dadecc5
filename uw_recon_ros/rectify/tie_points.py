"""Tie points: matching points of both cameras, sub-pixel, without outliers, spread over the image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.rectify.features import find_features, mutual_matches, spread
from uw_recon_ros.rectify.fundamental import robust_inliers
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.types import ByteImage, EnhancedPair, Mask, Matrix
from uw_recon_ros.unseen_pixels import continued, unseen, with_margin

_TAIL = 0.05
_MARGIN_PX = 20.0
_RICH = 200  # features in either image
_SHARED = 0.055  # of them that match: real canyon 0.08, others 0.14 and more; two scenes 0.02, noise 0.02 to 0.04
_INLIER_SHARE = 0.25  # unrelated images reach about a tenth
_CONTRAST_LIMIT = 3.0  # times the mean of the histogram


@dataclass(frozen=True, eq=False)
class TiePoints:
    """Matching points of one rig, from one frame or several.

    Parameters
    ----------
    left, right : (N, 2) float64
        Pixels (u, v) of the raw images.
    width, height : int
        Size of the raw images, px.
    """

    left: Matrix
    right: Matrix
    width: int
    height: int

    def __post_init__(self) -> None:
        if self.left.shape != self.right.shape or self.left.ndim != 2 or self.left.shape[1] != 2:
            raise ValueError(f"left, right: expected shapes (N, 2), got {self.left.shape} and {self.right.shape}")
        if self.width <= 0 or self.height <= 0:
            raise ValueError(f"width, height: expected > 0, got {self.width}, {self.height}")

    def __len__(self) -> int:
        return len(self.left)

    def take(self, index: NDArray[np.bool_] | NDArray[np.int64]) -> TiePoints:
        """Those at `index`."""
        return TiePoints(self.left[index], self.right[index], self.width, self.height)

    def transposed(self) -> TiePoints:
        """Rows and columns exchanged: a vertical rig becomes a horizontal one."""
        return TiePoints(self.left[:, ::-1], self.right[:, ::-1], self.height, self.width)


def _reduced(gray: ByteImage, longest_side: int) -> tuple[ByteImage, float]:
    scale = longest_side / max(gray.shape)
    if scale >= 1:
        return np.ascontiguousarray(gray), 1.0
    size = tuple(max(1, round(side * scale)) for side in gray.shape[::-1])
    return np.asarray(cv2.resize(gray, size, interpolation=cv2.INTER_AREA), np.uint8), scale


def _even_contrast(gray: ByteImage) -> ByteImage:
    """Contrast limited histogram equalisation: key points everywhere, also in haze and in the dark."""
    return np.asarray(cv2.createCLAHE(_CONTRAST_LIMIT, (8, 8)).apply(np.ascontiguousarray(gray)), np.uint8)


def _reduced_mask(hidden: Mask, reduced: ByteImage) -> Mask:
    """A mask, with its margin, in the size of a reduced image."""
    if not hidden.any():
        return np.zeros(reduced.shape, np.bool_)
    share = cv2.resize(hidden.astype(np.float32), reduced.shape[::-1], interpolation=cv2.INTER_AREA)
    return with_margin(np.asarray(share > 0))


def to_full_size(points: Matrix, reduced: ByteImage, full: ByteImage) -> Matrix:
    """Pixels of a reduced image as pixels of the full one: not (0, 0) but the corners (-0.5, -0.5) coincide."""
    scale = np.array(full.shape[1::-1]) / np.array(reduced.shape[1::-1])
    scaled: Matrix = (points + 0.5) * scale - 0.5
    return scaled


def find_tie_points(pair: EnhancedPair, params: RectifyParams, *, longest_side: int | None = None) -> TiePoints:
    """Find matching points of a pair that one epipolar geometry explains.

    Parameters
    ----------
    pair : EnhancedPair
        What the matcher sees is used, so that no choice of what is shown moves the rows.
    params : RectifyParams
        The ``tie_*`` parameters and the seed.
    longest_side : int or None
        In place of ``tie_image_side``, px.

    Returns
    -------
    TiePoints
        At least ``tie_points_min``, at most ``tie_points_max``.

    Raises
    ------
    EstimationError
        The images show too little texture, or not the same scene; with the counts.
    """
    side = longest_side or params.tie_image_side
    hidden_left, hidden_right = unseen(pair.left_matching), unseen(pair.right_matching)
    left, scale = _reduced(_even_contrast(continued(pair.left_matching, hidden_left)), side)
    right, _ = _reduced(_even_contrast(continued(pair.right_matching, hidden_right)), side)
    points_left, descriptors_left = find_features(left, params, _reduced_mask(hidden_left, left))
    points_right, descriptors_right = find_features(right, params, _reduced_mask(hidden_right, right))
    fewest = min(len(points_left), len(points_right))
    if fewest < params.tie_points_min:
        raise EstimationError(
            f"tie points: expected at least {params.tie_points_min} features a camera, got {len(points_left)} left and "
            f"{len(points_right)} right: the images show too little texture",
            Code.RECTIFY_TIE_POINTS,
        )
    index_left, index_right = mutual_matches(descriptors_left, descriptors_right, params.tie_ratio)
    matches = TiePoints(
        to_full_size(points_left[index_left], left, pair.left),
        to_full_size(points_right[index_right], right, pair.right),
        pair.left.shape[1], pair.left.shape[0],
    )  # fmt: skip
    inside = robust_inliers(matches.left, matches.right, params.tie_threshold_px / scale, params.rectify_seed)
    if inside.any():
        inside[inside] = _coherent(matches.left[inside], matches.right[inside])
    if inside.sum() < max(params.tie_points_min, _INLIER_SHARE * len(matches)):
        raise EstimationError(
            f"tie points: expected at least {params.tie_points_min} matches, a quarter of all, on one epipolar "
            f"geometry, got {inside.sum()} of {len(matches)} matches ({len(points_left)} features left, "
            f"{len(points_right)} right): too little texture, or the cameras do not show the same scene",
            Code.RECTIFY_NOTHING_IN_COMMON if _nothing_in_common(fewest, len(matches)) else Code.RECTIFY_TIE_POINTS,
        )
    return thinned(matches.take(inside), params.tie_points_max, params.rectify_seed)


def _nothing_in_common(features: int, matches: int) -> bool:
    """Whether both images are rich and yet share nothing: noise, or two scenes."""
    return features >= _RICH and matches < _SHARED * features


def _coherent(left: Matrix, right: Matrix) -> NDArray[np.bool_]:
    """Which matches move about as far as the others: a wrong one may lie on its epipolar line, but seldom near."""
    move = left - right
    low, high = np.quantile(move, [_TAIL, 1 - _TAIL], axis=0)
    margin = np.maximum(high - low, _MARGIN_PX)
    inside: NDArray[np.bool_] = ((move >= low - margin) & (move <= high + margin)).all(axis=1)
    return inside


def thinned(tie_points: TiePoints, count: int, seed: int) -> TiePoints:
    """At most `count` of the tie points, spread over the left image."""
    if len(tie_points) <= count:
        return tie_points
    priority = np.random.default_rng(seed).random(len(tie_points))
    return tie_points.take(spread(tie_points.left, priority, count, tie_points.width, tie_points.height))


def gathered(frames: Sequence[TiePoints]) -> TiePoints:
    """The tie points of several frames of one rig.

    Raises
    ------
    ValueError
        There are none, or their image sizes differ.
    """
    sizes = {(t.width, t.height) for t in frames}
    if len(sizes) != 1:
        raise ValueError(f"frames: expected tie points of one image size, got {sorted(sizes)}")
    left, right = (np.concatenate([getattr(t, camera) for t in frames]) for camera in ("left", "right"))
    return TiePoints(left, right, *sizes.pop())
