"""How true an uncalibrated shape is: what focal length and plane at infinity leave open of relative depths.

With ``Z = f B / p`` (p the disparity counted from infinity) an error e of infinity scales depths by ``1 - e / p``: the
far ones more than the near ones. An error of the focal length stretches all depths against width and height. Worse
than noise is a lens whose distortion is not known: what it would change, by as much as it is uncertain, is added. Where
the plane at infinity had to be moved, the way it was moved by is as uncertain as it is long.
"""

from __future__ import annotations

import numpy as np

from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.rectify.lens import Lens
from uw_recon_ros.rectify.model_selection import Candidate, fit_rig
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.quasi_euclidean import QuasiEuclidean
from uw_recon_ros.types import Matrix

_TAIL = 0.05
USUAL_FOCAL = 3.0**-0.5  #: of w + h: what the prior of the fit assumes


def shape_sigma(parallax: Matrix, infinity_sigma_px: float, focal_sigma: float) -> float:
    """Standard deviation of relative depths, percent.

    Parameters
    ----------
    parallax : (N,) float64
        Disparity of tie points counted from infinity, px, > 0.
    infinity_sigma_px : float
        Standard deviation of infinity in it, px.
    focal_sigma : float
        Of the focal length, as a share of it.
    """
    far, near = np.quantile(parallax, [_TAIL, 1 - _TAIL])
    bent = infinity_sigma_px * (1 / max(far, 1e-3) - 1 / max(near, 1e-3))
    return 100 * float(np.hypot(bent, focal_sigma))


def with_lens(candidate: Candidate, params: RectifyParams) -> tuple[float, float]:
    """Uncertainties of infinity (px) and focal length (share): the fit's own, and of what is not known of the lens.

    A second fit says how far both would move did the lens bend lines by a standard deviation more.

    Parameters
    ----------
    candidate : Candidate
    params : RectifyParams
    """
    fit, lens = candidate.fit, candidate.lens
    other = fit_rig(Lens(lens.bend - lens.sigma).straightened(candidate.fitted), params)
    infinity = fit.focal_px * (_convergence(other) - _convergence(fit))
    focal = np.log(other.focal_px / fit.focal_px)
    return float(np.hypot(fit.infinity_sigma_px, infinity)), float(np.hypot(fit.focal_sigma, focal))


def _convergence(fit: QuasiEuclidean) -> float:
    """Angle between the optical axes about the vertical, rad."""
    left, right = (np.arctan2(r[0, 2], r[2, 2]) for r in (fit.rotation_left, fit.rotation_right))
    return float(left - right)


def projective(sigma_percent: float, params: RectifyParams) -> tuple[Finding, ...]:
    """A warning over the limit; else none."""
    if sigma_percent <= params.shape_limit_percent:
        return ()
    text = (
        f"the shape is projective: relative depths are uncertain by {sigma_percent:.0f} %, expected up to "
        f"{params.shape_limit_percent:g} %"
    )
    advice = "more depth relief or more frames, a calibration (a board), or focal_px would help"
    return (Finding(Code.RECTIFY_PROJECTIVE, text, advice=advice),)
