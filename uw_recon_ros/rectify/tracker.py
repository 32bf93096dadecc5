"""A rig is rigid: gather tie points over its frames, lock its geometry, keep watching, estimate anew when it moved."""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import Protocol

from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.calibration.rectified import rectified_by_name, rig_as_imaged
from uw_recon_ros.errors import CalibrationError, EstimationError, ImageError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.rectify.calibrated import judged, rectification_from_calibration, unjudged
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectification import Rectification, exchanged, row_statistics
from uw_recon_ros.rectify.seam import torn
from uw_recon_ros.rectify.stereo_info import has_baseline
from uw_recon_ros.rectify.tie_points import TiePoints, find_tie_points, gathered
from uw_recon_ros.rectify.uncalibrated import estimate_rectification
from uw_recon_ros.types import CameraModel, EnhancedPair, StereoCalibration

_SOON = 5  # frames until rows are looked at again where nothing was in common
_WATCHED_FRAMES = 5  # whose tie points together judge a calibrated rig
_LONGEST_NS = 5_000_000_000  # between two looks at a rig, however many frames: a slow graph is no reason to look less
_WATCHING = 4  # watching looks at images half as large, and at so many times fewer features, than estimating
_NO_BASELINE = Finding(
    Code.RECTIFY_NO_BASELINE,
    "CameraInfo describes two single cameras (P[3] = P[7] = 0): rectified without calibration",
)


def _sent_twice(calibration: StereoCalibration | None) -> tuple[Finding, ...]:
    """What explains a missing baseline: one camera's CameraInfo for both. The images do without it."""
    found = judge_calibration(calibration).findings if calibration else ()
    return tuple(replace(f, severity=Severity.WARN) for f in found if f.code == Code.CALIBRATION_IDENTICAL)


def _long_ago(watched_ns: int, pair: EnhancedPair) -> bool:
    """Whether a rig was looked at long before, or after, a pair was taken."""
    return abs(pair.stamp_ns - watched_ns) >= _LONGEST_NS


class _Rig(Protocol):
    """What a tracker knows of one rig."""

    def update(self, pair: EnhancedPair, watch: bool) -> Rectification: ...

    def watch(self, pair: EnhancedPair) -> None: ...


def _watched(pair: EnhancedPair, params: RectifyParams) -> TiePoints:
    fewer = replace(params, tie_features=max(params.tie_features // _WATCHING, 100))
    return find_tie_points(pair, fewer, longest_side=params.tie_image_side // 2)


class _CalibratedRig:
    """The calibration's rectification, its row error measured now and then."""

    def __init__(self, calibration: StereoCalibration, params: RectifyParams, image_size: tuple[int, int]) -> None:
        self._params = params
        given = rectification_from_calibration(calibration, params, image_size=image_size)
        self._given = replace(given, locked=True)
        self._rectification = self._given
        self._frames: deque[TiePoints] = deque(maxlen=_WATCHED_FRAMES)
        self._until_watch = 0
        self._watched_ns = 0

    def update(self, pair: EnhancedPair, watch: bool) -> Rectification:
        self._until_watch = 0 if _long_ago(self._watched_ns, pair) else self._until_watch - 1
        if watch or not self._frames:  # what nobody has seen to fit yet is looked at before it is used
            self.watch(pair)
        return self._rectification

    def watch(self, pair: EnhancedPair) -> None:
        if self._until_watch > 0:
            return
        self._watched_ns = pair.stamp_ns
        try:
            found = _watched(pair, self._params)
        except EstimationError as error:  # nothing to measure on: what was known before holds, if anything was
            self._until_watch = self._params.watch_interval
            if not self._frames:
                self._rectification = unjudged(self._given, str(error), error.code)
                if error.code == Code.RECTIFY_NOTHING_IN_COMMON:  # metres come back soon after the sea bed does
                    self._until_watch = min(self._until_watch, _SOON)
            return
        try:
            alone = judged(self._given, found, self._params)
        except EstimationError:  # swapped: until they are seen to be right again, every frame is looked at first
            self._frames.clear()
            raise
        self._frames.append(found)
        judgement = judged(self._given, gathered(self._frames), self._params)
        warnings = torn(judgement, found) + judgement.quality.warnings
        self._rectification = judgement.with_quality(replace(judgement.quality, warnings=warnings))
        doubt = alone.geometry.metric != judgement.geometry.metric  # the rig has changed, or one pair is bad: look on
        self._until_watch = 1 if doubt else self._params.watch_interval


class _UncalibratedRig:
    """An estimate that improves until it is locked, and starts again when the rig has moved."""

    def __init__(self, params: RectifyParams, warnings: tuple[Finding, ...]) -> None:
        self._params = params
        self._warnings = warnings
        self._frames: deque[TiePoints] = deque(maxlen=4 * params.lock_frames)
        self._rectification: Rectification | None = None
        self._until_look = 0
        self._watched_ns = 0
        self._strays = 0
        self._put_off = False

    def update(self, pair: EnhancedPair, watch: bool) -> Rectification:
        if self._rectification is not None and self._until_look > 0 and not _long_ago(self._watched_ns, pair):
            self._until_look -= 1
            return self._rectification
        self._watched_ns = pair.stamp_ns
        if self._rectification is None or not self._rectification.locked:
            return self._gather(pair)
        self._put_off = not watch
        return self._watch(pair, self._rectification) if watch else self._rectification

    def watch(self, pair: EnhancedPair) -> None:
        if self._put_off and self._rectification is not None:
            self._put_off = False
            self._watch(pair, self._rectification)

    def _gather(self, pair: EnhancedPair) -> Rectification:
        """Add a frame and estimate from all; a frame that gives nothing changes nothing."""
        kept = self._rectification
        try:
            found = find_tie_points(pair, self._params)
        except EstimationError:
            if kept is None:
                raise
            return kept
        try:
            estimate = estimate_rectification(gathered([*self._frames, found]), self._params)
        except EstimationError:
            self._strays += 1
            if kept is None or self._strays > self._params.drift_patience:
                self._forget()
                raise
            return kept
        return self._take(found, estimate)

    def _take(self, found: TiePoints, estimate: Rectification) -> Rectification:
        self._frames.append(found)
        self._strays = 0
        points = sum(len(frame) for frame in self._frames)
        enough = len(self._frames) >= self._params.lock_frames and points >= self._params.lock_points
        self._until_look = self._params.watch_interval - 1 if enough else 0
        quality = replace(estimate.quality, warnings=self._warnings + estimate.quality.warnings)
        self._rectification = replace(estimate, quality=quality, locked=enough and not estimate.flat)
        return self._rectification

    def _watch(self, pair: EnhancedPair, kept: Rectification) -> Rectification:
        """Measure the row error of a locked rig."""
        try:
            found = _watched(pair, self._params)
        except EstimationError:
            return kept
        median, p95 = row_statistics(kept.row_errors(found))
        quality = replace(kept.quality, row_error_median_px=median, row_error_p95_px=p95, inliers=len(found))
        self._rectification = kept.with_quality(quality)
        moved = median > self._params.drift_limit_px or exchanged(kept, found)
        self._strays = self._strays + 1 if moved else 0
        if self._strays >= self._params.drift_patience:
            self._forget()
            return self._gather(pair)
        self._until_look = 0 if self._strays else self._params.watch_interval - 1
        return self._rectification

    def _forget(self) -> None:
        self._frames.clear()
        self._rectification = None
        self._until_look = self._strays = 0


def _fingerprint(camera: CameraModel) -> tuple[object, ...]:
    arrays = (camera.k, camera.d, camera.r, camera.p)
    return (camera.width, camera.height, camera.distortion_model, *(array.tobytes() for array in arrays))


class RigTracker:
    """Knows, frame by frame, how to rectify a rig. Deterministic: the same frames give the same rectifications.

    Parameters
    ----------
    params : RectifyParams
    """

    def __init__(self, params: RectifyParams) -> None:
        self.params = params
        self._key: tuple[object, ...] = ()
        self._rig: _Rig | None = None

    def update(self, pair: EnhancedPair, *, watch: bool = True) -> Rectification:
        """Look at a frame and return the rectification that fits it.

        Parameters
        ----------
        pair : EnhancedPair
            The next frame of the rig.
        watch : bool
            Whether a known rig's row error is measured on it, where that is due; else `watch` does it afterwards, so
            that the frame need not wait.

        Returns
        -------
        Rectification
            The calibration's, where the pair has one that describes a rig; else the estimate so far.
            ``quality`` holds the row error last measured.

        Raises
        ------
        ImageError
            The images differ in size.
        CalibrationError
            A calibration is wrong, of another image size, or required and missing.
        EstimationError
            Nothing can be estimated yet, or left and right are swapped.
        """
        calibration = self._calibration(pair)
        cameras = (calibration.left, calibration.right) if calibration else ()
        key = (pair.left.shape[:2], pair.calibration is None, *map(_fingerprint, cameras))
        if self._rig is None or key != self._key:
            self._rig, self._key = self._start(pair, calibration), key
        return self._rig.update(pair, watch)

    def watch(self, pair: EnhancedPair) -> None:
        """Measure what `update` of the same frame left to be measured, if anything; for the frames to come.

        Raises
        ------
        EstimationError
            The cameras are swapped, or the rig has moved and its new geometry cannot be estimated from this frame.
        """
        if self._rig is not None:
            self._rig.watch(pair)

    def _calibration(self, pair: EnhancedPair) -> StereoCalibration | None:
        """The calibration to use, checked against the images."""
        height, width = pair.left.shape[:2]
        if pair.right.shape[:2] != (height, width):
            raise ImageError(
                f"right image: expected {width}x{height} px as the left one, got "
                f"{pair.right.shape[1]}x{pair.right.shape[0]}"
            )
        use, calibration = self.params.calibration_use, pair.calibration
        if use == "require" and calibration is None:
            raise CalibrationError("calibration: expected one (calibration_use = require), got none")
        if calibration is None or use == "ignore" or (use == "auto" and not has_baseline(calibration)):
            return None
        rectified = rectified_by_name(self.params.images_rectified)
        return rig_as_imaged(calibration, (rectified, rectified))

    def _start(self, pair: EnhancedPair, calibration: StereoCalibration | None) -> _Rig:
        if calibration is not None:
            return _CalibratedRig(calibration, self.params, (pair.left.shape[1], pair.left.shape[0]))
        ignored = pair.calibration is not None and self.params.calibration_use != "ignore"
        return _UncalibratedRig(self.params, (_NO_BASELINE, *_sent_twice(pair.calibration)) if ignored else ())
