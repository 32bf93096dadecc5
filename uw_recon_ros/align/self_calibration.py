"""What a dive says about its own rig: the error of the disparity's offset and of the focal length."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.track.keypoints import RigError
from uw_recon_ros.track.relate import KeyPointMatches, RelativePose, huber, linearise, refine, rig_slopes
from uw_recon_ros.types import Matrix, StereoGeometry

_RELATIONS = 150
_ROUNDS = 6
_SIGNIFICANT = 4.0  # standard deviations
_SURE_PX, _SURE_FOCAL = 0.1, 0.002  # sigma beyond which nothing is corrected: mud biases the matcher more than that
_DILUTED = 0.3  # measured on seven simulated dives: what noise pretends, of the mean disparity times noise over spread
_PRIOR = np.array([1.0, 0.01])  # px, and relative: what a told rig may well be off by


@dataclass(frozen=True)
class RigFinding:
    """The told rig's error as the dive shows it.

    Parameters
    ----------
    error : RigError
    offset_sigma_px, focal_sigma : float
        Standard deviations, from the scatter between relations; the offset's with what noise may pretend.
    relations : int
        How many it was found from.
    """

    error: RigError
    offset_sigma_px: float
    focal_sigma: float
    relations: int

    @property
    def offset_significant(self) -> bool:
        """Whether the disparity's offset is no accident."""
        return abs(self.error.offset_px) > max(_SIGNIFICANT * self.offset_sigma_px, 0.02)

    @property
    def focal_significant(self) -> bool:
        """Whether the focal length's error is none."""
        return abs(self.error.focal) > max(_SIGNIFICANT * self.focal_sigma, 0.0005)

    @property
    def applied(self) -> RigError:
        """The part that is significant and well enough known."""
        offset = self.offset_significant and self.offset_sigma_px < _SURE_PX
        focal = self.focal_significant and self.focal_sigma < _SURE_FOCAL
        return RigError(self.error.offset_px if offset else 0.0, self.error.focal if focal else 0.0)


def _reduced(
    motion: Matrix, matches: KeyPointMatches, geometry: StereoGeometry, rig: RigError, sigma: float
) -> tuple[Matrix, Matrix]:
    """Normal equations (2, 2) and (2,) of the rig's error, the motion eliminated (Schur)."""
    at = linearise(motion, matches, geometry, rig, sigma)
    weights = huber(at.squares)[:, None, None]
    j, r = np.nan_to_num(at.slopes), np.nan_to_num(at.residuals)[..., None]
    c = np.nan_to_num(at.white @ rig_slopes(motion, matches, geometry, rig))
    jj = (j.transpose(0, 2, 1) @ (weights * j)).sum(axis=0) + 1e-9 * np.eye(6)
    jc = (j.transpose(0, 2, 1) @ (weights * c)).sum(axis=0)
    cc = (c.transpose(0, 2, 1) @ (weights * c)).sum(axis=0)
    jr, cr = (j.transpose(0, 2, 1) @ (weights * r)).sum(axis=0), (c.transpose(0, 2, 1) @ (weights * r)).sum(axis=0)
    back = np.linalg.solve(jj, np.column_stack([jc, jr]))
    return cc - jc.T @ back[:, :2], (cr - jc.T @ back[:, 2:])[:, 0]


def calibrate(relations: Sequence[RelativePose], geometry: StereoGeometry, sigma_px: float) -> RigFinding | None:
    """Find the two errors from many relations at once.

    Parameters
    ----------
    relations : sequence of RelativePose
        With their matches.
    geometry : StereoGeometry
        As told.
    sigma_px : float
        Of a key point's place.

    Returns
    -------
    RigFinding or None
        None with fewer than ten relations.

    Notes
    -----
    The relations are independent but for the rig, so each gives two equations once its motion is eliminated. Sigma is
    the sandwich estimate over relations: it holds although key points of one relation are wrong together. What all
    relations have in common does not scatter: noise of the disparities makes a flat bottom look less flat than
    it moves (regression dilution; Fuller, Measurement error models, 1987), as an offset would. See `_pretended_px`.
    """
    usable = [r for r in relations if r.matches is not None and r.inliers >= 30]
    usable = usable[:: max(1, -(-len(usable) // _RELATIONS))]
    if len(usable) < 10:
        return None
    motions = [rigid.inverse(r.motion) for r in usable]
    seen = [r.matches.unpacked() for r in usable if r.matches is not None]
    found = np.zeros(2)
    for _ in range(_ROUNDS):
        rig = RigError(float(found[0]), float(found[1]))
        motions = [refine(m, matches, geometry, sigma_px, rig)[0] for m, matches in zip(motions, seen, strict=True)]
        terms = [_reduced(m, matches, geometry, rig, sigma_px) for m, matches in zip(motions, seen, strict=True)]
        normal = np.sum([a for a, _ in terms], axis=0) + np.diag(1 / _PRIOR**2)
        pull = np.array([b for _, b in terms])
        step = np.linalg.solve(normal, pull.sum(axis=0) - found / _PRIOR**2)
        found = found + step
        if (np.abs(step) < (1e-4, 1e-6)).all():
            break
    inverse = np.linalg.inv(normal)
    spread = pull - pull.mean(axis=0)
    covariance = inverse @ (spread.T @ spread + np.diag(1 / _PRIOR**2)) @ inverse
    offset, focal = np.sqrt(np.diag(covariance))
    offset = np.hypot(offset, _pretended_px(seen))
    return RigFinding(RigError(float(found[0]), float(found[1])), float(offset), float(focal), len(usable))


def _pretended_px(seen: Sequence[KeyPointMatches]) -> float:
    """Offset that noise alone may look like where disparities hardly differ over the view."""
    mean, spread, noise = np.median(
        [(m.first[:, 2].mean(), m.first[:, 2].std(), np.sqrt(np.square(m.sigma_first).mean())) for m in seen], axis=0
    )
    return float(_DILUTED * abs(mean) * (noise / max(spread, 1e-6)) ** 2)


def corrected(relation: RelativePose, geometry: StereoGeometry, sigma_px: float, rig: RigError) -> RelativePose:
    """The relation as the corrected rig gives it; a bridge stays as it is."""
    if relation.matches is None:
        return relation
    motion, _, chi2 = refine(rigid.inverse(relation.motion), relation.matches.unpacked(), geometry, sigma_px, rig)
    return RelativePose(
        rigid.inverse(motion), relation.covariance, relation.inliers, chi2, relation.rival, relation.matches
    )
