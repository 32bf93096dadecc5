from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.preprocess.extension import (
    MOST_TIMES,
    crop_extension,
    extend_symmetric,
    extension_shape,
    extension_window,
)


@settings(max_examples=60)
@given(
    st.integers(1, 70), st.integers(1, 70), st.sampled_from([0, 1, 3]),
    st.sampled_from([np.uint8, np.uint16, np.float32, np.float64]),
)  # fmt: skip
def test_any_size_comes_back_exactly(height: int, width: int, channels: int, dtype: type) -> None:
    shape = (height, width, channels) if channels else (height, width)
    image = np.random.default_rng(height * 100 + width).integers(0, 256, shape).astype(dtype)
    extended = extend_symmetric(image)
    rows, columns = extended.shape[:2]
    assert extended.shape == (rows, columns, *shape[2:])
    assert extended.dtype == dtype
    side = 1 << (max(height, width) - 1).bit_length()
    if side * side <= MOST_TIMES * height * width:
        assert (rows, columns) == (side, side), "the paper's square"
    else:
        assert rows % 32 == columns % 32 == 0, "the wavelet halves both five times"
        assert rows >= height + height // 8
        assert columns >= width + width // 8
    np.testing.assert_array_equal(crop_extension(extended, height, width), image)


@settings(max_examples=30)
@given(st.integers(1, 40), st.integers(1, 40))
def test_extension_is_the_mirror_image(height: int, width: int) -> None:
    image = np.random.default_rng(7).random((height, width))
    shape = extension_shape(height, width)
    rows, columns = extension_window(height, width)
    assert (rows.start, columns.start) == ((shape[0] - height) // 2, (shape[1] - width) // 2)
    padding = (rows.start, shape[0] - rows.stop), (columns.start, shape[1] - columns.stop)
    np.testing.assert_array_equal(extend_symmetric(image), np.pad(image, padding, mode="symmetric"))


def test_a_square_power_of_two_is_left_as_it_is() -> None:
    image = np.random.default_rng(0).random((64, 64))
    np.testing.assert_array_equal(extend_symmetric(image), image)


@pytest.mark.parametrize(
    ("size", "side"), [((1, 1), 1), ((2, 1), 2), ((480, 640), 1024), ((720, 1280), 2048), ((1080, 1920), 2048)]
)
def test_sides(size: tuple[int, int], side: int) -> None:
    assert extension_shape(*size) == (side, side)


@settings(derandomize=True, max_examples=200, deadline=None)
@given(st.integers(1, 65_536), st.integers(1, 65_536))
def test_no_shape_costs_more_than_a_few_times_the_image(height: int, width: int) -> None:
    """65536 x 1 px had 4.3 thousand million of them; what is left over is the blocks of a thin image."""
    rows, columns = extension_shape(height, width)
    assert rows * columns <= MOST_TIMES * (height + 32) * (width + 32)


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"at least one pixel, got \(0, 5\)"):
        extend_symmetric(np.zeros((0, 5)))
    with pytest.raises(ValueError, match=r"expected 128 x 128 px for 100 x 70, got shape \(64, 64\)"):
        crop_extension(np.zeros((64, 64)), 100, 70)
    with pytest.raises(ValueError, match="expected at least 1 px, got 0, 5"):
        extension_shape(0, 5)
