"""The axis and baseline of a calibration, once `uw_recon_ros.calibration.judge` lets it through."""

from __future__ import annotations

from uw_recon_ros.calibration.judge import Judgement, has_baseline, judge_calibration
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import StereoCalibration

__all__ = ["has_baseline", "judged_rig"]


def judged_rig(calibration: StereoCalibration, image_size: tuple[int, int] | None = None) -> Judgement:
    """Judge a calibration that images, of `image_size` (width, height) px where that is known, are rectified by.

    Raises
    ------
    CalibrationError
        It is refused, or describes two single cameras; the text says why, the code tells programs.
    """
    judgement = judge_calibration(calibration, image_size)
    judgement.raise_refused()
    if not has_baseline(calibration):
        lost = next(finding for finding in judgement.findings if finding.code == Code.CALIBRATION_NO_BASELINE)
        raise CalibrationError(str(lost), lost.code)
    return judgement
