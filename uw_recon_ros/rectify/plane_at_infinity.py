"""Where infinity lies, and on which side the second camera stands: what uncalibrated matches leave open.

The quasi-Euclidean homographies stand for rotations, so that points at infinity should have disparity 0. They only
approximate that plane: lens distortion, a principal point off the centre or little relief move it by several, sometimes
tens of pixels (the angle between the optical axes is what is known worst). A wrong plane bends depth, and puts points
behind the rig where it lies between them. That cannot be: what both cameras see lies in front. So the plane is moved,
by as little as is needed, until the farthest tie points lie at most `DEPTH_RATIO` times as far as the nearest; water
ends sight after some metres, so that they do. The disparity itself stays honest; only its offset is a guess.
"""

from __future__ import annotations

import numpy as np

from uw_recon_ros.types import Matrix

DEPTH_RATIO = 25.0
_NEARLY_ALL = 0.95
_TAIL = 0.02
_SURE = 5.0  # standard deviations of the fit
_SURE_OF_LENS = 2.0  # and of a lens that nobody described


def vote(parallax: Matrix) -> int:
    """Sign of nearly all values; 0 where they are of both."""
    negative = float((parallax < 0).mean())
    return -1 if negative >= _NEARLY_ALL else int(negative <= 1 - _NEARLY_ALL)


def baseline_side(parallax: Matrix, sigma_px: float, lens_px: float = 0.0) -> int:
    """Side of the second camera, the sign of ``f B / Z``; 0 where it cannot be told.

    Over a flat floor the angle between the cameras, and so the sign, is nearly free: nothing is said unless the
    rectified views are sure of it, whatever the lens.

    Parameters
    ----------
    parallax : (N,) float64
        Disparity plus offset after rectification, px.
    sigma_px : float
        Standard deviation of infinity in `parallax`, by the fit, px.
    lens_px : float
        The same, a lens that nobody described included, px.

    Returns
    -------
    {1, 0, -1}
    """
    size = abs(float(np.median(parallax)))
    return vote(parallax) if size > max(_SURE * sigma_px, _SURE_OF_LENS * lens_px) else 0


def infinity_shift(parallax: Matrix) -> float:
    """By how much to raise the offset so that the tie points lie in front, and not all too far.

    Parameters
    ----------
    parallax : (N,) float64
        Disparity plus offset, times the baseline's sign, px.

    Returns
    -------
    float
        px, >= 0.
    """
    far, near = np.quantile(parallax, [_TAIL, 1 - _TAIL])
    return max(0.0, float((near / DEPTH_RATIO - far) / (1 - 1 / DEPTH_RATIO)))
