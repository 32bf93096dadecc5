"""The camera_infos: are they there, do they describe a stereo rig, and this one."""

from __future__ import annotations

from uw_recon_ros.calibration import as_imaged, make_camera
from uw_recon_ros.calibration.judge import has_baseline, judge_calibration
from uw_recon_ros.calibration.rectified import as_rectified, rectified_by_name
from uw_recon_ros.doctor.cameras import image_topic
from uw_recon_ros.doctor.check import Check, Level, fail, ok
from uw_recon_ros.doctor.observation import CameraNumbers, Observation, ObservedTopic
from uw_recon_ros.doctor.suggestions import same_elsewhere, says_side
from uw_recon_ros.doctor.topic_graph import METRIC_CLOUD, TYPES, UNSCALED_CLOUD
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.topics import SIDES
from uw_recon_ros.types import CameraModel, StereoCalibration

_STAGE = "calibration"
_CALIBRATE = "calibrate the rig in water (camera_calibration), or set baseline_m and focal_px"


def scale_is_unknown(seen: Observation) -> bool:
    """Whether clouds come, but without metres."""
    topics = {
        name: seen.topics.get(name, ObservedTopic(name)).arrivals.count for name in (METRIC_CLOUD, UNSCALED_CLOUD)
    }
    return topics[UNSCALED_CLOUD] > 0 and not topics[METRIC_CLOUD]


def _no_scale(seen: Observation, text: str, advice: str = _CALIBRATE) -> Check:
    """No calibration: the reason for a missing metric cloud where unscaled ones come, worth a line elsewhere."""
    if scale_is_unknown(seen):
        return fail(_STAGE, f"{text}: the scale is unknown", advice)
    came = seen.topics.get(METRIC_CLOUD, ObservedTopic(METRIC_CLOUD)).arrivals.count
    return Check(Level.OK if came else Level.WARN, _STAGE, text, "" if came else advice)


def _camera(seen: Observation, side: str, info: CameraNumbers) -> CameraModel:
    try:
        camera = make_camera(
            width=info.width, height=info.height, k=info.k, d=info.d, r=info.r, p=info.p,
            distortion_model=info.distortion_model,
        )  # fmt: skip
        camera = as_imaged(camera, info.binning, info.roi)
        told = str(seen.parameter("images_rectified", "auto"))
        return as_rectified(camera) if rectified_by_name(told, image_topic(seen, side).name) else camera
    except CalibrationError as error:
        raise CalibrationError(f"{side} {error}", error.code) from error


def _numbers(seen: Observation) -> Check:
    """Both infos came: what do they say."""
    left, right = seen.infos["left"], seen.infos["right"]
    zero = [seen.topics[f"{side}/camera_info"].name for side in SIDES if not any(seen.infos[side].k)]
    if zero:
        return _no_scale(seen, f"{' and '.join(zero)}: K is zero (not calibrated)")
    size = image_topic(seen, "left").arrivals
    try:
        calibration = StereoCalibration(_camera(seen, "left", left), _camera(seen, "right", right))
        if not has_baseline(calibration):
            return _no_scale(
                seen,
                "right P has no baseline (P[3] = P[7] = 0): two single calibrations, not a stereo one",
                "calibrate both cameras together (camera_calibration with two cameras), so that P[3] = -fx B",
            )
        judgement = judge_calibration(calibration, (size.width, size.height) if size.width else None)
        judgement.raise_refused()
    except CalibrationError as error:
        advice = "calibrate anew, or mend the camera_info files"
        return Check(Level.FAIL, _STAGE, f"inconsistent calibration: {error}", advice, code=error.code.value)
    if judgement.findings:
        first = judgement.findings[0]
        return Check(Level.WARN, _STAGE, f"doubtful calibration: {first.text}", first.advice, code=first.code.value)
    return ok(
        _STAGE,
        f"{judgement.axis} rig, baseline {abs(judgement.baseline_m):.3f} m, "
        f"{calibration.left.width}x{calibration.left.height}",
    )


def _missing(seen: Observation, sides: list[str]) -> Check:
    names = [f"{side}/camera_info" for side in sides]
    resolved = " and ".join(seen.topics.get(name, ObservedTopic(name)).name for name in names)
    kind = {TYPES[names[0]]}
    meant = same_elsewhere(names[0], kind, seen.others) or sorted(
        topic.name for topic in seen.others if topic.types & kind and says_side(topic.name, sides[0])
    )
    if meant:
        return _no_scale(
            seen, f"{resolved}: no publisher; likely meant: {meant[0]}", f"start with -r {names[0]}:={meant[0]}"
        )
    return _no_scale(seen, f"{resolved}: no publisher")


def check_calibration(seen: Observation) -> list[Check]:
    """Look at both cameras' camera_infos."""
    if seen.parameter("calibration_use", "auto") == "ignore":
        return [_no_scale(seen, "calibration_use is ignore", "set calibration_use to auto")]
    topics = {side: seen.topics.get(f"{side}/camera_info", ObservedTopic(f"{side}/camera_info")) for side in SIDES}
    silent = [topics[side].name for side in SIDES if topics[side].publishers and side not in seen.infos]
    if silent:
        text = f"{' and '.join(silent)}: a publisher, but no message: rectification waits for it"
        return [fail(_STAGE, text, "publish it with every image, or stop publishing it")]
    missing = [side for side in SIDES if not topics[side].publishers]
    return [_missing(seen, missing) if missing else _numbers(seen)]
