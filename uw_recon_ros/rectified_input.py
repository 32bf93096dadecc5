"""Two images that come rectified, made ready for the matcher: 8 bits, what they do not show black, doubts told."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ImageError
from uw_recon_ros.findings import Finding
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.preprocess.regions import find_regions
from uw_recon_ros.rectify.check_rectified import doubts
from uw_recon_ros.types import MatchingPair, RawImage, StereoCalibration, StereoPair
from uw_recon_ros.unseen_pixels import blackened


def stereo_pair(
    left: RawImage, right: RawImage, calibration: StereoCalibration | None = None, name: str = "left, right"
) -> StereoPair:
    """Take two images for one pair.

    Raises
    ------
    ImageError
        They are not mono or RGB of 8 or 16 bits, of one size and depth, or they are the same image.
    TypeError
        The calibration is none.
    """
    if calibration is not None and not hasattr(calibration, "left"):
        kind = type(calibration).__name__
        raise TypeError(f"calibration: expected a StereoCalibration, as read_calibration() gives it, got {kind}")
    if any(np.ma.is_masked(image) for image in (left, right)):
        raise ImageError(f"{name}: expected plain arrays, got masked ones: what is 0 is not matched")
    images = np.asarray(left), np.asarray(right)
    for image in images:
        if not _is_image(image):
            raise ImageError(f"{name}: expected (H, W) or (H, W, 3) uint8 or uint16, got {image.shape} {image.dtype}")
    try:
        first, second, findings = as_pair(*images)
    except ImageError as error:
        raise ImageError(f"{name}: {error}", error.code) from error
    frame = (calibration.left.frame_id if calibration else "") or "left_optical_frame"
    return StereoPair(first, second, frame_id=frame, calibration=calibration, findings=findings)


def _is_image(image: NDArray[Any]) -> bool:
    known = image.dtype in (np.uint8, np.uint16) and image.ndim >= 2 and image.shape[2:] in ((), (3,))
    return known and image.size > 0


def ready_to_match(pair: StereoPair, min_disparity: int = 0) -> tuple[MatchingPair, tuple[Finding, ...]]:
    """What the matcher needs, and what is to be known of the images.

    Raises
    ------
    EstimationError
        The images are exchanged.
    """
    pair = _as_bytes(pair)
    told = doubts(pair.left, pair.right, min_disparity)
    regions = find_regions(pair)
    left, right = (blackened(i.copy(), m) for i, m in zip((pair.left, pair.right), regions.masks, strict=True))
    return MatchingPair(left, right), pair.findings + regions.findings + told


def _as_bytes(pair: StereoPair) -> StereoPair:
    """8 bits a channel: the highest that either image uses, so that both are dimmed alike."""
    if pair.left.dtype == np.uint8:
        return pair
    bits = max(int(max(pair.left.max(), pair.right.max())).bit_length(), 8)
    left, right = ((image >> (bits - 8)).astype(np.uint8) for image in (pair.left, pair.right))
    return replace(pair, left=left, right=right)
