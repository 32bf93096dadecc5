"""The graph-cut matcher on scenes of known truth, and its properties."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import initial_disparity as module
from uw_recon_ros.match.planes.matcher import GraphCutResult, graph_cut
from uw_recon_ros.types import Status

Image = NDArray[np.uint8]


def texture(height: int, width: int, seed: int = 0, grain: float = 1.2) -> NDArray[np.float32]:
    """A smooth random pattern of full contrast, (H, W, 3)."""
    noise = np.random.RandomState(seed).normal(0, 1, (height, width, 3)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), grain)
    return np.asarray(np.clip(128 + 45 * smooth / smooth.std(), 0, 255), np.float32)


def pair_of(disparity: NDArray[np.floating], seed: int = 0, margin: int = 60) -> tuple[Image, Image]:
    """Left and right view of a textured surface without occlusion."""
    height, width = disparity.shape
    scene = texture(height, width + 2 * margin, seed)
    v, u = np.indices((height, width), np.float32)
    left = cv2.remap(scene, (u - disparity + margin).astype(np.float32), v, cv2.INTER_CUBIC)
    return to_bytes(left), to_bytes(scene[:, margin : margin + width])


def to_bytes(image: NDArray[np.floating]) -> Image:
    return np.asarray(np.clip(np.round(image), 0, 255), np.uint8)


def plane(height: int, width: int, along: float, down: float, at: float) -> NDArray[np.float64]:
    v, u = np.indices((height, width))
    return np.asarray(at + along * u + down * v, np.float64)


def step_pair() -> tuple[Image, Image, NDArray[np.float32]]:
    """A square at 9 px before a wall at 3 px; its truth in the left view, NaN where the right camera sees nothing."""
    wall, square = texture(70, 160, 1), texture(70, 160, 2)
    left, right = wall[:, 30:130].copy(), wall[:, 33:133].copy()
    left[20:50, 40:70], right[20:50, 31:61] = square[20:50, :30], square[20:50, :30]
    truth = np.full((70, 100), 3, np.float32)
    truth[20:50, 40:70] = 9
    truth[20:50, 34:40] = np.nan
    truth[:, :3] = np.nan
    return to_bytes(left), to_bytes(right), truth


@pytest.mark.parametrize("effort", ["balanced", "quality"])
@pytest.mark.parametrize("slopes", [(0.15, 0.0), (0.05, 0.6)])
def test_slanted_plane_is_found_below_the_pixel(effort: str, slopes: tuple[float, float]) -> None:
    truth = plane(60, 90, *slopes, 8.0)
    result = graph_cut(*pair_of(truth), 0, 60, effort=effort)
    error = np.abs(result.disparity - truth)
    assert np.nanmedian(error) < 0.1
    assert np.isfinite(error[:, 50:]).mean() > 0.97
    assert (error[:, 50:] > 0.5).mean() < 0.03


@pytest.mark.parametrize("effort", EFFORTS)
def test_hidden_pixels_are_told_from_seen_ones(effort: str) -> None:
    left, right, truth = step_pair()
    result = graph_cut(left, right, 0, 15, effort=effort)
    found, hidden = np.isfinite(result.disparity), np.isnan(truth)
    assert found[~hidden].mean() > 0.95
    assert (np.abs(result.disparity - truth)[found & ~hidden] < 0.5).mean() > 0.98
    assert found[hidden].mean() < 0.25
    assert (result.status[22:48, 35:39] == Status.OCCLUDED).mean() > 0.6


@pytest.mark.parametrize("effort", ["balanced", "quality"])
def test_a_near_thing_at_the_left_border_leaves_the_wall_behind_it(effort: str) -> None:
    """Continued to the border its plane would lie outside the right view, which must not be cheaper than a match."""
    wall, thing = 128 + 0.3 * (texture(90, 160, 1) - 128), texture(90, 160, 2)
    left, right = wall[:, 30:140].copy(), wall[:, 33:143].copy()
    left[20:70, 22:60], right[20:70, 8:46] = thing[20:70, :38], thing[20:70, :38]
    random = np.random.RandomState(3)
    noisy = (to_bytes(image + random.normal(0, 3, image.shape)) for image in (left, right))
    result = graph_cut(*noisy, 0, 20, effort=effort)
    assert (np.abs(result.disparity - 3) < 1)[22:68, 4:8].mean() > 0.9


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
def test_a_blank_border_is_outside_as_far_as_the_surface_it_ends_at_would_be(effort: str) -> None:
    left, right = pair_of(np.full((90, 200), 30.0), margin=100)
    left[:, :70], right[:, :40] = 128, 128
    status = graph_cut(left, right, 0, 40, effort=effort).status
    inside = slice(8, -8)
    assert (status[inside, :29] == Status.OUTSIDE).all()
    assert (status[inside, 31:60] == Status.LOW_TEXTURE).all()


@pytest.mark.parametrize("effort", EFFORTS)
def test_fields_agree(effort: str) -> None:
    left, right, _ = step_pair()
    result = graph_cut(left, right, 0, 15, effort=effort)
    valid = np.isfinite(result.disparity)
    assert result.disparity.dtype == result.sigma.dtype == np.float32
    assert result.status.dtype == np.uint8
    assert np.array_equal(valid, result.status == 0)
    assert np.array_equal(valid, np.isfinite(result.sigma))
    assert (result.sigma[valid] > 0).all()
    assert np.isfinite(result.energy) == (effort != "navigation")


@pytest.mark.parametrize("effort", EFFORTS)
def test_threads_change_no_bit(effort: str) -> None:
    left, right, _ = step_pair()
    one, two, three = (graph_cut(left, right, 0, 15, effort=effort, threads=n) for n in (1, 2, 3))
    for other in (two, three):
        assert one.disparity.tobytes() == other.disparity.tobytes()
        assert one.sigma.tobytes() == other.sigma.tobytes()
        assert one.status.tobytes() == other.status.tobytes()


@pytest.mark.parametrize("effort", EFFORTS)
def test_identical_images_give_zero(effort: str) -> None:
    image = to_bytes(texture(50, 80))
    result = graph_cut(image, image, -4, 12, effort=effort)
    assert np.isfinite(result.disparity).mean() > 0.99
    # a parabola through the costs of three labels is not symmetric where the texture is not
    assert np.nanmax(np.abs(result.disparity)) < (0.1 if effort == "navigation" else 0.05)


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("shift", [-13, 7])
def test_whole_shift_moves_the_disparity(effort: str, shift: int) -> None:
    truth = plane(50, 80, 0.05, 0.02, 2.0)
    left, right = pair_of(truth)
    base = graph_cut(left, right, 0, 12, effort=effort)
    moved_left, _ = pair_of(truth + shift)
    moved = graph_cut(moved_left, right, shift, 12 + shift, effort=effort)
    inside = (slice(None), slice(25, 60))
    difference = moved.disparity[inside] - base.disparity[inside] - shift
    assert np.nanmedian(np.abs(difference)) < 0.05
    assert (np.abs(difference) < 0.25).mean() > 0.97


def test_upside_down_is_upside_down() -> None:
    left, right, _ = step_pair()
    upright = graph_cut(left, right, 0, 15, effort="navigation")
    flipped = graph_cut(left[::-1], right[::-1], 0, 15, effort="navigation")
    same = np.isclose(upright.disparity, flipped.disparity[::-1], equal_nan=True)
    assert same.mean() > 0.99
    upright, flipped = (graph_cut(a, b, 0, 15) for a, b in ((left, right), (left[::-1], right[::-1])))
    assert np.nanmedian(np.abs(upright.disparity - flipped.disparity[::-1])) < 0.05


def test_mirrored_pair_gives_the_mirrored_right_view() -> None:
    truth = plane(50, 90, 0.0, 0.05, 5.0)
    left, right = pair_of(truth)
    straight = graph_cut(left, right, 0, 12)
    mirrored = graph_cut(right[:, ::-1], left[:, ::-1], 0, 12)
    # rows of one disparity: the right view has it d columns further left
    row_means = [np.nanmedian(r.disparity, axis=1) for r in (straight, mirrored)]
    assert np.allclose(*row_means, atol=0.1)


@pytest.mark.parametrize("effort", EFFORTS)
def test_no_disparity_outside_the_limits(effort: str) -> None:
    left, right = pair_of(plane(50, 80, 0.2, 0.0, 0.0))
    result = graph_cut(left, right, 3, 9, effort=effort)
    assert np.nanmin(result.disparity) >= 3 - 0.5
    assert np.nanmax(result.disparity) <= 9 + 0.5


def test_borders_are_as_good_as_the_inside() -> None:
    truth = plane(60, 100, 0.05, 0.1, 4.0)
    error = np.abs(graph_cut(*pair_of(truth), 0, 20).disparity - truth)
    seen = np.indices(truth.shape)[1] >= truth
    border = np.ones(truth.shape, bool)
    border[4:-4, 16:-4] = False
    assert (error[border & seen] < 0.5).mean() > 0.95


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
def test_brightness_and_veil_do_not_matter(effort: str) -> None:
    left, right, truth = step_pair()
    v, u = np.indices(truth.shape)
    darker = to_bytes(right * (0.75 - 0.001 * u[..., None]) + 25 + 0.1 * v[..., None])
    result = graph_cut(left, darker, 0, 15, effort=effort)
    error = np.abs(result.disparity - truth)[np.isfinite(truth)]
    assert (error < 0.5).mean() > 0.93


def test_weak_texture_is_carried_by_its_surroundings() -> None:
    truth = plane(60, 100, 0.05, 0.0, 4.0)
    left, right = (image.copy() for image in pair_of(truth))
    left[20:40, 45:65], right[20:40, 39:58] = 120, 120
    error = np.abs(graph_cut(left, right, 0, 20).disparity - truth)[22:38, 47:62]
    assert (error < 0.7).mean() > 0.9


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize("shape", [(1, 40), (40, 1), (1, 1), (7, 13), (25, 50), (49, 33)])
@pytest.mark.parametrize("color", [False, True])
def test_odd_shapes(effort: str, shape: tuple[int, int], color: bool) -> None:
    image = to_bytes(texture(*shape))
    side = image if color else image[..., 0]
    result = graph_cut(side, side, 0, 8, effort=effort)
    assert result.disparity.shape == result.sigma.shape == result.status.shape == shape


def test_range_wider_than_the_images() -> None:
    left, right, truth = step_pair()
    result = graph_cut(left, right, -200, 200)
    error = np.abs(result.disparity - truth)[np.isfinite(truth)]
    assert (error < 0.5).mean() > 0.8


@pytest.mark.parametrize(("height", "width", "part", "rough_px"), [(120, 160, 4, 0.5), (241, 323, 30, 1.0)])
def test_volume_that_does_not_fit_starts_smaller(
    height: int, width: int, part: int, rough_px: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = plane(height, width, 0.025, 0.015, 6.0)
    left, right = pair_of(truth)
    monkeypatch.setattr(module, "MOST_BYTES", module.VOXEL_BYTES * height * width * 24 / part)  # halves, quarters
    result = graph_cut(left, right, 0, 24)
    seen = np.indices(truth.shape)[1] >= truth + 1
    assert np.nanmedian(np.abs(result.disparity - truth)[seen]) < 0.15
    rough = graph_cut(left, right, 0, 24, effort="navigation")
    assert np.nanmedian(np.abs(rough.disparity - truth)[seen]) < rough_px
    assert np.isfinite(rough.disparity[seen]).mean() > 0.95


def test_bad_calls_are_refused() -> None:
    image = np.zeros((8, 9), np.uint8)
    with pytest.raises(ValueError, match="left and right: expected two uint8 images of one shape"):
        graph_cut(image, image[:, :5], 0, 4)
    with pytest.raises(ValueError, match="min_disparity: expected at most max_disparity = 2, got 4"):
        graph_cut(image, image, 4, 2)
    with pytest.raises(ValueError, match="effort: expected one of navigation, balanced, quality, got 'more'"):
        graph_cut(image, image, 0, 4, effort="more")


def test_seed_matters_little() -> None:
    left, right, _ = step_pair()
    results: list[GraphCutResult] = [graph_cut(left, right, 0, 15, seed=seed) for seed in (0, 1)]
    assert results[1].energy == pytest.approx(results[0].energy, rel=0.03)
    assert np.nanmedian(np.abs(results[0].disparity - results[1].disparity)) < 0.1
