from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import cv2
import numpy as np
import pytest
from helpers.pictures import Image, colored_leaves, leaves, need_data, psnr, real_images, to_bytes, wave
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import ImageError
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import EnhancedPair, StereoPair

PLAIN = PreprocessParams(
    appearance="paper", moire_removal=False, homomorphic_filtering=False, wavelet_denoising=False,
    anisotropic_filtering=False,
    color_equalization=False, intensity_clip=0.0,
)  # fmt: skip


def images(pair: EnhancedPair) -> list[Image]:
    return [pair.left, pair.right, pair.left_matching, pair.right_matching]


def scene(height: int = 120, width: int = 160, shift: int = 8, peak: int = 255) -> StereoPair:
    """Two views of one flat picture, `shift` px apart."""
    wide = colored_leaves(height, width + shift)
    return StereoPair(to_bytes(wide[:, :width], peak), to_bytes(wide[:, shift:], peak), stamp_ns=12, frame_id="left")


@pytest.mark.parametrize("profile", ["paper", "matching", "none"])
@pytest.mark.parametrize("color", [True, False])
@pytest.mark.parametrize("peak", [255, 65535])
def test_what_comes_out(profile: str, color: bool, peak: int) -> None:
    pair = scene(peak=peak)
    if not color:
        pair = replace(pair, left=pair.left[..., 1], right=pair.right[..., 1])
    out = Preprocess(PreprocessParams(profile=profile))(pair)
    assert [x.shape for x in images(out)] == [(120, 160, 3)] * 2 + [(120, 160)] * 2
    assert {x.dtype for x in images(out)} == {np.dtype(np.uint8)}
    assert (out.stamp_ns, out.frame_id, out.calibration) == (12, "left", None)
    assert out.left.std() > 30


def test_means_of_the_colors_are_equal_over_both_cameras() -> None:
    pair = scene()
    assert np.ptp(pair.left.mean(axis=(0, 1))) > 50
    out = Preprocess(PreprocessParams(appearance="paper"))(pair)
    assert np.ptp(np.stack([out.left, out.right]).mean(axis=(0, 1, 2))) < 1.0


def test_what_is_shown_changes_nothing_that_is_matched() -> None:
    pair = scene()
    shown, paper = (Preprocess(PreprocessParams(appearance=name))(pair) for name in ("water", "paper"))
    assert np.any(shown.left != paper.left)
    np.testing.assert_array_equal(shown.left_matching, paper.left_matching)
    np.testing.assert_array_equal(shown.right_matching, paper.right_matching)


def test_the_profile_paper_shows_the_paper_whatever_is_asked() -> None:
    whole, asked = (Preprocess(PreprocessParams(profile="paper", appearance=n))(scene()) for n in ("paper", "water"))
    np.testing.assert_array_equal(whole.left, asked.left)


def test_both_cameras_are_treated_alike() -> None:
    """A part that both cameras see comes out the same, though the right one also sees something glaring."""
    pair = scene(128, 256, shift=32)
    right = pair.right.copy()
    right[:, -32:] = 255
    out = Preprocess(replace(PLAIN, profile="paper", intensity_clip=2.0, color_equalization=True))(
        replace(pair, right=right)
    )
    np.testing.assert_array_equal(out.left[:, 32:], out.right[:, :-32])
    np.testing.assert_array_equal(out.left_matching[:, 32:], out.right_matching[:, :-32])


def test_whole_chain_agrees_between_the_cameras() -> None:
    pair = scene(128, 256, shift=32)
    for profile in ("paper", "matching"):
        out = Preprocess(PreprocessParams(profile=profile))(pair)
        left, right = (x.astype(float) for x in (out.left_matching[:, 64:-32], out.right_matching[:, 32:-64]))
        gain, offset = np.polyfit(left.ravel(), right.ravel(), 1)
        assert gain == pytest.approx(1, abs=0.06)
        assert abs(offset) < 8
        assert np.corrcoef(left.ravel(), right.ravel())[0, 1] > 0.97


def test_exchanged_cameras_come_out_exchanged() -> None:
    pair = scene()
    out = images(Preprocess()(pair))
    back = images(Preprocess()(replace(pair, left=pair.right, right=pair.left)))
    for index, other in enumerate((1, 0, 3, 2)):
        np.testing.assert_array_equal(out[index], back[other])


@pytest.mark.parametrize("profile", ["paper", "matching", "none"])
def test_16_bits_agree_with_8(profile: str) -> None:
    stage = Preprocess(PreprocessParams(profile=profile))
    pair = scene()
    wide = replace(pair, left=pair.left.astype(np.uint16) * 257, right=pair.right.astype(np.uint16) * 257)
    for narrow, broad in zip(images(stage(pair)), images(stage(wide)), strict=True):
        assert np.abs(narrow.astype(int) - broad).max() <= 1
    fine = stage(scene(peak=65535))
    for narrow, broad in zip(images(stage(pair)), images(fine), strict=True):
        assert np.abs(narrow.astype(int) - broad).mean() < 2.0


def test_12_bits_in_16_are_noticed_or_told() -> None:
    twelve = scene(peak=4095)
    eight = images(Preprocess(replace(PLAIN, profile="none"))(scene()))
    for bits in (0, 12):
        out = images(Preprocess(replace(PLAIN, profile="none", sensor_bits=bits))(twelve))
        assert np.abs(out[2].astype(int) - eight[2]).max() <= 1


def test_none_is_the_raw_gray_image() -> None:
    gray = to_bytes(leaves(50, 70))
    out = Preprocess(PreprocessParams(profile="none"))(StereoPair(gray, gray[::-1]))
    np.testing.assert_array_equal(out.left_matching, gray)
    np.testing.assert_array_equal(out.right_matching, gray[::-1])
    pair = scene()
    out = Preprocess(PreprocessParams(profile="none"))(pair)
    expected = np.round(pair.left @ [0.299, 0.587, 0.114])
    assert np.abs(out.left_matching - expected).max() <= 1
    assert np.mean(out.left_matching - pair.left @ [0.299, 0.587, 0.114]) == pytest.approx(0, abs=0.1)
    striped = to_bytes(leaves(240, 320) + wave(240, 320, (0.13, 0.21), 12 / 255))
    out = Preprocess(PreprocessParams(profile="none"))(StereoPair(striped, striped))
    np.testing.assert_array_equal(out.left_matching, striped)


def test_matching_lowers_noise_and_keeps_contrast() -> None:
    clean = leaves(240, 320, count=150)
    noisy = [to_bytes(clean + np.random.default_rng(k).normal(0, 10 / 255, clean.shape)) for k in (0, 1)]
    out = Preprocess()(StereoPair(*noisy))
    assert psnr(out.left_matching / 255, clean) > psnr(noisy[0] / 255, clean) + 5
    assert np.polyfit(clean.ravel(), out.left_matching.ravel() / 255, 1)[0] == pytest.approx(1, abs=0.05)


def test_every_step_can_be_switched_off() -> None:
    pair = scene()
    gray = to_bytes(colored_leaves(120, 160)[..., 1] + wave(120, 160, (0.3, 0.2), 0.05))
    moire = StereoPair(np.repeat(gray[..., None], 3, 2), pair.right)
    whole = Preprocess(PreprocessParams(appearance="paper"))(moire)
    for switch in (
        "moire_removal", "homomorphic_filtering", "wavelet_denoising", "anisotropic_filtering", "color_equalization",
        "chroma_follows",
    ):  # fmt: skip
        out = Preprocess(PreprocessParams(appearance="paper", **{switch: False}))(moire)
        assert np.any(out.left != whole.left), switch


def test_with_all_steps_off_the_picture_is_only_stretched() -> None:
    pair = scene()
    out = Preprocess(PLAIN)(pair)
    luma = [(x @ [0.299, 0.587, 0.114]) for x in (pair.left, pair.right)]
    low, high = np.min(luma), np.max(luma)
    expected = (luma[0] - low) / (high - low) * 255
    got = out.left @ [0.299, 0.587, 0.114]
    unclipped = out.left.max(axis=2) < 255
    assert np.abs(got - expected)[unclipped].max() < 2.0


def test_moire_is_gone_from_what_is_matched() -> None:
    clean = leaves(240, 320)
    striped = to_bytes(clean + wave(240, 320, (0.13, 0.21), 12 / 255))
    pair = StereoPair(striped, to_bytes(clean))
    out = Preprocess(PreprocessParams(matching_strength=0.0))(pair)
    assert psnr(out.left_matching / 255, clean) > psnr(striped / 255, clean) + 15


@settings(max_examples=20)
@given(st.integers(1, 70), st.integers(1, 70), st.booleans(), st.sampled_from(["paper", "matching", "none"]))
def test_any_size(height: int, width: int, color: bool, profile: str) -> None:
    shape = (height, width, 3) if color else (height, width)
    left, right = (np.random.default_rng(k).integers(0, 256, shape).astype(np.uint8) for k in (0, 1))
    out = Preprocess(PreprocessParams(profile=profile))(StereoPair(left, right))
    assert out.left.shape == (height, width, 3)
    assert out.left_matching.shape == (height, width)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_blank_images_come_out_blank(value: int) -> None:
    blank = np.full((60, 80, 3), value, np.uint8)
    for image in images(Preprocess(PreprocessParams(profile="paper"))(StereoPair(blank, blank))):
        assert np.ptp(image) == 0


def test_the_same_bits_twice_whatever_the_threads() -> None:
    pair = scene(200, 300)
    before = pair.left.copy(), pair.right.copy()
    stage = Preprocess()
    first = images(stage(pair))
    threads = cv2.getNumThreads()
    try:
        cv2.setNumThreads(1)
        again = [images(stage(pair))]
    finally:
        cv2.setNumThreads(threads)
    with ThreadPoolExecutor(3) as pool:
        again += [images(out) for out in pool.map(stage, [pair] * 3)]
    for other in again:
        for one, two in zip(first, other, strict=True):
            np.testing.assert_array_equal(one, two)
    np.testing.assert_array_equal(pair.left, before[0])
    np.testing.assert_array_equal(pair.right, before[1])


def test_views_and_strides_do_not_matter() -> None:
    pair = scene()
    flipped = StereoPair(pair.left[:, ::-1].copy()[:, ::-1], np.asfortranarray(pair.right))
    for one, two in zip(images(Preprocess()(pair)), images(Preprocess()(flipped)), strict=True):
        np.testing.assert_array_equal(one, two)


def test_bad_pairs_are_refused() -> None:
    gray = np.zeros((4, 6), np.uint8)
    with pytest.raises(ImageError, match="right: expected the left image's shape"):
        Preprocess()(StereoPair(gray, gray[:, :5]))
    with pytest.raises(TypeError, match="left: expected uint8 or uint16, got float64"):
        Preprocess()(StereoPair(np.full((4, 6), np.nan), np.full((4, 6), np.nan)))
    with pytest.raises(ValueError, match="profile: expected one of paper, matching, none, got 'best'"):
        PreprocessParams(profile="best")
    with pytest.raises(ValueError, match=r"wavelet: expected farras or one of PyWavelets .* got 'mexh'"):
        PreprocessParams(wavelet="mexh")
    with pytest.raises(ValueError, match=r"diffusion_rate: expected a float in \[0, 0.25\]"):
        PreprocessParams(diffusion_rate=0.3)


def verified_matches(left: Image, right: Image) -> int:
    """SIFT matches that one epipolar geometry explains within 1 px."""
    finder = cv2.SIFT_create(3000)
    found = [finder.detectAndCompute(cv2.cvtColor(x, cv2.COLOR_RGB2GRAY), None) for x in (left, right)]
    near = cv2.BFMatcher().knnMatch(found[0][1], found[1][1], k=2)
    good = [one for one, two in near if one.distance < 0.8 * two.distance]
    ends = [np.array([found[k][0][(m.queryIdx, m.trainIdx)[k]].pt for m in good]) for k in (0, 1)]
    _, inliers = cv2.findFundamentalMat(*ends, cv2.USAC_MAGSAC, 1.0, 0.999, 5000)
    return int(inliers.sum())


def test_texture_of_real_water_is_recovered() -> None:
    need_data()
    for path in (p for p in real_images() if "underwater" in str(p)):
        pair = StereoPair(*(cv2.imread(str(path.with_stem(view)))[..., ::-1] for view in ("left", "right")))
        out = Preprocess(PreprocessParams(appearance="paper"))(pair)
        assert verified_matches(out.left, out.right) > 2 * verified_matches(pair.left, pair.right), path
