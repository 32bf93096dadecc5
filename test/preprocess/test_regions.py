"""Borders and lost parts of a camera: found by name, left out, and nothing else taken for them."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.pictures import DATA, Image, colored_leaves, leaves, psnr, to_bytes

from uw_recon_ros.files.images import read_image
from uw_recon_ros.findings import Code, Severity
from uw_recon_ros.preprocess.regions import RegionWatch, constant_border, find_regions
from uw_recon_ros.preprocess.sequence import PreprocessSequence
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import StereoPair
from uw_recon_ros.unseen_pixels import MARGIN, unseen, with_margin

HEIGHT, WIDTH, SHIFT = 240, 320, 24


def scene(seed: int = 0) -> StereoPair:
    """Two noisy views of one flat picture."""
    wide = colored_leaves(HEIGHT, WIDTH + SHIFT, seed)
    rng = np.random.default_rng(seed)
    wide += 0.05 * cv2.GaussianBlur(rng.normal(0, 3, wide.shape).astype(np.float32), (0, 0), 1.2)
    left, right = (v + rng.normal(0, 0.01, v.shape).astype(np.float32) for v in (wide[:, :-SHIFT], wide[:, SHIFT:]))
    return StereoPair(to_bytes(left), to_bytes(right), frame_id="left")


def frame(width: int) -> Image:
    mask = np.ones((HEIGHT, WIDTH), np.bool_)
    mask[width:-width, width:-width] = False
    return mask


def letterbox() -> Image:
    mask = np.zeros((HEIGHT, WIDTH), np.bool_)
    mask[:30] = mask[-30:] = True
    return mask


def circle() -> Image:
    mask = np.ones((HEIGHT, WIDTH), np.uint8)
    cv2.circle(mask, (WIDTH // 2, HEIGHT // 2), 130, 0, -1)
    return mask > 0


BORDERS = {"1 px": frame(1), "2 px": frame(2), "16 px": frame(16), "letterbox": letterbox(), "circle": circle()}


def painted(image: Image, mask: Image, value: int) -> Image:
    out = image.copy()
    out[mask] = value
    return out


@pytest.mark.parametrize("value", [0, 16, 128])
@pytest.mark.parametrize("border", BORDERS.values(), ids=BORDERS.keys())
def test_borders_are_found_to_the_pixel(border: Image, value: int) -> None:
    pair = scene()
    found = find_regions(StereoPair(painted(pair.left, border, value), painted(pair.right, border, value)))
    for mask in found.masks:
        assert mask[border].all()
        assert (mask & ~with_margin(border)).mean() < 0.002
    assert {f.code for f in found.findings} == {Code.REGION_BORDER}
    assert {f.severity for f in found.findings} == {Severity.OK}  # made so: nobody need be warned


@pytest.mark.parametrize("border", BORDERS.values(), ids=BORDERS.keys())
@pytest.mark.parametrize("profile", ["paper", "matching"])
def test_enhanced_picture_is_as_good_as_without_the_border(border: Image, profile: str) -> None:
    pair, stage = scene(), Preprocess(PreprocessParams(profile=profile))
    black = StereoPair(painted(pair.left, border, 0), painted(pair.right, border, 0))
    good, out = stage(pair), stage(black)
    seen = ~with_margin(border)
    for name in ("left", "right", "left_matching", "right_matching"):
        whole, bordered = getattr(good, name) / 255.0, getattr(out, name) / 255.0
        assert abs(whole[seen].mean() - bordered[seen].mean()) < 0.02
        assert psnr(bordered[seen], whole[seen]) > 28
        assert not bordered[~seen].any()


def with_bar(image: Image, text: str, *, jpeg: bool) -> Image:
    image = image.copy()
    image[:24] = 0
    cv2.putText(image, text, (8, 17), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1)
    if not jpeg:
        return image
    coded = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    return np.asarray(cv2.imdecode(coded, cv2.IMREAD_COLOR))


@pytest.mark.parametrize(
    ("text", "jpeg", "least"), [("DEPTH 12.3 m  HDG 118", False, 0.97), ("", True, 0.97), ("12 m", True, 0.8)]
)
def test_bar_with_letters(text: str, jpeg: bool, least: float) -> None:
    """Beside letters a JPEG of a bar is not of one value: what lies between them is left."""
    pair = scene()
    found = find_regions(StereoPair(*(with_bar(image, text, jpeg=jpeg) for image in (pair.left, pair.right))))
    for mask in found.masks:
        assert mask[:20].mean() > least
        assert mask[32:].mean() < 0.01


def lost(part: Image, kind: str) -> Image:
    rng = np.random.default_rng(1)
    return {
        "black": lambda: np.zeros_like(part),
        "gray": lambda: np.full_like(part, 128),
        "noise": lambda: rng.integers(0, 256, part.shape, np.uint8),
        "silt": lambda: (np.array([96, 84, 62]) + rng.normal(0, 2, part.shape)).clip(0, 255).astype(np.uint8),
        "repeated": lambda: np.repeat(part[:1], len(part), axis=0),
    }[kind]()


def lower(image: Image, kind: str) -> Image:
    half = len(image) // 2
    return np.concatenate([image[:half], lost(image[half:], kind)])


def beside(image: Image, kind: str) -> Image:
    return np.ascontiguousarray(np.swapaxes(lower(np.swapaxes(image, 0, 1), kind), 0, 1))


KINDS = {"black": "dead", "gray": "dead", "noise": "noise", "repeated": "dead", "silt": "blank"}


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("color", [True, False])
@pytest.mark.parametrize("damage", [lower, beside])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("camera", ["left", "right"])
def test_half_a_camera_is_named_and_left_out(
    camera: str, kind: str, damage: Callable[[Image, str], Image], color: bool, bits: int
) -> None:
    pair = scene()
    broken = replace(pair, **{camera: damage(getattr(pair, camera), kind)})
    if not color:
        broken = replace(broken, left=broken.left[..., 1], right=broken.right[..., 1])
    if bits == 16:
        broken = replace(broken, left=broken.left.astype(np.uint16) * 16, right=broken.right.astype(np.uint16) * 16)
    found = find_regions(broken)
    [finding] = [f for f in found.findings if f.severity == Severity.WARN]
    assert finding.code == Code(f"region.{KINDS[kind]}")
    assert finding.text.startswith(f"{camera} camera:")
    mine, other = found.masks if camera == "left" else found.masks[::-1]
    expected = np.zeros(mine.shape, np.bool_)
    view = expected if damage is lower else expected.T
    view[len(view) // 2 :] = True
    assert (mine & expected).sum() > 0.97 * expected.sum()
    assert (mine & ~expected).mean() < 0.06
    assert not other.any()


@pytest.mark.parametrize("kind", ["black", "gray"])
def test_half_of_both_cameras_is_no_letterbox(kind: str) -> None:
    pair = scene()
    found = find_regions(StereoPair(lower(pair.left, kind), lower(pair.right, kind)))
    assert [f.severity for f in found.findings] == [Severity.WARN] * 2
    for mask in found.masks:
        assert mask[HEIGHT // 2 :].all()
        assert mask[: HEIGHT // 2 - MARGIN].mean() < 0.01


@pytest.mark.parametrize("value", [0, 128, 255])
@pytest.mark.parametrize("camera", ["left", "right"])
def test_a_whole_camera(camera: str, value: int) -> None:
    pair = scene()
    found = find_regions(replace(pair, **{camera: np.full_like(pair.left, value)}))
    mask = found.left if camera == "left" else found.right
    assert mask.all()
    assert [(f.code, f.severity) for f in found.findings] == [(Code.REGION_DEAD, Severity.WARN)]


def test_frozen_half_is_found_by_the_frame_before() -> None:
    first, second, third = scene(0), scene(1), scene(2)
    half = HEIGHT // 2
    torn = second.right.copy()
    torn[half:] = first.right[half:]
    watch = RegionWatch()
    assert not watch.update(first).findings
    found = watch.update(replace(second, right=torn))
    assert [(f.code, f.severity) for f in found.findings] == [(Code.REGION_FROZEN, Severity.WARN)]
    assert found.right[half:].mean() > 0.97
    assert not found.left.any()
    assert not found.right[: half - 8].any()
    assert not watch.update(third).findings


def test_a_pair_that_comes_again_is_not_frozen() -> None:
    """A still that is sent over and over, and a video that repeats a frame."""
    watch, pair = RegionWatch(), scene()
    assert not any(watch.update(pair).findings for _ in range(3))


def test_the_same_frames_give_the_same_pictures() -> None:
    frames = [scene(0), replace(scene(1), right=scene(0).right), scene(2)]
    one, two = PreprocessSequence(PreprocessParams()), PreprocessSequence(PreprocessParams())
    for pair in frames:
        first, second = one(pair), two(pair)
        assert first.findings == second.findings
        np.testing.assert_array_equal(first.right_matching, second.right_matching)
    assert unseen(PreprocessSequence(PreprocessParams())(frames[1]).right_matching).sum() == 0


def water(seed: int, mean: float = 90.0, sigma: float = 1.5) -> Image:
    """Open water: a slow gradient and the sensor's noise."""
    v = np.linspace(1.2, 0.6, HEIGHT)[:, None, None]
    tint = np.array([0.2, 0.9, 1.0]) * mean
    return (
        np.round(v * tint + np.random.default_rng(seed).normal(0, sigma, (HEIGHT, WIDTH, 3)))
        .clip(0, 255)
        .astype(np.uint8)
    )


def test_open_water_and_mud_are_not_dead() -> None:
    assert not find_regions(StereoPair(water(0), water(1))).findings
    blank = np.full((HEIGHT, WIDTH), 77, np.uint8)
    assert not find_regions(StereoPair(blank, blank)).findings
    pair = scene()
    one_sided = pair.left.copy()
    one_sided[:, :100] = water(0)[:, :100]  # seen by one camera alone, at the side
    assert not find_regions(replace(pair, left=one_sided)).findings
    below = pair.left.copy()
    below[-40:] = water(0)[-40:]
    assert not find_regions(replace(pair, left=below)).findings


@pytest.mark.parametrize("level", [4.0, 12.0, 40.0])
def test_a_dim_camera_is_not_dead(level: float) -> None:
    pair = scene()
    rng = np.random.default_rng(3)
    dim = np.round(pair.right * (level / pair.right.mean()) + rng.normal(0, 0.8, pair.right.shape)).clip(0, 255)
    assert not find_regions(replace(pair, right=dim.astype(np.uint8))).findings


def test_glare_is_part_of_the_scene() -> None:
    pair = scene()
    right = pair.right.copy()
    right[:70, 60:200] = 255
    assert not find_regions(replace(pair, right=right)).findings
    assert not constant_border(right[..., 0]).any()
    right[:70, :, 2] = (200 + np.random.default_rng(0).integers(-4, 5, (70, WIDTH))).astype(np.uint8)
    right[:70, :, :2] = 255  # two channels full, the third nearly even
    assert not find_regions(replace(pair, right=right)).findings


def test_fine_grain_that_both_see_is_no_noise() -> None:
    rng = np.random.default_rng(0)
    grain = rng.integers(60, 200, (HEIGHT, WIDTH + SHIFT), np.uint8)
    assert not find_regions(StereoPair(grain[:, :-SHIFT].copy(), grain[:, SHIFT:].copy())).findings


@pytest.mark.parametrize("shape", [(1, 1), (7, 300), (31, 33), (33, 35), (241, 323)])
def test_any_size(shape: tuple[int, int]) -> None:
    image = to_bytes(leaves(*shape))
    found = find_regions(StereoPair(image, image))
    assert found.left.shape == found.right.shape == shape
    assert not found.findings


def real_pairs() -> list[tuple[Path, Path]]:
    lefts = itertools.chain(
        DATA.glob("stereo*/*/left.png"), DATA.glob("underwater*/*/left.*"), DATA.glob("calibration/*/left/*")
    )
    return [(p, Path(str(p).replace("/left", "/right"))) for p in sorted(lefts)]


@pytest.mark.parametrize(("left", "right"), real_pairs(), ids=lambda p: "-".join(p.parts[-3:]))
def test_no_alarm_in_real_pairs(left: Path, right: Path) -> None:
    images = [read_image(path) for path in (left, right)]
    if images[0].ndim != images[1].ndim:
        images = [i if i.ndim == 2 else np.asarray(cv2.cvtColor(i, cv2.COLOR_RGB2GRAY)) for i in images]
    found = find_regions(StereoPair(*images))
    assert not [f for f in found.findings if f.severity > Severity.OK]
    assert found.right.mean() == 0
    assert found.left.mean() < 0.1  # the reef's one corner is exactly black


def test_where_there_are_no_photographs_it_is_said() -> None:
    if not real_pairs():
        pytest.skip(f"no photographs in {DATA}")
