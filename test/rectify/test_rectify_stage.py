from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers.rig_scenes import calibration_of, enhanced, make_rig, render, tie_points

from uw_recon_ros.errors import ImageError
from uw_recon_ros.rectify import (
    Rectify,
    RectifyParams,
    RigTracker,
    estimate_rectification,
    rectification_from_calibration,
)
from uw_recon_ros.rectify.tie_points import find_tie_points
from uw_recon_ros.unseen_pixels import mark_unseen, unseen

RIG = make_rig(angles_deg=(1.0, -1.5, 2.0))
PARAMS = RectifyParams()


@pytest.fixture(scope="module")
def pair():
    return enhanced(*render(RIG))


@pytest.fixture(scope="module")
def rectified(pair):
    return Rectify(PARAMS)(pair, RigTracker(PARAMS).update(pair))


def test_features_of_the_rectified_images_share_rows(rectified):
    """Found anew in the warped images: neither the fit nor its tie points have a say."""
    found = find_tie_points(enhanced(rectified.left, rectified.right), PARAMS)
    assert np.median(np.abs(found.left[:, 1] - found.right[:, 1])) < 0.15
    assert (found.left[:, 0] - found.right[:, 0] + rectified.geometry.offset_px > 0).all()


def test_what_is_handed_on(pair, rectified):
    assert (rectified.stamp_ns, rectified.frame_id) == (pair.stamp_ns, pair.frame_id)
    assert rectified.left.shape == rectified.right.shape
    assert rectified.left_matching.shape == rectified.right_matching.shape == rectified.left.shape[:2]
    assert rectified.left.dtype == rectified.left_matching.dtype == np.uint8
    np.testing.assert_array_equal(rectified.left[..., 1].clip(1), rectified.left_matching)  # 0 means: nothing seen
    assert rectified.valid_left is None


def test_pure(pair):
    found = estimate_rectification(tie_points(RIG), PARAMS)
    before = pair.left.copy()
    first, second = (Rectify(PARAMS)(pair, found) for _ in range(2))
    np.testing.assert_array_equal(first.left, second.left)
    np.testing.assert_array_equal(pair.left, before)


def test_calibrated_images_are_opencvs(pair):
    calibration = calibration_of(RIG)
    found = rectification_from_calibration(calibration, RectifyParams(rectify_crop=False))
    ours = Rectify(RectifyParams(rectify_interpolation="linear"))(pair, found)
    for camera, image, raw in ((calibration.left, ours.left, pair.left), (calibration.right, ours.right, pair.right)):
        maps = cv2.initUndistortRectifyMap(camera.k, camera.d, camera.r, camera.p, (640, 480), cv2.CV_32FC1)
        oracle = cv2.remap(raw, *maps, cv2.INTER_LINEAR)
        difference = np.abs(image[8:-8, 8:-8].astype(int) - oracle[8:-8, 8:-8])
        assert np.quantile(difference, 0.999) <= 2


def test_uncropped_images_keep_their_size_and_are_black_outside(pair):
    params = RectifyParams(rectify_crop=False)
    out = Rectify(params)(pair, estimate_rectification(tie_points(RIG), params))
    assert out.left.shape == pair.left.shape
    assert out.valid_left.width < 640
    assert (out.left[0, 0] == 0).all() or (out.left[-1, -1] == 0).all()
    assert (out.left_matching[out.valid_left.slices] > 0).mean() > 0.98


def test_given_images_are_not_touched():
    rig = make_rig(center=(0.15, 0, 0))
    pair = enhanced(*render(rig))
    out = Rectify(PARAMS)(pair, RigTracker(PARAMS).update(pair))
    assert out.quality.method == "given"
    assert out.left is pair.left
    assert out.right_matching is pair.right_matching


def test_another_size_is_refused(pair):
    found = estimate_rectification(tie_points(RIG), PARAMS)
    wrong = replace(pair, right_matching=pair.right_matching[:100])
    with pytest.raises(ImageError, match="right_matching image: expected 640x480 px as rectified before, got 640x100"):
        Rectify(PARAMS)(wrong, found)


def test_what_the_raw_images_do_not_show_stays_unseen(pair, rectified):
    """Each rectified pixel that is interpolated from a masked one is masked, and little else."""
    mask = np.zeros(pair.left.shape[:2], bool)
    mask[200:, 100:300] = True
    pair = replace(pair, left_matching=pair.left_matching.clip(1))
    masked = replace(pair, left_matching=mark_unseen(pair.left_matching, mask))
    found = estimate_rectification(tie_points(RIG), PARAMS)
    out = Rectify(PARAMS)(masked, found)
    hidden = unseen(out.left_matching)
    at = np.round(found.left_map).astype(int)
    shown = cv2.remap(mask.astype(np.float32), found.left_map[..., 0], found.left_map[..., 1], cv2.INTER_LINEAR)
    assert hidden[shown > 0].all()
    assert (
        mask[at[..., 1].clip(0, mask.shape[0] - 1), at[..., 0].clip(0, mask.shape[1] - 1)].mean() > 0.8 * hidden.mean()
    )
    assert not out.left[hidden].any()
    np.testing.assert_array_equal(out.left_matching[~hidden], Rectify(PARAMS)(pair, found).left_matching[~hidden])
    assert not unseen(out.right_matching).any()
