"""Whether what a recording holds can be reconstructed, and why not, in sentences."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

from uw_recon_ros.bags.stereo import CameraInfoCache
from uw_recon_ros.calibration import judge as judge_numbers
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.recordings.contents import CalibrationState, RecordingInfo
from uw_recon_ros.types import StereoCalibration

_FEW = 0.9  # share of images that should have partners
_NAN = float("nan")


def judge_infos(
    infos: tuple[CameraInfoCache, CameraInfoCache], size: tuple[int, int]
) -> tuple[CalibrationState, float, tuple[Finding, ...]]:
    """State, baseline in m, and what is wrong with what CameraInfo messages say.

    Parameters
    ----------
    infos : pair of CameraInfoCache
        After all CameraInfo messages.
    size : (width, height)
        Of the left images, px.
    """
    left, right = infos
    if not (left.seen and right.seen):
        missing = " and ".join(n for n, cache in (("left", left), ("right", right)) if not cache.seen)
        return "none", _NAN, (_none(f"no CameraInfo of the {missing} camera"),)
    for name, cache in (("left", left), ("right", right)):
        if cache.problem is not None:
            zero = cache.problem.code == Code.CALIBRATION_NOT_CALIBRATED
            found = Finding(cache.problem.code, f"{name} CameraInfo: {cache.problem}", Severity.REFUSED)
            return "zero" if zero else "inconsistent", _NAN, (found,)
    if left.camera is None or right.camera is None:
        return "none", _NAN, (_none("no CameraInfo that can be read"),)
    return judge_rig(StereoCalibration(left.camera, right.camera), size)


def _none(text: str) -> Finding:
    return Finding(Code.CALIBRATION_NONE, text, Severity.WARN)


def judge_rig(rig: StereoCalibration, size: tuple[int, int]) -> tuple[CalibrationState, float, tuple[Finding, ...]]:
    """State, baseline in m, and what is wrong with a rig whose images are of a size, px."""
    judgement = judge_numbers.judge_calibration(rig, size if size[0] else None)
    if judgement.refusal is not None:
        return "inconsistent", _NAN, (judgement.refusal,)
    state: CalibrationState = "consistent" if math.isnan(judgement.baseline_m) else "metric"
    return state, judgement.baseline_m, judgement.findings


def judge(info: RecordingInfo, changes: int) -> RecordingInfo:
    """Add the reasons and warnings.

    Parameters
    ----------
    info : RecordingInfo
        Without them, with the calibration's findings.
    changes : int
        How often a CameraInfo changed.
    """
    calibration_problem = "; ".join(map(str, info.calibration_findings))
    warnings = list(_warnings(info, calibration_problem))
    if changes > 0:
        warnings.append(f"CameraInfo changes {changes} times")
    return dataclasses.replace(info, reasons=tuple(_reasons(info, calibration_problem)), warnings=tuple(warnings))


def _reasons(info: RecordingInfo, calibration_problem: str) -> Iterator[str]:
    left, right = info.left, info.right
    if left is None or right is None:
        return
    for side in (left, right):
        if not side.stamps_ns:
            yield f"{side.topic} holds no readable image"
        elif side.problem:
            yield f"{side.topic}: images cannot be decoded: {side.problem}"
    if not left.stamps_ns or not right.stamps_ns:
        return
    if not (left.problem or right.problem) and (left.width, left.height) != (right.width, right.height):
        yield f"the cameras differ in size: {left.width}x{left.height} and {right.width}x{right.height} px"
    if left.kind and right.kind and left.kind.split(", ")[1] != right.kind.split(", ")[1]:
        yield f"the cameras differ in depth: left {left.kind}, right {right.kind}"
    if not info.pairs:
        off = f"the nearest differ by {1e3 * info.stamp_offset_s:.1f} ms (median)"
        yield (
            f"no left and right image have one stamp: {off}: where a jitter is all, --pair-tolerance-ms; where the "
            "clocks differ by a constant, survey --clock-offset SECONDS (no tolerance mends that)"
        )
    if info.calibration == "inconsistent":
        yield f"the calibration contradicts itself or the images: {calibration_problem}"


def _warnings(info: RecordingInfo, calibration_problem: str) -> Iterator[str]:
    for side in (info.left, info.right):
        if side is None or not side.stamps_ns:
            continue
        if 0 < info.pairs < _FEW * len(side.stamps_ns):
            yield f"{side.topic}: {len(side.stamps_ns) - info.pairs} of {len(side.stamps_ns)} images have no partner"
        if side.backwards:
            yield f"{side.topic}: time goes backwards {side.backwards} times"
        if not any(side.stamps_ns):
            yield f"{side.topic}: all stamps are zero"
        if side.before_key and not side.problem:
            yield f"{side.topic}: {side.before_key} packets come before the first key frame: they have no image"
        if side.odd:
            yield f"{side.topic}: {side.odd} images differ from the first in size or encoding, or are incomplete"
    if info.left and info.right and info.left.kind and info.right.kind and info.left.kind != info.right.kind:
        yield f"left is {info.left.kind}, right is {info.right.kind}: both are taken as gray where the bits agree"
    if info.gaps:
        yield f"{info.gaps} gaps in the pairs, the longest {info.largest_gap_s:.2f} s"
    if info.calibration in ("none", "zero", "consistent") and info.left is not None:
        yield f"the scale is unknown: {calibration_problem}"
    if info.calibration == "metric" and calibration_problem:
        yield f"the calibration is doubtful: {calibration_problem}"
    if info.damage and info.kind == "stills":
        yield f"{len(info.damage)} files cannot be read: their pairs are left out"
    elif info.damage:
        yield f"damaged: {len(info.damage)} places could not be read"
