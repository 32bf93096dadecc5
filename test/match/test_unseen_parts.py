"""What an image does not show has no disparity, spoils none beside it, and is refused where nothing else is left."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.match.planes.gray import local_contrast, noise_to_contrast
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import ByteImage, Mask, RectificationQuality, RectifiedPair, Status, StereoGeometry
from uw_recon_ros.unseen_pixels import mark_unseen

HEIGHT, WIDTH, FAR, NEAR = 120, 200, 6, 18
GEOMETRY = StereoGeometry(focal_px=300.0, cx_left=99.5, cx_right=99.5, cy=59.5)
MATCH = Match(MatchParams(effort="balanced", min_disparity=0, max_disparity=30, match_threads=1))


def texture(seed: int) -> ByteImage:
    grain = np.random.default_rng(seed).normal(size=(HEIGHT, WIDTH + NEAR)).astype(np.float32)
    smooth = cv2.GaussianBlur(grain, (0, 0), 1.2)
    return np.asarray(np.clip(smooth / smooth.std() * 40 + 120, 1, 255), np.uint8)


def scene() -> tuple[RectifiedPair, NDArray[np.float32]]:
    """A wall with a box in front of it; and the true disparity."""
    wall, box = texture(0), texture(1)
    left, right = wall[:, :WIDTH].copy(), wall[:, FAR : FAR + WIDTH].copy()
    truth = np.full((HEIGHT, WIDTH), FAR, np.float32)
    left[30:90, 100:150] = truth[30:90, 100:150] = 0
    left[30:90, 100:150] = box[30:90, 100:150]
    right[30:90, 100 - NEAR : 150 - NEAR] = box[30:90, 100:150]
    truth[30:90, 100:150] = NEAR
    shown = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    return RectifiedPair(shown, shown, left, right, GEOMETRY, RectificationQuality("given")), truth


def part(name: str) -> Mask:
    mask = np.zeros((HEIGHT, WIDTH), np.bool_)
    if name == "frame":
        mask[:8] = mask[-8:] = mask[:, :8] = mask[:, -8:] = True
    else:
        mask[{"lower": (slice(60, None),), "beside": (slice(None), slice(100, None)),
              "most": (slice(34, None),)}[name]] = True  # fmt: skip
    return mask


def hidden(pair: RectifiedPair, mask: Mask, cameras: str) -> RectifiedPair:
    for name in cameras.split():
        pair = replace(pair, **{f"{name}_matching": mark_unseen(getattr(pair, f"{name}_matching"), mask)})
    return pair


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
@pytest.mark.parametrize("cameras", ["left", "right", "left right"])
@pytest.mark.parametrize("name", ["frame", "lower", "beside", "most"])
def test_nothing_there_and_nothing_spoilt_beside_it(name: str, cameras: str, axis: str) -> None:
    pair, truth = scene()
    mask = part(name)
    pair = hidden(pair, mask, cameras)
    if axis == "vertical":
        images = {n: np.ascontiguousarray(getattr(pair, n).T) for n in ("left_matching", "right_matching")}
        shown = pair.left.swapaxes(0, 1)
        pair = replace(pair, left=shown, right=shown, geometry=replace(GEOMETRY, axis=axis), **images)
    found = MATCH(pair)
    status, disparity = (found.status.T, found.disparity.T) if axis == "vertical" else (found.status, found.disparity)
    u = np.arange(WIDTH)[None] - truth.astype(int)
    partner_hidden = (u < 0) | (mask[np.arange(HEIGHT)[:, None], u.clip(0)] & ("right" in cameras))
    if "left" in cameras:
        assert (status[mask] == Status.UNSEEN).all()
        assert not (status[~mask] == Status.UNSEEN).any()
    usable = ~partner_hidden & ~(mask & ("left" in cameras))
    inner = cv2.erode(usable.astype(np.uint8), np.ones((5, 5))) > 0
    right = np.abs(disparity - truth) <= 1
    assert right[inner].mean() > 0.93
    valid = np.isfinite(disparity)
    assert (valid & ~right).sum() < 0.02 * valid.sum()
    if "right" in cameras:
        lost = partner_hidden & ~(mask & ("left" in cameras))
        assert (valid & lost).sum() <= 0.04 * max(lost.sum(), 1)


@pytest.mark.parametrize("camera", ["left", "right", "left right"])
def test_an_image_without_a_scene_is_refused_by_name(camera: str) -> None:
    pair, _ = scene()
    dark = hidden(pair, np.ones((HEIGHT, WIDTH), np.bool_), camera)
    with pytest.raises(EstimationError, match=f"^{camera.split()[0]} image: expected a scene on at least 2%") as caught:
        MATCH(dark)
    assert caught.value.code == Code.MATCH_NOTHING_SEEN


def test_the_same_mask_from_whoever_rectified() -> None:
    """A rectifier that paints black what lies outside needs to say nothing else."""
    pair, _ = scene()
    black = pair.left_matching.copy()
    black[:, :20] = 0
    assert (MATCH(replace(pair, left_matching=black)).status[:, :20] == Status.UNSEEN).all()


@pytest.mark.parametrize("value", [255, 90])
def test_a_plain_part_does_not_count_for_contrast_or_noise(value: int) -> None:
    """Burnt out, or of one gray: it says nothing about the rest, whose contrast all images are brought to."""
    image = texture(0).astype(np.float32)
    plain = np.where(np.arange(HEIGHT)[:, None] < 34, image, np.float32(value))
    assert local_contrast(plain) == pytest.approx(local_contrast(image), rel=0.2)
    assert noise_to_contrast(plain) == pytest.approx(noise_to_contrast(image), rel=0.3)
    assert local_contrast(np.full_like(image, value)) == noise_to_contrast(np.full_like(image, value)) == 0
