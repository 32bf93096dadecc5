"""Images that are said to be rectified: do they look like it?"""

from __future__ import annotations

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.images import to_gray
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.row_error import not_checked
from uw_recon_ros.rectify.tie_points import find_tie_points
from uw_recon_ros.types import ByteImage, EnhancedPair

_BEHIND_PX = 1.0
_NEARLY_ALL = 0.95
_ROWS_PX = 1.0


def doubts(left: ByteImage, right: ByteImage, min_disparity: int) -> tuple[Finding, ...]:
    """What speaks against it: rows that disagree; nothing could be measured.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
    min_disparity : int
        Least disparity that is expected, px.

    Raises
    ------
    EstimationError
        The images are exchanged.
    """
    pair = EnhancedPair(_rgb(left), _rgb(right), to_gray(left), to_gray(right))
    try:
        found = find_tie_points(pair, RectifyParams())
    except EstimationError as error:
        return not_checked(str(error))
    u, v = (found.left - found.right).T
    if np.mean(u < -_BEHIND_PX) > _NEARLY_ALL and min_disparity >= 0:
        raise EstimationError(
            "left and right images are swapped: "
            f"expected disparities over 0, got {np.mean(u < 0):.0%} of {len(found)} tie points under "
            f"it (median {np.median(u):.1f} px): swap the images, or give a --min-disparity under 0",
            Code.MATCH_EXCHANGED,
        )
    median = float(np.median(np.abs(v)))
    if median <= _ROWS_PX:
        return ()
    text = f"not rectified? vertical (epipolar) error is {median:.1f} px (median of {len(found)} tie points)"
    return (Finding(Code.RECTIFY_ROWS_DISAGREE, text, Severity.UNRELIABLE, "rectify them, as `pair` does"),)


def _rgb(image: ByteImage) -> ByteImage:
    return image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
