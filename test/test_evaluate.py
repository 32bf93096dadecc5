"""Errors are counted as the benchmark counts them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import ImageError
from uw_recon_ros.evaluate import as_table, evaluate, fill_rows
from uw_recon_ros.files.disparities import read_disparity, write_pfm

NAN = np.nan


def test_bad_pixels_density_and_filling_by_hand() -> None:
    truth = np.array([[10, 10, 10, 10, np.inf]], np.float32)
    estimate = np.array([[10.4, NAN, 13, 10, 99]], np.float32)
    result = evaluate(estimate, truth)
    assert result.density_percent == 75
    assert result.unfilled.bad_percent == pytest.approx(
        {"bad-0.5": 100 / 3, "bad-1": 100 / 3, "bad-2": 100 / 3, "bad-4": 0}
    )
    assert result.unfilled.median_px == pytest.approx(0.4, abs=1e-5)
    assert result.filled.bad_percent["bad-0.5"] == 25  # the hole takes 10.4, not 13
    assert result.filled.pixels == 4
    assert "density" in as_table(result)


def test_an_error_of_just_x_is_not_over_x() -> None:
    truth = np.full((1, 4), 10, np.float32)
    estimate = truth + np.array([[0.5, 1, 2, 4]], np.float32)
    assert evaluate(estimate, truth).unfilled.bad_percent == {"bad-0.5": 75, "bad-1": 50, "bad-2": 25, "bad-4": 0}


def test_mask_limits_what_counts() -> None:
    truth = np.zeros((2, 2), np.float32)
    estimate = np.array([[0, 5], [NAN, 0]], np.float32)
    mask = np.array([[True, False], [False, True]])
    assert evaluate(estimate, truth, mask).filled.bad_percent["bad-0.5"] == 0
    with pytest.raises(ValueError, match="at least one pixel"):
        evaluate(estimate, truth, np.zeros((2, 2), bool))
    with pytest.raises(ValueError, match="one shape"):
        evaluate(estimate[:1], truth)


def test_an_empty_row_counts_as_wrong() -> None:
    truth = np.zeros((2, 3), np.float32)
    estimate = np.array([[0, 0, 0], [NAN, NAN, NAN]], np.float32)
    assert evaluate(estimate, truth).filled.bad_percent["bad-4"] == 50


@settings(max_examples=40)
@given(st.integers(1, 4), st.integers(1, 9), st.integers(0, 99))
def test_filling_equals_a_walk_over_the_row(height: int, width: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    disparity = rng.uniform(-5, 5, (height, width)).astype(np.float32)
    disparity[rng.random((height, width)) < 0.5] = NAN
    filled = fill_rows(disparity)
    for v, u in np.ndindex(height, width):
        sides = [disparity[v, u::-1], disparity[v, u:]]
        nearest = [side[np.isfinite(side)][0] for side in sides if np.isfinite(side).any()]
        expected = disparity[v, u] if np.isfinite(disparity[v, u]) else min(nearest, default=NAN)
        np.testing.assert_equal(filled[v, u], np.float32(expected))


def test_pfm_is_middleburys(tmp_path: Path) -> None:
    disparity = np.array([[1.5, NAN], [-2.0, 3.0]], np.float32)
    write_pfm(tmp_path / "d.pfm", disparity)
    raw = (tmp_path / "d.pfm").read_bytes()
    assert raw.startswith(b"Pf\n2 2\n-1.0\n")
    assert np.frombuffer(raw[-16:], "<f4").tolist() == [-2.0, 3.0, 1.5, np.inf]
    opencv = cv2.imread(str(tmp_path / "d.pfm"), cv2.IMREAD_UNCHANGED)
    np.testing.assert_array_equal(opencv, [[1.5, np.inf], [-2, 3]])
    np.testing.assert_array_equal(read_disparity(tmp_path / "d.pfm"), disparity)


def test_other_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "x.pfm").write_text("no")
    for name in ("x.pfm", "gone.pfm"):
        with pytest.raises(ImageError, match=name):
            read_disparity(tmp_path / name)
