"""Colours stand for the values the legend says, and every invalid pixel for its reason."""

from __future__ import annotations

import numpy as np
import pytest
from helpers.report_results import HEIGHT, WIDTH, depth_map, disparity_map, picture

from uw_recon_ros.report.colors import REASONS, ColorBar, color_table, colorize, reasons_in, robust_limits
from uw_recon_ros.report.figures import (
    as_byte_rgb,
    colorize_depth,
    colorize_disparity,
    depth_bar,
    disparity_bar,
    epipolar_lines,
    error_bar,
    error_map,
    with_color_bar,
)
from uw_recon_ros.types import Status

MAPS = ("viridis", "magma", "plasma", "diverging", "plasma_r")


def luminance(colors):
    return colors.astype(float) @ [0.2126, 0.7152, 0.0722]


@pytest.mark.parametrize("name", ["viridis", "magma", "plasma"])
def test_colour_maps_rise_in_luminance(name):
    assert (np.diff(luminance(color_table(name))) > -1.0).all()
    assert luminance(color_table(name))[-1] > luminance(color_table(name))[0] + 100


def test_reversed_maps_are_reversed_and_unknown_ones_named():
    assert np.array_equal(color_table("plasma_r"), color_table("plasma")[::-1])
    with pytest.raises(ValueError, match="colormap: expected one of viridis, magma, plasma, diverging, got 'jet'"):
        color_table("jet")


@pytest.mark.parametrize("name", MAPS)
def test_no_reason_looks_like_a_value(name):
    table = color_table(name).astype(int)
    for color, words in REASONS.values():
        distance = np.abs(table - color).sum(axis=1).min()
        assert distance > 20, (words, name)


def test_reasons_differ_from_each_other():
    colors = np.array([color for color, _ in REASONS.values()])
    apart = np.abs(colors[:, None] - colors[None]).sum(-1) + 1000 * np.eye(len(colors), dtype=int)
    assert apart.min() > 40
    assert set(REASONS) == set(Status) - {Status.VALID}


def test_values_take_the_colour_of_their_place_in_the_legend():
    bar = ColorBar(10.0, 20.0, "px", "viridis")
    painted = colorize(np.float32([[10.0, 15.0, 20.0, -5.0, 99.0]]), bar)
    table = color_table("viridis")
    assert np.array_equal(painted[0], table[[0, 128, 255, 0, 255]])
    assert painted.dtype == np.uint8


def test_invalid_pixels_show_their_first_reason():
    values = np.full((1, 5), np.nan, np.float32)
    values[0, 4] = 1.0
    status = np.uint8([[Status.OCCLUDED, Status.OCCLUDED | Status.OUTSIDE, 0, Status.FILTERED, Status.OCCLUDED]])
    painted = colorize(values, ColorBar(0, 1, ""), status)
    expected = [REASONS[Status.OCCLUDED][0], REASONS[Status.OUTSIDE][0], (110, 110, 110), REASONS[Status.FILTERED][0]]
    assert painted[0, :4].tolist() == [list(color) for color in expected]
    assert painted[0, 4].tolist() == color_table("viridis")[255].tolist()


def test_shares_of_the_reasons_count_what_is_painted():
    source = disparity_map()
    painted = colorize_disparity(source)
    for color, _, share in reasons_in(source.disparity, source.status):
        assert (painted == color).all(-1).mean() == pytest.approx(share)
    total = sum(share for *_, share in reasons_in(source.disparity, source.status))
    assert total == pytest.approx(1 - source.density)


def test_disparity_and_depth_pictures_have_the_maps_size():
    for painted in (colorize_disparity(disparity_map()), colorize_depth(depth_map())):
        assert painted.shape == (HEIGHT, WIDTH, 3)
        assert painted.dtype == np.uint8
    assert disparity_bar(disparity_map()).unit == "px"
    assert depth_bar(depth_map()).unit == "m"
    assert depth_bar(depth_map(metric=False)).unit == "baselines"


def test_near_is_bright_in_both():
    disparity, depth = disparity_map(), depth_map()  # nearest on the right
    for painted in (colorize_disparity(disparity), colorize_depth(depth)):
        assert luminance(painted[30, -1]) > luminance(painted[30, 0]) + 50


def test_error_map_is_blue_where_too_near_and_red_where_too_far():
    depth = depth_map()
    truth = depth.depth.copy()
    truth[20, 10] += 1.0
    truth[20, 20] -= 1.0
    truth[20, 30] = np.nan
    painted = error_map(depth, truth, ColorBar(-0.5, 0.5, "m", "diverging")).astype(int)
    near, far, unknown, right = painted[20, 10], painted[20, 20], painted[20, 30], painted[20, 40]
    assert near[2] > near[0] + 50
    assert far[0] > far[2] + 50
    assert unknown.tolist() == [110, 110, 110]
    assert right.min() > 240


def test_error_legend_is_symmetrical_and_the_sizes_must_agree():
    depth = depth_map()
    bar = error_bar(depth, depth.depth + np.float32(0.01))
    assert bar.low == -bar.high
    assert bar.high == pytest.approx(0.01, rel=1e-3)
    with pytest.raises(ValueError, match=r"truth: expected \(48, 64\) as the depth map, got \(2, 2\)"):
        error_map(depth, np.ones((2, 2), np.float32))


def test_epipolar_lines_run_along_the_rig():
    left, right = np.zeros((40, 60, 3), np.uint8), np.zeros((40, 60, 3), np.uint8)
    rows = epipolar_lines(left, right, "horizontal", count=4)
    assert rows.shape == (40, 60 * 2 + 8, 3)
    assert [v for v in range(40) if rows[v, :60].any()] == [5, 15, 25, 35]
    for v in (5, 15, 25, 35):
        assert (rows[v] == rows[v, 0]).all()  # from the left view into the right one
    columns = epipolar_lines(left, right, "vertical", count=4)
    assert columns.shape == (40 * 2 + 8, 60, 3)
    assert np.array_equal(columns, epipolar_lines(left.swapaxes(0, 1), right.swapaxes(0, 1), count=4).swapaxes(0, 1))
    assert not left.any()
    with pytest.raises(ValueError, match="left, right: expected two"):
        epipolar_lines(left, right[:10])


def test_drawn_legend_is_under_the_picture():
    image = picture()
    drawn = with_color_bar(image, ColorBar(0, 5, "px", "viridis", "disparity"))
    assert np.array_equal(drawn[:HEIGHT], image)
    assert drawn.shape[1:] == (WIDTH, 3)
    assert drawn.shape[0] > HEIGHT
    assert (np.abs(drawn[HEIGHT:].astype(int) - color_table("viridis")[255]).sum(-1) < 12).any()


@pytest.mark.parametrize(
    ("values", "limits"),
    [([np.nan], (0.0, 1.0)), ([2.0, 2.0], (1.5, 2.5)), ([0.0, np.inf, 1.0], (0.01, 0.99))],
)
def test_limits_are_never_equal(values, limits):
    assert robust_limits(np.float32(values)) == pytest.approx(limits, abs=1e-6)


def test_raw_images_of_any_kind_become_byte_rgb():
    deep = np.full((4, 5), 1000, np.uint16)
    deep[0, 0] = 500
    assert as_byte_rgb(deep)[0, 0].tolist() == [128] * 3
    assert as_byte_rgb(deep)[1, 1].tolist() == [255] * 3
    assert as_byte_rgb(picture()) is not None
    with pytest.raises(TypeError, match="image: expected"):
        as_byte_rgb(np.ones((4, 5), np.float32))
