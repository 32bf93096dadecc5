"""Whether two images can be a stereo pair: one judge for every door."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.errors import ImageError
from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.images import to_gray
from uw_recon_ros.types import RawImage


def as_pair(left: RawImage, right: RawImage) -> tuple[RawImage, RawImage, tuple[Finding, ...]]:
    """Both images of one kind, where they can be: colour beside mono becomes gray.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16

    Returns
    -------
    left, right : of one shape and dtype
    findings : tuple of Finding
        What was done to them.

    Raises
    ------
    ImageError
        They differ in size, or in bits a channel; or both are the same image.
    """
    for what, differ in (("size", left.shape[:2] != right.shape[:2]), ("depth", left.dtype != right.dtype)):
        if differ:
            code = Code.IMAGE_SIZES_DIFFER if what == "size" else Code.IMAGE_DEPTHS_DIFFER
            raise ImageError(
                f"pair: expected two images of one {what}, got left {_say(left)} and right {_say(right)}: "
                "are both of one camera mode?",
                code,
            )
    findings: tuple[Finding, ...] = ()
    if left.ndim != right.ndim:
        text = f"left is {_kind(left)}, right is {_kind(right)}: both taken as gray"
        findings = (Finding(Code.IMAGE_KINDS_DIFFER, text, advice="set both cameras to one encoding"),)
        left, right = to_gray(left), to_gray(right)
    _refuse_identical(left, right)
    return left, right, findings


def _refuse_identical(left: RawImage, right: RawImage) -> None:
    """Two images of one value each are no less equal, but what they lack is a scene: told of elsewhere."""
    if np.array_equal(left, right) and left.min() != left.max():
        raise ImageError(
            "pair: expected two different images, got the same twice: are both of one camera?", Code.IMAGE_IDENTICAL
        )


def _kind(image: RawImage) -> str:
    return "colour" if image.ndim == 3 else "mono"


def _say(image: RawImage) -> str:
    return f"{image.shape[1]}x{image.shape[0]} px {_kind(image)} {8 * image.itemsize} bits"
