"""Whether the rows of a calibrated pair agree: held against the image's size and the tie points' own noise.

An error of the calibration, or of time between the images, bends all rows in one smooth way; the noise of tie points
does not. So a smooth surface is fitted to the row errors, and what it leaves is the noise.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.rectify.camera_turn import CameraTurn, camera_turn
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification, row_statistics
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Matrix

_FEWEST, _FEWEST_CUBIC = 12, 50  # points that a surface of seven, and of eleven unknowns is fitted to
_ITERATIONS = 10
_SMALLEST_PX = 1e-3
_FINEST_PX = 0.2  # tie points are not placed better, however small the image


@dataclass(frozen=True)
class RowAgreement:
    """How far the rows of one rig, or one pair, disagree.

    Parameters
    ----------
    median_px, p95_px : float
        Of the magnitude of the row error; NaN where there are no tie points.
    noise_px : float
        Median magnitude of what no smooth error explains; NaN where there are too few tie points.
    points : int
        Tie points measured on.
    diagonal_px : float
        Of the images.
    turn : CameraTurn or None
        Of the right camera, where it explains the error of a calibrated rig.
    """

    median_px: float = math.nan
    p95_px: float = math.nan
    noise_px: float = math.nan
    points: int = 0
    diagonal_px: float = math.nan
    turn: CameraTurn | None = None

    @classmethod
    def measured(cls, rectification: Rectification, tie_points: TiePoints) -> RowAgreement:
        """Measure a rectification on tie points that it was not made from."""
        errors = rectification.row_errors(tie_points)
        median, p95 = row_statistics(errors)
        noise = row_noise(errors, *rectification.rectified(tie_points), size=tie_points.width)
        diagonal, turn = math.hypot(tie_points.width, tie_points.height), _turn(rectification, tie_points, median)
        return cls(median, p95, noise, len(tie_points), diagonal, turn)

    def limit_px(self, params: RectifyParams) -> float:
        """Median over which a pair is marked: of the image's size, of the noise, or 0.2 px: the largest."""
        noise = 0.0 if math.isnan(self.noise_px) else self.noise_px
        of_size = 1e-3 * params.row_unreliable_permille * self.diagonal_px
        return max(of_size, params.row_unreliable_noise * noise, _FINEST_PX)

    def withheld(self, params: RectifyParams) -> bool:
        """Whether metres of such a pair are not given out."""
        return self.unreliable(params) and self.median_px > self.withhold_px(params)

    def withhold_px(self, params: RectifyParams) -> float:
        """Median over which metres are withheld."""
        return 1e-3 * params.row_withhold_permille * self.diagonal_px

    def unreliable(self, params: RectifyParams) -> bool:
        """Whether the pair is to be marked."""
        return self.median_px > self.limit_px(params)

    def findings(self, params: RectifyParams) -> tuple[Finding, ...]:
        """What is to be told: nothing where the rows agree."""
        if math.isnan(self.median_px):
            return not_checked()
        if not self.unreliable(params):
            return ()
        return (self._disagreement(params), *([self._withholding(params)] if self.withheld(params) else []))

    def _disagreement(self, params: RectifyParams) -> Finding:
        text = (
            f"vertical (epipolar) error is {self.median_px:.2f} px (median of {self.points} tie "
            f"points), expected up to {self.limit_px(params):.2f} px (their noise is {self.noise_px:.2f} px)"
        )
        advice = (
            "check: both images taken at the same time? the resolution and crop of the calibration? the rig not moved "
            "since? calibrated in water?"
        )
        if self.turn is not None:
            text += f"; a right camera turned by {self.turn} leaves {self.turn.after_px:.2f} px"
            advice = (
                "the same in all pairs: a camera was knocked since the calibration (or the calibration is for another "
                "image size, crop or port): calibrate again; different from pair to pair: images of different moments"
            )
        return Finding(Code.RECTIFY_ROWS_DISAGREE, text, Severity.UNRELIABLE, advice)

    def _withholding(self, params: RectifyParams) -> Finding:
        text = (
            f"metres withheld: vertical (epipolar) error is {self.median_px:.2f} px, "
            f"over {self.withhold_px(params):.2f} px the "
            "calibration gives no scale"
        )
        return Finding(Code.RECTIFY_SCALE_WITHHELD, text, Severity.UNRELIABLE, "calibrate this rig, in water")


def _turn(rectification: Rectification, tie_points: TiePoints, median_px: float) -> CameraTurn | None:
    """The turn that explains the error; None where there is little, or where the water explains it."""
    quality = rectification.quality
    if quality.method != "calibrated" or quality.medium == "water" or not median_px > _FINEST_PX:
        return None
    found = camera_turn(rectification, tie_points)
    return found if found is not None and found.explains else None


def not_checked(why: str = "no tie points", code: Code | None = None) -> tuple[Finding, ...]:
    """What is told where rows could not be measured, by the code of what stood against it.

    Two images that are rich and share nothing give no metres: whatever is matched there is chance.
    """
    text = (
        f"vertical (epipolar) error not checked: {' '.join(why.split())}; whether the calibration fits these images is "
        "not known"
    )
    finding = Finding(Code.RECTIFY_NOT_CHECKED, text, Severity.WARN, "look at pairs with more texture")
    if code != Code.RECTIFY_NOTHING_IN_COMMON:
        return (finding,)
    told = "metres withheld: both images are rich in features and share hardly any: noise, or not the same scene"
    advice = "check that left and right show the same scene"
    return (finding, Finding(Code.RECTIFY_SCALE_WITHHELD, told, Severity.UNRELIABLE, advice))


def scale_withheld(findings: Iterable[Finding]) -> bool:
    """Whether any of the findings takes the metres away."""
    return any(finding.code == Code.RECTIFY_SCALE_WITHHELD for finding in findings)


def row_noise(errors: Matrix, left: Matrix, right: Matrix, size: int) -> float:
    """Median magnitude of the row errors about a smooth surface in image and disparity, fitted robustly, px."""
    known = np.isfinite(errors) & np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    if known.sum() < _FEWEST:
        return math.nan
    errors = errors[known]
    x, y = (left[known].T - left[known].mean(axis=0)[:, None]) / size
    parallax = (left[known] - right[known]) / size
    along = parallax[:, int(parallax[:, 1].std() > parallax[:, 0].std())]
    surface = np.column_stack([np.ones_like(x), x, y, x * y, x * x, y * y, along])
    if len(errors) >= _FEWEST_CUBIC:  # a lost lens distortion
        surface = np.column_stack([surface, x**3, x * x * y, x * y * y, y**3])
    residual = errors - np.median(errors)
    for _ in range(_ITERATIONS):
        root = 1 / np.sqrt(np.maximum(np.abs(residual), _SMALLEST_PX))  # so weighted, squares become magnitudes
        found, *_ = np.linalg.lstsq(surface * root[:, None], errors * root, rcond=None)
        residual = errors - surface @ found
    return float(np.median(np.abs(residual)))
