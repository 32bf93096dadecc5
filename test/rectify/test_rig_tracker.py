"""A rig over its frames: gathering, locking, watching, moving; and with calibrations."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, enhanced, make_rig, render

from uw_recon_ros.errors import CalibrationError, EstimationError, ImageError
from uw_recon_ros.rectify import RectifyParams, RigTracker
from uw_recon_ros.rectify.tie_points import find_tie_points
from uw_recon_ros.types import StereoCalibration

SMALL = {"width": 320, "height": 240, "focal": 310.0}
RIG = make_rig(angles_deg=(1.0, -1.5, 2.0), **SMALL)
MOVED = make_rig(angles_deg=(2.5, -1.5, 2.0), **SMALL)
PARAMS = RectifyParams(tie_features=1000, lock_frames=3, lock_points=300, watch_interval=2, drift_patience=2)


@pytest.fixture(scope="module")
def frames():
    return [enhanced(*render(RIG, seed=seed)) for seed in range(4)]


@pytest.fixture(scope="module")
def moved_frames():
    return [enhanced(*render(MOVED, seed=seed)) for seed in range(3)]


@pytest.fixture(scope="module")
def dark():
    return enhanced(np.zeros((240, 320, 3), np.uint8), np.zeros((240, 320, 3), np.uint8))


def locked_tracker(frames):
    tracker = RigTracker(PARAMS)
    found = [tracker.update(frame) for frame in frames[:3]]
    return tracker, found


def test_gathers_then_locks(frames):
    tracker, found = locked_tracker(frames)
    assert [f.locked for f in found] == [False, False, True]
    assert found[0].quality.inliers < found[2].quality.inliers
    kept = tracker.update(frames[3])
    assert kept.geometry == found[2].geometry
    assert kept.left_map is found[2].left_map


def test_same_frames_same_rectifications(frames):
    first, second = (locked_tracker(frames)[1][-1] for _ in range(2))
    assert first.geometry == second.geometry
    assert first.quality == second.quality


def test_watches_the_row_error(frames):
    tracker, found = locked_tracker(frames)
    for frame in frames:
        last = tracker.update(frame)
    assert last.geometry == found[2].geometry
    assert last.quality.inliers != found[2].quality.inliers
    assert last.quality.row_error_median_px < 0.5


def test_a_moved_rig_is_estimated_anew(frames, moved_frames):
    tracker, found = locked_tracker(frames)
    after = [tracker.update(moved_frames[i % 3]) for i in range(6)]
    assert after[0].geometry == found[2].geometry  # one odd frame proves nothing
    assert after[-1].geometry != found[2].geometry
    assert after[-1].quality.row_error_median_px < 0.5
    assert after[-1].locked


def test_a_suspicion_is_followed_up_at_once(frames, moved_frames):
    """Locked at frame 3, watched at 7; two frames in a row must show the drift: anew at 8, not at 11."""
    tracker = RigTracker(replace(PARAMS, watch_interval=4))
    for frame in frames[:3]:
        locked = tracker.update(frame)
    geometries = [tracker.update(moved_frames[0]).geometry for _ in range(5)]
    assert [g == locked.geometry for g in geometries] == [True, True, True, True, False]


def test_a_rig_that_moves_before_it_is_locked(frames, moved_frames):
    tracker = RigTracker(PARAMS)
    first = tracker.update(frames[0])
    for _ in range(PARAMS.drift_patience):
        assert tracker.update(moved_frames[0]) is first
    with pytest.raises(EstimationError, match=r"vertical \(epipolar\) error"):
        tracker.update(moved_frames[0])
    assert tracker.update(moved_frames[0]).quality.row_error_median_px < 0.5


def test_frames_without_texture_do_not_unsettle(frames, dark):
    tracker, found = locked_tracker(frames)
    for _ in range(6):
        assert tracker.update(dark).geometry == found[2].geometry
    young = RigTracker(PARAMS)
    first = young.update(frames[0])
    for _ in range(4):
        assert young.update(dark) is first


def test_nothing_to_start_from_raises(dark, frames):
    tracker = RigTracker(PARAMS)
    with pytest.raises(EstimationError, match="too little texture"):
        tracker.update(dark)
    assert tracker.update(frames[0]).quality.method == "quasi-euclidean"


def test_a_flat_scene_does_not_lock():
    tracker = RigTracker(PARAMS)
    found = [tracker.update(enhanced(*render(RIG, count=0, seed=seed))) for seed in range(4)]
    assert all(f.flat and not f.locked for f in found)


def test_exchanged_cameras_raise_every_time(frames):
    tracker = RigTracker(PARAMS)
    swapped = enhanced(frames[0].right, frames[0].left)
    for _ in range(2):
        with pytest.raises(EstimationError, match="left and right images are swapped"):
            tracker.update(swapped)


def with_calibration(frame, calibration):
    return replace(frame, calibration=calibration)


def test_calibrated_rigs_use_their_calibration_and_measure_it(frames):
    tracker = RigTracker(PARAMS)
    found = [tracker.update(with_calibration(frame, calibration_of(RIG))) for frame in frames]
    assert all(f.locked and f.geometry.metric and f.quality.method == "calibrated" for f in found)
    assert found[0].left_map is found[-1].left_map
    assert found[0].quality.row_error_median_px < 0.3
    assert found[2].quality.inliers > found[0].quality.inliers


def test_a_new_calibration_is_noticed(frames):
    tracker = RigTracker(PARAMS)
    first = tracker.update(with_calibration(frames[0], calibration_of(RIG)))
    second = tracker.update(with_calibration(frames[0], calibration_of(MOVED)))
    assert first.geometry != second.geometry
    assert second.quality.warnings != ()


def test_a_calibration_holds_without_texture(dark):
    found = RigTracker(PARAMS).update(with_calibration(dark, calibration_of(RIG)))
    assert found.quality.method == "calibrated"
    assert np.isnan(found.quality.row_error_median_px)


def test_calibrated_exchanged_cameras_raise_every_time(frames):
    tracker = RigTracker(PARAMS)
    swapped = with_calibration(enhanced(frames[0].right, frames[0].left), calibration_of(RIG))
    for _ in range(3):
        with pytest.raises(EstimationError, match="left and right images are swapped"):
            tracker.update(swapped)


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("deferred", [True, False])
def test_cameras_exchanged_midway_are_refused_until_they_are_right_again(frames, calibrated, deferred):
    """Once watching has noticed, no frame passes unseen: neither while they are exchanged nor when they are not."""
    tracker = RigTracker(PARAMS)

    def see(frame):
        """What a node does: the frame is used before it is watched."""
        frame = with_calibration(frame, calibration_of(RIG)) if calibrated else frame
        found = tracker.update(frame, watch=not deferred)
        with suppress(EstimationError):
            tracker.watch(frame)
        return found

    def is_refused(frame):
        try:
            see(enhanced(frame.right, frame.left))
        except EstimationError as error:
            return "left and right images are swapped" in str(error)
        return False

    for frame in frames:
        see(frame)
    refused = [is_refused(frame) for frame in frames * 3]
    noticed = refused.index(True)
    assert noticed <= PARAMS.watch_interval + PARAMS.drift_patience
    assert all(refused[noticed:])
    again = see(frames[0])
    assert np.median(again.parallax(find_tie_points(frames[0], PARAMS))) > 0


@pytest.mark.parametrize("calibrated", [True, False])
def test_a_rig_is_looked_at_every_five_seconds_however_few_its_frames(frames, calibrated):
    """At one pair a second, with a look every 50th, a swap is seen within five frames."""
    tracker = RigTracker(replace(PARAMS, watch_interval=50))
    calibration = calibration_of(RIG) if calibrated else None
    for second in range(4):
        tracker.update(replace(frames[second], calibration=calibration, stamp_ns=second * 1_000_000_000))
    swapped = replace(frames[0], left=frames[0].right, right=frames[0].left, calibration=calibration)
    swapped = replace(swapped, left_matching=frames[0].right_matching, right_matching=frames[0].left_matching)

    def is_refused(second):
        try:
            tracker.update(replace(swapped, stamp_ns=second * 1_000_000_000))
        except EstimationError as error:
            return "left and right images are swapped" in str(error)
        return False

    assert any(is_refused(second) for second in range(4, 4 + 5 + PARAMS.drift_patience))


def test_a_doubt_about_metres_is_followed_up_at_once(frames, moved_frames):
    """A knocked rig loses its metres three looks after the first, frame by frame."""
    tracker = RigTracker(replace(PARAMS, watch_interval=10))
    for number in range(5 * 10):
        tracker.update(with_calibration(frames[number % 4], calibration_of(RIG)))
    metric = [
        tracker.update(with_calibration(moved_frames[number % 3], calibration_of(RIG))).geometry.metric
        for number in range(10 + 3)
    ]
    assert metric[0]
    assert not metric[-1]


def test_calibration_ignored_or_required(frames):
    calibrated = with_calibration(frames[0], calibration_of(RIG))
    ignored = RigTracker(replace(PARAMS, calibration_use="ignore")).update(calibrated)
    assert ignored.quality.method == "quasi-euclidean"
    with pytest.raises(CalibrationError, match=r"expected one \(calibration_use = require\), got none"):
        RigTracker(replace(PARAMS, calibration_use="require")).update(frames[0])


def test_two_single_cameras_are_rectified_from_their_images(frames):
    calibration = calibration_of(RIG)
    alone = replace(calibration.right, p=np.hstack([calibration.right.p[:, :3], np.zeros((3, 1))]))
    single = with_calibration(frames[0], StereoCalibration(calibration.left, alone))
    found = RigTracker(PARAMS).update(single)
    assert found.quality.method == "quasi-euclidean"
    assert "two single cameras" in found.quality.warnings[0].text
    with pytest.raises(CalibrationError, match="two single cameras"):
        RigTracker(replace(PARAMS, calibration_use="require")).update(single)


def test_sizes_must_agree(frames):
    with pytest.raises(ImageError, match="right image: expected 320x240 px as the left one, got 320x200"):
        RigTracker(PARAMS).update(enhanced(frames[0].left, frames[0].right[:200]))
    other = calibration_of(make_rig())
    with pytest.raises(CalibrationError, match="expected 320x240 px as the images, got 640x480"):
        RigTracker(PARAMS).update(with_calibration(frames[0], other))


def test_another_image_size_starts_anew(frames):
    tracker, _ = locked_tracker(frames)
    left, right = (np.ascontiguousarray(image[20:220]) for image in (frames[0].left, frames[0].right))
    found = tracker.update(enhanced(left, right))
    assert (found.raw_width, found.raw_height) == (320, 200)
    assert not found.locked


@pytest.mark.parametrize("calibrated", [False, True])
def test_watching_afterwards_decides_the_same(frames, moved_frames, calibrated):
    """Put off until the frame is on its way, looking changes what the next frame gets, and nothing else."""
    seen = [*frames, *frames, *(moved_frames * 2)]
    seen = [with_calibration(frame, calibration_of(RIG)) for frame in seen] if calibrated else seen
    at_once, later = RigTracker(PARAMS), RigTracker(PARAMS)
    immediate = [at_once.update(frame) for frame in seen]
    deferred = []
    for frame in seen:
        deferred.append(later.update(frame, watch=False))
        later.watch(frame)
    differ = [i for i, (now, then) in enumerate(zip(immediate, deferred, strict=True)) if now.geometry != then.geometry]
    assert len(differ) == 1  # the frame that gave the rig's motion away
    assert immediate[-1].geometry == deferred[-1].geometry


def test_a_known_rig_is_not_looked_at_before_its_frame_is_on_its_way(frames):
    tracker = RigTracker(PARAMS)
    frames = [with_calibration(frame, calibration_of(RIG)) for frame in frames]
    first = tracker.update(frames[0], watch=False)
    assert first.quality.inliers > 0  # an unknown one is
    later = [tracker.update(frame, watch=False) for frame in frames[1:]]
    assert all(found.quality == first.quality for found in later)
    tracker.watch(frames[-1])
    assert tracker.update(frames[-1], watch=False).quality.inliers > first.quality.inliers
