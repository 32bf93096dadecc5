"""Two images that come rectified, made ready for the matcher: 8 bits, what they do not show black, doubts told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros.errors import ImageError
from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.preprocess.regions import find_regions
from uw_recon_ros.rectify.given import doubts
from uw_recon_ros.types import MatchingPair, RawImage, StereoCalibration, StereoPair
from uw_recon_ros.unseen import blackened


def stereo_pair(
    left: RawImage, right: RawImage, calibration: StereoCalibration | None = None, name: str = "left, right"
) -> StereoPair:
    """Take two images for one pair.

    Raises
    ------
    ImageError
        They are not mono or RGB of 8 or 16 bits, of one size and kind, or they are the same image.
    """
    images = np.asarray(left), np.asarray(right)
    for image in images:
        if image.dtype not in (np.uint8, np.uint16) or image.shape[2:] not in ((), (3,)) or image.ndim < 2:
            raise ImageError(f"{name}: expected (H, W) or (H, W, 3) uint8 or uint16, got {image.shape} {image.dtype}")
    if images[0].shape != images[1].shape or images[0].dtype != images[1].dtype:
        described = [f"{i.shape[1]}x{i.shape[0]} {'colour' if i.ndim == 3 else 'mono'} {i.dtype}" for i in images]
        raise ImageError(f"{name}: expected two images of one size and kind, got {' and '.join(described)}")
    if np.array_equal(*images):
        raise ImageError(f"{name}: expected two different images, got the same twice", Code.IMAGE_IDENTICAL)
    frame = (calibration.left.frame_id if calibration else "") or "left_optical_frame"
    return StereoPair(*images, frame_id=frame, calibration=calibration)


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
    return MatchingPair(left, right), regions.findings + told


def _as_bytes(pair: StereoPair) -> StereoPair:
    """8 bits a channel: the highest that either image uses, so that both are dimmed alike."""
    if pair.left.dtype == np.uint8:
        return pair
    bits = max(int(max(pair.left.max(), pair.right.max())).bit_length(), 8)
    left, right = ((image >> (bits - 8)).astype(np.uint8) for image in (pair.left, pair.right))
    return replace(pair, left=left, right=right)
