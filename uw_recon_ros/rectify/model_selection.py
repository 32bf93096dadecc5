"""Fits of both axes, the likelier of them, and whether one was needed at all."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from uw_recon_ros.rectify.lens import Lens
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.quasi_euclidean import QuasiEuclidean, fit_quasi_euclidean
from uw_recon_ros.rectify.rectification import row_statistics
from uw_recon_ros.rectify.sampson import sampson_distance
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Axis, Mask

_TRIM_SIGMA = 2.5
_TRIM_FLOOR_PX = 0.5
_GIVEN_SLACK = 1.15  # rows as they came count as good as the fit's up to this factor, and a twentieth of a pixel
_GIVEN_SLACK_PX = 0.05


@dataclass(frozen=True, eq=False)
class Candidate:
    """A fit for one axis, in a frame where that axis is horizontal.

    Parameters
    ----------
    axis : {'horizontal', 'vertical'}
        Of the rig.
    fitted, held_out, everything : TiePoints
        Those of the fit, those it is measured on, both together.
    fit : QuasiEuclidean
        To what its lens straightens.
    lens : Lens
    """

    axis: Axis
    fitted: TiePoints
    held_out: TiePoints
    everything: TiePoints
    fit: QuasiEuclidean
    lens: Lens = field(default_factory=Lens)


def fit_rig(tie_points: TiePoints, params: RectifyParams) -> QuasiEuclidean:
    """Fit to all tie points of a horizontal rig."""
    return fit_quasi_euclidean(
        tie_points.left, tie_points.right, tie_points.width, tie_points.height,
        focal_px=params.focal_px or None, prior_weight=params.rig_prior_weight, seed=params.rectify_seed,
    )  # fmt: skip


def trimmed_fit(tie_points: TiePoints, first: QuasiEuclidean, params: RectifyParams) -> QuasiEuclidean:
    """Fit again without the matches that stray, twice."""
    fit = first
    for _ in range(2):
        distance = np.abs(sampson_distance(fit.fundamental, tie_points.left, tie_points.right))
        limit = max(_TRIM_SIGMA * 1.4826 * float(np.median(distance)), _TRIM_FLOOR_PX)
        if (distance > limit).sum() in (0, len(tie_points)):
            return fit
        fit = fit_rig(tie_points.take(distance <= limit), params)
    return fit


def _candidate(axis: Axis, tie_points: TiePoints, held: Mask, params: RectifyParams) -> Candidate:
    level = tie_points if axis == "horizontal" else tie_points.transposed()
    fitted = level.take(~held)
    return Candidate(axis, fitted, level.take(held), level, fit_rig(fitted, params))


def choose_axis(tie_points: TiePoints, params: RectifyParams) -> Candidate:
    """The axis asked for; else the one whose rig is the likelier: a wrong one needs turned cameras or bad rows."""
    held = np.zeros(len(tie_points), bool)
    order = np.random.default_rng(params.rectify_seed).permutation(len(tie_points))
    held[order[: max(3, round(params.tie_held_out * len(tie_points)))]] = True
    axes: tuple[Axis, ...] = ("horizontal", "vertical")
    if params.rig_axis != "auto":
        axes = tuple(axis for axis in axes if axis == params.rig_axis)
    candidates = [_candidate(axis, tie_points, held, params) for axis in axes]
    chosen = min(candidates, key=lambda c: c.fit.cost_px2)
    return replace(chosen, fit=trimmed_fit(chosen.fitted, chosen.fit, params))


def rows_already_aligned(candidate: Candidate, params: RectifyParams) -> bool:
    """Whether the images' own rows agree, about as well as the fit could make them."""
    rows = candidate.everything.left[:, 1] - candidate.everything.right[:, 1]
    if row_statistics(rows)[0] > params.given_limit_px or params.given_limit_px == 0:
        return False
    fitted = sampson_distance(candidate.fit.fundamental, candidate.everything.left, candidate.everything.right)
    ours, theirs = np.sqrt(np.mean(np.square(rows / np.sqrt(2)))), np.sqrt(np.mean(np.square(fitted)))
    return bool(ours <= _GIVEN_SLACK * theirs + _GIVEN_SLACK_PX)
