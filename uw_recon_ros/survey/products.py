"""One pair through the stages, and the numbers that describe what came of it."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from uw_recon_ros.calibration.judge import judge_depths
from uw_recon_ros.errors import EstimationError
from uw_recon_ros.files.atomic import finite
from uw_recon_ros.findings import Code, Finding, Severity, severe
from uw_recon_ros.match.stage import Match
from uw_recon_ros.pipeline import PipelineParams, Products, Stages
from uw_recon_ros.preprocess.regions import find_regions
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.late_right import (
    UNSEEN_SPEED,
    LateRight,
    Moments,
    find_motion,
    of_one_moment,
    turned_back,
)
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.rectify.row_error import RowAgreement, not_checked, scale_withheld
from uw_recon_ros.rectify.seam import torn
from uw_recon_ros.rectify.stage import Rectify
from uw_recon_ros.rectify.tie_points import TiePoints, find_tie_points
from uw_recon_ros.stopwatch import Stopwatch
from uw_recon_ros.survey.store import OK, UNRELIABLE
from uw_recon_ros.types import DisparityMap, EnhancedPair, RectifiedPair, StereoPair

QUANTILES = (5, 25, 50, 75, 95)


class WatchedRectify:
    """Rectifies by what is known of the rig, and holds the rows of this very pair against it.

    Parameters
    ----------
    rectify : Rectify
    rectification : Rectification
        The rig's.
    """

    def __init__(self, rectify: Rectify, rectification: Rectification, moments: Moments | None = None) -> None:
        self._rectify, self._rectification, self._moments = rectify, rectification, moments
        self.rows = RowAgreement()
        self.findings: tuple[Finding, ...] = ()
        self.late: LateRight | None = None

    def __call__(self, enhanced: EnhancedPair) -> RectifiedPair:
        """Rectify one pair; without metres where its rows are too far off."""
        params, rectification = self._rectify.params, self._rectification
        points = _tie_points(enhanced, params)
        if self._moments is not None and isinstance(points, TiePoints):
            rectification, self.late = _turned_back(rectification, self._moments, points)
        self.rows, found = watch_rows(points, rectification, params)
        if scale_withheld(found):
            rectification = replace(rectification, geometry=rectification.geometry.unscaled)
        self.findings = together(enhanced, rectification, found + self._not_of_one_moment())
        return self._rectify(enhanced, rectification)

    def _not_of_one_moment(self) -> tuple[Finding, ...]:
        if self._moments is None or self.late is not None:
            return ()
        text = (
            f"the right image was taken {1e3 * self._moments.lag_s:+.1f} ms from the left one, and how the rig moved "
            f"meanwhile is not known: its depths are less sure ({UNSEEN_SPEED:g} m/s assumed)"
        )
        return (Finding(Code.RECORDING_PARTNERS_APART, text, advice="cameras with a common trigger, or higher rates"),)

    def of_one_moment(self, disparity: DisparityMap) -> DisparityMap:
        """Disparities as if both images had been taken at once."""
        return disparity if self._moments is None else of_one_moment(disparity, self.late, self._moments.lag_s)

    def lag(self) -> dict[str, Any]:
        """For the frame's row: how far the images are apart, and how far the rig moved along the baseline meanwhile."""
        if self._moments is None:
            return {}
        moved = None if self.late is None else 1e3 * self.late.moved
        return {"lag_ms": 1e3 * self._moments.lag_s, "moved_mm": moved}


class FrameProducts(Products):
    """All that comes of one frame of a survey."""

    def __init__(self, raw: StereoPair, stages: Stages, watched: WatchedRectify, timed: Stopwatch) -> None:
        super().__init__(raw, stages, timed)
        self._watched = watched

    @property
    def rows(self) -> RowAgreement:
        """Of this very pair's tie points."""
        _ = self.rectified
        return self._watched.rows

    @property
    def lag(self) -> dict[str, Any]:
        """Of the pair's images, where they were not taken at one moment."""
        _ = self.rectified
        return self._watched.lag()

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Of the rig, of this pair, and of what its depths can be."""
        _ = self.rectified
        return self._watched.findings + judge_depths(self.depth)


class FramePipeline:
    """The nodes' stages in a row, for rigs whose rectification is known and pairs in any order."""

    def __init__(self, params: PipelineParams) -> None:
        self._preprocess = Preprocess(params.preprocess)
        self._rectify = Rectify(params.rectify)
        self._match = Match(replace(params.match, match_threads=1))  # the cores are shared out by frames
        self._reconstruct = Reconstruct(params.reconstruct)

    def enhance(self, pair: StereoPair, before: StereoPair | None) -> EnhancedPair:
        """Enhance one pair; `before` tells what of it is frozen."""
        return self._preprocess(pair, find_regions(pair, before))

    def __call__(
        self,
        pair: StereoPair,
        rectification: Rectification,
        timed: Stopwatch,
        before: StereoPair | None = None,
        moments: Moments | None = None,
    ) -> FrameProducts:
        """Take one pair; nothing is made of it yet."""
        watched = WatchedRectify(self._rectify, rectification, moments)
        stages = Stages(
            partial(self.enhance, before=before), watched,
            lambda rectified: watched.of_one_moment(self._match(rectified)), self._reconstruct,
        )  # fmt: skip
        return FrameProducts(pair, stages, watched, timed)


def _tie_points(pair: EnhancedPair, params: RectifyParams) -> TiePoints | EstimationError:
    """Of this very pair, or why there are none."""
    try:
        return find_tie_points(pair, params)
    except EstimationError as error:
        return error


def watch_rows(
    found: TiePoints | EstimationError, rectification: Rectification, params: RectifyParams
) -> tuple[RowAgreement, tuple[Finding, ...]]:
    """How far the rows of a pair with these tie points agree, and what is to be told of it."""
    if isinstance(found, EstimationError):
        return RowAgreement(), not_checked(str(found), found.code)
    rows = RowAgreement.measured(rectification, found)
    return rows, rows.findings(params) + torn(rectification, found)


def _turned_back(
    rectification: Rectification, moments: Moments, points: TiePoints
) -> tuple[Rectification, LateRight | None]:
    """The rig's rectification for a late right image; as it was where nobody can tell how the rig moved."""
    if rectification.quality.method != "calibrated" or not isinstance(rectification.right, RectifiedCamera):
        return rectification, None
    motion = find_motion(moments, points, rectification)
    return turned_back(rectification, motion, moments.lag_s, points) if motion is not None else (rectification, None)


def together(pair: EnhancedPair, rig: Rectification, rows: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """All findings, of each code the last; that the rig could not be checked is settled by a check of the pair."""
    of_rig = tuple(finding for finding in rig.quality.warnings if finding.code != Code.RECTIFY_NOT_CHECKED)
    return tuple({finding.code: finding for finding in (*pair.findings, *of_rig, *rows)}.values())


def describe(products: FrameProducts) -> dict[str, Any]:
    """The numbers of a frame's row; None where there is none."""
    disparity, depth = products.disparity, products.depth
    valid = depth.depth[np.isfinite(depth.depth)]
    quantiles = np.percentile(valid, QUANTILES) if valid.size else [None] * len(QUANTILES)
    alarms = [str(finding) for finding in products.findings if finding.severity >= Severity.UNRELIABLE]
    return {
        "status": UNRELIABLE if alarms else OK,
        "reason": "; ".join(alarms),
        "density": disparity.density,
        "row_error_median_px": finite(products.rows.median_px),
        "row_error_p95_px": finite(products.rows.p95_px),
        "residual_row_px": finite(disparity.rows.median_px),
        **{f"depth_p{q:02d}": finite(value) for q, value in zip(QUANTILES, quantiles, strict=True)},
        "depth_density": float(valid.size / depth.depth.size),
        "scale": "metric" if depth.geometry.metric else "unknown",
        "min_disparity": disparity.min_disparity,
        "max_disparity": disparity.max_disparity,
        "method": disparity.method,
        "energy": finite(disparity.energy),
        "rectification": products.rectified.quality.method,
        "findings": [finding.as_dict() for finding in severe(products.findings)],
        **products.lag,
    }
