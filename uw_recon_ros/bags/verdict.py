"""Whether what a bag holds can be reconstructed, and why not, in sentences."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from uw_recon_ros.bags.findings import BagInfo, CalibrationState
from uw_recon_ros.bags.stereo import CameraInfoCache
from uw_recon_ros.types import CameraModel

_FEW = 0.9  # share of images that should have partners
_NAN = float("nan")


def judge_calibration(
    infos: tuple[CameraInfoCache, CameraInfoCache], size: tuple[int, int]
) -> tuple[CalibrationState, float, str]:
    """State, baseline in m, and what is wrong.

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
        return "none", _NAN, f"no CameraInfo of the {missing} eye"
    for name, cache in (("left", left), ("right", right)):
        if cache.problem is not None:
            zero = "not calibrated" in str(cache.problem)
            return "zero" if zero else "inconsistent", _NAN, f"{name} CameraInfo: {cache.problem}"
    if left.camera is None or right.camera is None:
        return "none", _NAN, "no CameraInfo that can be read"
    return _judge_cameras(left.camera, right.camera, size)


def _judge_cameras(left: CameraModel, right: CameraModel, size: tuple[int, int]) -> tuple[CalibrationState, float, str]:
    for name, camera in (("left", left), ("right", right)):
        if (camera.width, camera.height) != size and size[0]:
            told = f"{name} CameraInfo is for {camera.width}x{camera.height} px"
            return "inconsistent", _NAN, f"{told}, the images have {size[0]}x{size[1]}"
    if not np.allclose(left.p[:2, :2], right.p[:2, :2], rtol=1e-3):
        focals = left.p[0, 0], right.p[0, 0]
        return "inconsistent", _NAN, f"P: expected one focal length, left {focals[0]:.1f} and right {focals[1]:.1f} px"
    if np.any(left.p[:2, 3]):
        return (
            "inconsistent",
            _NAN,
            "P: the left eye has the baseline: expected P[3] = P[7] = 0 there (exchanged eyes?)",
        )
    shift = -right.p[:2, 3] / (right.p[0, 0], right.p[1, 1])
    baseline = float(shift[np.argmax(np.abs(shift))])
    if baseline == 0:
        return "consistent", _NAN, "P[3] = P[7] = 0: no baseline, so no scale"
    if abs(shift[0]) > abs(shift[1]) and baseline < 0:
        return "inconsistent", _NAN, f"P[3]: the right eye lies {-baseline:.3f} m to the left of the left one"
    return "metric", baseline, ""


def judge(info: BagInfo, calibration_problem: str, changes: int) -> BagInfo:
    """Add the reasons and warnings.

    Parameters
    ----------
    info : BagInfo
        Without them.
    calibration_problem : str
        As `judge_calibration` told.
    changes : int
        How often a CameraInfo changed.
    """
    warnings = list(_warnings(info, calibration_problem))
    if changes > 0:
        warnings.append(f"CameraInfo changes {changes} times")
    return dataclasses.replace(info, reasons=tuple(_reasons(info, calibration_problem)), warnings=tuple(warnings))


def _reasons(info: BagInfo, calibration_problem: str) -> Iterator[str]:
    left, right = info.left, info.right
    if left is None or right is None:
        return
    for eye in (left, right):
        if not eye.stamps_ns:
            yield f"{eye.topic} holds no readable image"
        elif eye.problem:
            yield f"{eye.topic}: images cannot be decoded: {eye.problem}"
    if not left.stamps_ns or not right.stamps_ns:
        return
    if not (left.problem or right.problem) and (left.width, left.height) != (right.width, right.height):
        yield f"the eyes differ in size: {left.width}x{left.height} and {right.width}x{right.height} px"
    if not info.pairs:
        off = f"the nearest differ by {1e3 * info.stamp_offset_s:.1f} ms (median)"
        yield f"no left and right image have one stamp: {off}; allow a tolerance if they belong together"
    if info.calibration == "inconsistent":
        yield f"the calibration contradicts itself or the images: {calibration_problem}"


def _warnings(info: BagInfo, calibration_problem: str) -> Iterator[str]:
    for eye in (info.left, info.right):
        if eye is None or not eye.stamps_ns:
            continue
        if 0 < info.pairs < _FEW * len(eye.stamps_ns):
            yield f"{eye.topic}: {len(eye.stamps_ns) - info.pairs} of {len(eye.stamps_ns)} images have no partner"
        if eye.backwards:
            yield f"{eye.topic}: time goes backwards {eye.backwards} times"
        if not any(eye.stamps_ns):
            yield f"{eye.topic}: all stamps are zero"
        if eye.odd:
            yield f"{eye.topic}: {eye.odd} images differ from the first in size or encoding, or are incomplete"
    if info.gaps:
        yield f"{info.gaps} gaps in the pairs, the longest {info.largest_gap_s:.2f} s"
    if info.calibration in ("none", "zero", "consistent") and info.left is not None:
        yield f"the scale is unknown: {calibration_problem}"
    if abs(info.baseline_m) > 5:
        yield f"a baseline of {info.baseline_m:g} m: is the calibration in millimetres?"
    if info.damage:
        yield f"damaged: {len(info.damage)} places could not be read"
