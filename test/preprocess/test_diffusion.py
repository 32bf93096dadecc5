from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.preprocess.diffusion import diffuse


def one_step_by_the_paper(image: np.ndarray, contrast: float, rate: float) -> np.ndarray:
    """Equations 9 and 10, pixel by pixel; a neighbour outside the image equals the pixel."""
    height, width = image.shape
    result = image.copy()
    for i in range(height):
        for j in range(width):
            for di, dj in ((-1, 0), (1, 0), (0, 1), (0, -1)):
                a, b = min(max(i + di, 0), height - 1), min(max(j + dj, 0), width - 1)
                gradient = image[a, b] - image[i, j]
                result[i, j] += rate * np.exp(-((abs(gradient) / contrast) ** 2)) * gradient
    return result


def test_values_of_equations_9_and_10() -> None:
    image = np.random.default_rng(0).random((9, 7)) * 0.3
    expected = one_step_by_the_paper(one_step_by_the_paper(image, 0.1, 0.25), 0.1, 0.25)
    np.testing.assert_allclose(diffuse(image, rate=0.25, iterations=2), expected, atol=1e-14)


@settings(max_examples=30)
@given(
    st.integers(1, 20), st.integers(1, 20), st.floats(0.01, 5.0), st.floats(0.0, 0.25), st.integers(0, 12),
    st.sampled_from([np.float32, np.float64]),
)  # fmt: skip
def test_no_new_extrema_and_the_same_mean(
    height: int, width: int, contrast: float, rate: float, iterations: int, dtype: type
) -> None:
    image = np.random.default_rng(iterations).random((height, width)).astype(dtype)
    diffused = diffuse(image, contrast=contrast, rate=rate, iterations=iterations)
    rounding = 4 * float(np.finfo(dtype).eps)
    assert diffused.dtype == dtype
    assert diffused.min() >= image.min() - rounding
    assert diffused.max() <= image.max() + rounding
    assert diffused.mean(dtype=np.float64) == pytest.approx(image.mean(dtype=np.float64), abs=10 * rounding)


def test_areas_are_smoothed_and_edges_kept() -> None:
    step = np.zeros((60, 60))
    step[:, 30:] = 0.6
    grainy = step + np.random.default_rng(0).normal(0, 0.02, step.shape)
    diffused = diffuse(grainy, iterations=10)
    assert diffused[:, :25].std() < 0.35 * grainy[:, :25].std()
    jump = np.diff(diffused.mean(axis=0))
    assert jump[29] > 0.55
    assert np.abs(np.delete(jump, 29)).max() < 0.02


def test_weak_edges_go() -> None:
    step = np.zeros((20, 60))
    step[:, 30:] = 0.03
    assert np.diff(diffuse(step, iterations=30).mean(axis=0)).max() < 0.006


def test_nothing_to_do_changes_nothing_and_the_input_is_never_touched() -> None:
    image = np.random.default_rng(0).random((8, 9))
    before = image.copy()
    np.testing.assert_array_equal(diffuse(image, iterations=0), image)
    np.testing.assert_array_equal(diffuse(image, rate=0.0), image)
    diffuse(image)
    np.testing.assert_array_equal(image, before)


def test_is_the_same_on_a_transposed_and_on_a_mirrored_image() -> None:
    image = np.random.default_rng(0).random((30, 40))
    np.testing.assert_allclose(diffuse(image.T), diffuse(image).T, atol=1e-15)
    np.testing.assert_allclose(diffuse(image[:, ::-1]), diffuse(image)[:, ::-1], atol=1e-15)


def test_errors_name_what_is_wrong() -> None:
    image = np.zeros((4, 4))
    with pytest.raises(ValueError, match=r"rate: expected a number in \[0, 0.25\], got 0.3"):
        diffuse(image, rate=0.3)
    with pytest.raises(ValueError, match=r"contrast: expected a number in .*, got 0"):
        diffuse(image, contrast=0)
    with pytest.raises(ValueError, match="iterations: expected"):
        diffuse(image, iterations=-1)
    with pytest.raises(ValueError, match="got 1 NaN or infinite of 4"):
        diffuse(np.array([[0, np.nan], [0, 1]]))
    with pytest.raises(ValueError, match="at least one pixel"):
        diffuse(np.zeros((0, 3)))
