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

from uw_recon_ros.types import Axis, Matrix

DEPTH_RATIO = 25.0
_NEARLY_ALL = 0.95
_TAIL = 0.02
_SURE = 5.0  # standard deviations


def _vote(parallax: Matrix) -> int:
    """Sign of nearly all values; 0 where they are of both."""
    negative = float((parallax < 0).mean())
    return -1 if negative >= _NEARLY_ALL else int(negative <= 1 - _NEARLY_ALL)


def baseline_side(parallax: Matrix, raw_parallax: Matrix, sigma_px: float, axis: Axis) -> int:
    """Side of the second camera: the sign of ``f B / Z``.

    Parameters
    ----------
    parallax : (N,) float64
        Disparity plus offset after rectification, px.
    raw_parallax : (N,) float64
        The same difference of coordinates in the raw images, px: right for cameras that are nearly parallel.
    sigma_px : float
        Standard deviation of infinity in `parallax`, px.
    axis : {'horizontal', 'vertical'}
        Where both contradict each other and the rectified views are not sure, a horizontal rig is taken to be the right
        way round, a vertical one as the raw images say.

    Returns
    -------
    {1, -1}
    """
    rectified, raw = _vote(parallax), _vote(raw_parallax)
    if rectified + raw != 0:
        return -1 if rectified + raw < 0 else 1
    if rectified != 0 and abs(float(np.median(parallax))) > _SURE * sigma_px:
        return rectified
    return raw if axis == "vertical" and raw != 0 else 1


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
