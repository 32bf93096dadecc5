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
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.row_error import RowAgreement, not_checked, scale_withheld
from uw_recon_ros.rectify.seam import torn
from uw_recon_ros.rectify.stage import Rectify
from uw_recon_ros.rectify.tie_points import find_tie_points
from uw_recon_ros.stopwatch import Stopwatch
from uw_recon_ros.survey.store import OK, UNRELIABLE
from uw_recon_ros.types import EnhancedPair, RectifiedPair, StereoPair

QUANTILES = (5, 25, 50, 75, 95)


class WatchedRectify:
    """Rectifies by what is known of the rig, and holds the rows of this very pair against it.

    Parameters
    ----------
    rectify : Rectify
    rectification : Rectification
        The rig's.
    """

    def __init__(self, rectify: Rectify, rectification: Rectification) -> None:
        self._rectify, self._rectification = rectify, rectification
        self.rows = RowAgreement()
        self.findings: tuple[Finding, ...] = ()

    def __call__(self, enhanced: EnhancedPair) -> RectifiedPair:
        """Rectify one pair; without metres where its rows are too far off."""
        params, rectification = self._rectify.params, self._rectification
        self.rows, found = watch_rows(enhanced, rectification, params)
        if scale_withheld(found):
            rectification = replace(rectification, geometry=rectification.geometry.unscaled)
        self.findings = together(enhanced, rectification, found)
        return self._rectify(enhanced, rectification)


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
        self, pair: StereoPair, rectification: Rectification, timed: Stopwatch, before: StereoPair | None = None
    ) -> FrameProducts:
        """Take one pair; nothing is made of it yet."""
        watched = WatchedRectify(self._rectify, rectification)
        stages = Stages(partial(self.enhance, before=before), watched, self._match, self._reconstruct)
        return FrameProducts(pair, stages, watched, timed)


def watch_rows(
    pair: EnhancedPair, rectification: Rectification, params: RectifyParams
) -> tuple[RowAgreement, tuple[Finding, ...]]:
    """How far the rows of this very pair agree, and what is to be told of it."""
    try:
        found = find_tie_points(pair, params)
    except EstimationError as error:
        return RowAgreement(), not_checked(str(error), error.code)
    rows = RowAgreement.measured(rectification, found)
    return rows, rows.findings(params) + torn(rectification, found)


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
    }
