import numpy as np
import pytest
from helpers.rig_scenes import intrinsics
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.rectify.warp import inner_windows, make_canvas, row_spans, swapped_map, swapped_window, warp_image
from uw_recon_ros.types import Window


def brute_force(masks, same_columns):
    """Area of the best windows, by trying all of them."""
    height = len(masks[0])
    best = 0
    for top in range(height):
        for bottom in range(top + 1, height + 1):
            rows = [mask[top:bottom].all(axis=0) for mask in masks]
            if same_columns:
                rows = [rows[0] & rows[1]]
            runs = [
                max((len(run) for run in "".join("x" if c else " " for c in row).split()), default=0) for row in rows
            ]
            best = max(best, min(runs) * (bottom - top))
    return best


@settings(max_examples=40)
@given(
    data=st.data(),
    same_columns=st.booleans(),
    height=st.integers(1, 9),
    width=st.integers(1, 9),
)
def test_windows_are_the_largest(data, same_columns, height, width):
    """Rows without holes, as views without holes have them."""
    masks = []
    for _ in range(2):
        edges = data.draw(
            st.lists(st.tuples(st.integers(0, width), st.integers(0, width)), min_size=height, max_size=height)
        )
        masks.append(np.array([[min(e) <= u < max(e) for u in range(width)] for e in edges]))
    windows = inner_windows((masks[0], masks[1]), same_columns=same_columns)
    assert windows[0].width * windows[0].height == brute_force(masks, same_columns)
    if windows[0].width:
        for mask, window in zip(masks, windows, strict=True):
            assert mask[window.slices].all()
        left, right = windows
        assert (left.v, left.height, left.width) == (right.v, right.height, right.width)
        assert not same_columns or left == right


def test_longest_run_where_a_row_has_holes():
    shown = np.array([[1, 1, 0, 1, 1, 1, 0], [0, 0, 0, 0, 0, 0, 0], [0, 1, 1, 0, 0, 0, 0]], bool)
    first, last = row_spans(shown)
    assert first.tolist()[0::2] == [3, 1]
    assert last.tolist()[0::2] == [6, 3]
    assert first[1] == last[1]


def test_identity_shows_everything_and_changes_nothing():
    k = intrinsics(64, 48, 60.0)
    canvas = make_canvas(RectifiedCamera(k, np.eye(3), k), 64, 48, 64, 48)
    assert canvas.shown.all()
    image = np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8)
    np.testing.assert_array_equal(warp_image(image, canvas.raw_from_rect, "cubic"), image)


@pytest.mark.parametrize("interpolation", ["linear", "cubic", "lanczos"])
def test_a_smooth_image_is_read_where_the_map_says(interpolation):
    k = intrinsics(160, 120, 150.0)
    view = RectifiedCamera(k, Rotation.from_euler("xyz", [1, -2, 4], degrees=True).as_matrix(), k)
    v, u = np.mgrid[0:120, 0:160]
    image = np.rint(128 + 60 * np.sin(u / 12) + 50 * np.cos(v / 15)).astype(np.uint8)
    canvas = make_canvas(view, 160, 120, 160, 120)
    warped = warp_image(image, canvas.raw_from_rect, interpolation)
    raw = view.raw_grid(160, 120)
    expected = 128 + 60 * np.sin(raw[..., 0] / 12) + 50 * np.cos(raw[..., 1] / 15)
    inside = canvas.shown.copy()
    inside[:8], inside[-8:], inside[:, :8], inside[:, -8:] = False, False, False, False
    assert np.abs(warped - expected)[inside].max() < 2.5
    assert (warped[~canvas.shown] == 0).all()


def test_swapping_rows_and_columns():
    k = intrinsics(40, 30, 50.0)
    view = RectifiedCamera(k, Rotation.from_euler("xyz", [1, -2, 4], degrees=True).as_matrix(), k)
    canvas = make_canvas(view.transposed(), 30, 40, 30, 40)
    upright = make_canvas(view, 40, 30, 40, 30)
    np.testing.assert_allclose(swapped_map(canvas.raw_from_rect), upright.raw_from_rect, atol=1e-4)
    assert swapped_window(Window(1, 2, 3, 4)) == Window(2, 1, 4, 3)
