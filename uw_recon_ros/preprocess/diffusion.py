"""Step 6: diffusion that stops at edges (eq. 9-10).

References
----------
.. [1] P. Perona and J. Malik, "Scale-space and edge detection using anisotropic diffusion", IEEE PAMI 12 (1990)
   629-639.
"""

from __future__ import annotations

import numpy as np

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number


def diffuse(luminance: FloatArray, *, contrast: float = 0.1, rate: float = 0.2, iterations: int = 4) -> FloatArray:
    """Smooth areas and keep edges (paper, step 6).

    Parameters
    ----------
    luminance : (H, W) float32 or float64
        Luminance in [0, 1]. Nothing flows over the image's border.
    contrast : float
        The paper's K: differences well above it are edges, luminance.
    rate : float
        The paper's lambda, at most 1/4: then no new extrema arise.
    iterations : int
        A pixel sees that many pixels far.

    Returns
    -------
    (H, W), same dtype
        Of the same mean.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; a contrast not over 0, a rate outside [0, 1/4], negative iterations.
    """
    image = checked_float("luminance", luminance)
    checked_number("contrast", contrast, np.finfo(np.float32).tiny, np.inf)
    checked_number("rate", rate, 0.0, 0.25)
    checked_number("iterations", iterations, 0, np.inf)
    diffused: FloatArray = image.copy()
    for _ in range(iterations):
        flow_v = _flow(np.diff(diffused, axis=0), contrast, rate)
        flow_u = _flow(np.diff(diffused, axis=1), contrast, rate)
        _move(diffused, flow_v)
        _move(diffused.T, flow_u.T)
    return diffused


def _flow(difference: FloatArray, contrast: float, rate: float) -> FloatArray:
    """``rate g(difference) difference`` for each pair of neighbours (eq. 9): N of one pixel is -S of the other."""
    stopping: FloatArray = difference * difference.dtype.type(1.0 / contrast)
    np.square(stopping, out=stopping)
    np.negative(stopping, out=stopping)
    np.exp(stopping, out=stopping)
    stopping *= difference.dtype.type(rate)
    stopping *= difference
    return stopping


def _move(image: FloatArray, flow: FloatArray) -> None:
    """Eq. 10 along the first axis: what one pixel gains, its neighbour loses."""
    image[:-1] += flow
    image[1:] -= flow
