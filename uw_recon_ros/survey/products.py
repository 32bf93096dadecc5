"""One pair through the stages, and the numbers that describe what came of it."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding, Severity, severe
from uw_recon_ros.match.stage import Match
from uw_recon_ros.pipeline import PipelineParams
from uw_recon_ros.preprocess.regions import find_regions
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.rows import RowAgreement, not_checked
from uw_recon_ros.rectify.seam import torn
from uw_recon_ros.rectify.stage import Rectify
from uw_recon_ros.rectify.tie_points import find_tie_points
from uw_recon_ros.survey.store import OK, UNRELIABLE
from uw_recon_ros.types import (
    DepthMap,
    DisparityMap,
    EnhancedPair,
    PointCloud,
    RectifiedPair,
    StereoPair,
    Surface,
)

QUANTILES = (5, 25, 50, 75, 95)


@dataclass
class Stopwatch:
    """Wall time of each stage, s; what is timed inside another block is not counted twice."""

    seconds: dict[str, float] = field(default_factory=dict)
    _inside: list[float] = field(default_factory=list)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a block."""
        started = time.perf_counter()
        self._inside.append(0.0)
        try:
            yield
        finally:
            elapsed, inner = time.perf_counter() - started, self._inside.pop()
            self.seconds[stage] = self.seconds.get(stage, 0.0) + elapsed - inner
            if self._inside:
                self._inside[-1] += elapsed


@dataclass(frozen=True)
class Products:
    """All that came of one pair; clouds and surface are made when they are asked for.

    Parameters
    ----------
    enhanced, rectified, disparity, depth
        In the order they were made.
    rows : RowAgreement
        Of this very pair's tie points.
    findings : tuple of Finding
        Of the rig and of this pair.
    reconstruct : Reconstruct
    timed : Stopwatch
    """

    enhanced: EnhancedPair
    rectified: RectifiedPair
    disparity: DisparityMap
    depth: DepthMap
    rows: RowAgreement
    findings: tuple[Finding, ...]
    reconstruct: Reconstruct
    timed: Stopwatch

    @cached_property
    def cloud(self) -> PointCloud:
        """A point a pixel."""
        with self.timed("cloud"):
            return self.reconstruct.cloud(self.depth, self.rectified.left)

    @cached_property
    def thinned(self) -> PointCloud:
        """A point a voxel."""
        cloud = self.cloud
        with self.timed("cloud"):
            return self.reconstruct.thin(cloud)

    @cached_property
    def surface(self) -> Surface:
        """The textured mesh."""
        with self.timed("surface"):
            return self.reconstruct.surface(self.depth, self.rectified.left)


class Stages:
    """The nodes' stages in a row, for a rig whose rectification is known."""

    def __init__(self, params: PipelineParams) -> None:
        self._preprocess = Preprocess(params.preprocess)
        self._rectify_params = params.rectify
        self._rectify = Rectify(params.rectify)
        self._match = Match(replace(params.match, match_threads=1))  # the cores are shared out by frames
        self._reconstruct = Reconstruct(params.reconstruct)

    def enhance(self, pair: StereoPair, before: StereoPair | None) -> EnhancedPair:
        """Enhance one pair; `before` tells what of it is frozen."""
        return self._preprocess(pair, find_regions(pair, before))

    def __call__(
        self, pair: StereoPair, rectification: Rectification, timed: Stopwatch, before: StereoPair | None = None
    ) -> Products:
        """Reconstruct one pair.

        Raises
        ------
        ReconError
            What the images did not allow, with the numbers.
        """
        with timed("preprocess"):
            enhanced = self.enhance(pair, before)
        with timed("rectify"):
            rows, found = watch_rows(enhanced, rectification, self._rectify_params)
            if rows.withheld(self._rectify_params):
                rectification = replace(rectification, geometry=rectification.geometry.unscaled)
            rectified = self._rectify(enhanced, rectification)
            findings = together(enhanced, rectification, found)
        with timed("match"):
            disparity = self._match(rectified)
        with timed("depth"):
            depth = self._reconstruct.depth(disparity)
        return Products(enhanced, rectified, disparity, depth, rows, findings, self._reconstruct, timed)


def watch_rows(
    pair: EnhancedPair, rectification: Rectification, params: RectifyParams
) -> tuple[RowAgreement, tuple[Finding, ...]]:
    """How far the rows of this very pair agree, and what is to be told of it."""
    try:
        found = find_tie_points(pair, params)
    except EstimationError as error:
        return RowAgreement(), (not_checked(str(error)),)
    rows = RowAgreement.measured(rectification, found)
    return rows, rows.findings(params) + torn(rectification, found)


def together(pair: EnhancedPair, rig: Rectification, rows: tuple[Finding, ...]) -> tuple[Finding, ...]:
    """All findings, of each code the last; that the rig could not be checked is settled by a check of the pair."""
    of_rig = tuple(finding for finding in rig.quality.warnings if finding.code != Code.RECTIFY_NOT_CHECKED)
    return tuple({finding.code: finding for finding in (*pair.findings, *of_rig, *rows)}.values())


def describe(products: Products) -> dict[str, Any]:
    """The numbers of a frame's row; None where there is none."""
    disparity, depth = products.disparity, products.depth
    valid = depth.depth[np.isfinite(depth.depth)]
    quantiles = np.percentile(valid, QUANTILES) if valid.size else [None] * len(QUANTILES)
    alarms = [str(finding) for finding in products.findings if finding.severity >= Severity.UNRELIABLE]
    return {
        "status": UNRELIABLE if alarms else OK,
        "reason": "; ".join(alarms),
        "density": disparity.density,
        "row_error_median_px": _finite(products.rows.median_px),
        "row_error_p95_px": _finite(products.rows.p95_px),
        **{f"depth_p{q:02d}": _finite(value) for q, value in zip(QUANTILES, quantiles, strict=True)},
        "depth_density": float(valid.size / depth.depth.size),
        "scale": "metric" if depth.geometry.metric else "unknown",
        "min_disparity": disparity.min_disparity,
        "max_disparity": disparity.max_disparity,
        "method": disparity.method,
        "energy": _finite(disparity.energy),
        "rectification": products.rectified.quality.method,
        "findings": [finding.as_dict() for finding in severe(products.findings)],
    }


def _finite(value: float | None) -> float | None:
    return float(value) if value is not None and np.isfinite(value) else None
