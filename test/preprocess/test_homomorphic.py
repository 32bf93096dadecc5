from __future__ import annotations

import numpy as np
import pytest
from helpers.pictures import leaves

from uw_recon_ros.preprocess.extension import crop_extension, extend_symmetric
from uw_recon_ros.preprocess.homomorphic import LOG_FLOOR, homomorphic_filter, homomorphic_gain


def test_values_of_equation_5() -> None:
    gain = homomorphic_gain((64, 64), 4.0)
    assert gain.shape == (64, 33)
    assert gain[0, 0] == 0.5
    for v, u in [(0, 4), (3, 0), (-3, 4), (1, 1), (10, 32)]:
        paper = (2.5 - 0.5) * (1 - np.exp(-(v**2 + u**2) / (2 * 4.0**2))) + 0.5
        assert gain[v, u] == pytest.approx(paper, rel=1e-12)
    assert gain[32, 32] == pytest.approx(2.5)


def test_cutoff_counts_cycles_per_longer_side() -> None:
    gain = homomorphic_gain((64, 128), 4.0, 0.0, 1.0)
    half_power = 1 - np.exp(-0.5)
    assert gain[0, 4] == pytest.approx(half_power)  # 4 cycles over 128 px
    assert gain[2, 0] == pytest.approx(half_power)  # 2 cycles over 64 px: the same wave length


def test_single_wave_is_scaled_by_its_gain() -> None:
    v, u = np.mgrid[:64, :64]
    wave = 0.2 * np.cos(2 * np.pi * (3 * v + 5 * u) / 64)
    image = np.exp(wave - 1) - LOG_FLOOR
    gain = homomorphic_gain((64, 64), 6.0)[3, 5]
    np.testing.assert_allclose(np.log(homomorphic_filter(image, 6.0)), gain * wave - 0.5, atol=1e-12)


def lamp(height: int, width: int) -> np.ndarray:
    """A bright spot and a dark surround, 6 : 1."""
    v, u = np.mgrid[:height, :width]
    fall = np.exp(-0.5 * (((v - 0.4 * height) / (0.3 * height)) ** 2 + ((u - 0.6 * width) / (0.3 * width)) ** 2))
    return (0.15 + 0.85 * fall).astype(np.float32)


def filtered(image: np.ndarray, cutoff: float) -> np.ndarray:
    height, width = image.shape
    extended = extend_symmetric(image)
    return crop_extension(homomorphic_filter(extended, cutoff * extended.shape[0] / max(height, width)), height, width)


def unevenness(image: np.ndarray) -> float:
    """Spread of the log brightness of 4 x 4 fields."""
    logs = np.log(image)
    rows = np.array_split(logs, 4)
    return float(np.std([part.mean() for row in rows for part in np.array_split(row, 4, axis=1)]))


def test_known_illumination_is_evened_out() -> None:
    reflectance = 0.3 + 0.4 * np.random.default_rng(0).random((240, 320)).astype(np.float32)
    lit = reflectance * lamp(240, 320)
    assert unevenness(lit) > 0.4
    assert unevenness(filtered(lit, 8.0)) < 0.6 * unevenness(lit)


def test_lamp_alone_is_weakened_to_the_low_gain() -> None:
    illumination = lamp(240, 320)
    before = np.log(illumination + LOG_FLOOR)
    after = np.log(filtered(illumination, 64.0))
    slope = np.polyfit(before.ravel(), after.ravel(), 1)[0]
    assert slope == pytest.approx(0.5, abs=0.05)


def test_detail_is_lifted() -> None:
    image = leaves(200, 260)
    detail = [np.abs(np.diff(np.log(x + LOG_FLOOR), axis=1)).mean() for x in (image, filtered(image, 16.0))]
    assert 2.0 < detail[1] / detail[0] < 2.6


def test_a_brighter_exposure_is_a_constant_factor() -> None:
    image = leaves(128, 128)
    dark, bright = (homomorphic_filter(image * k + (k - 1) * np.float32(LOG_FLOOR), 8.0) for k in (1.0, 2.0))
    np.testing.assert_allclose(bright / dark, np.sqrt(2.0), rtol=1e-4)


def test_black_and_negative_stay_finite() -> None:
    image = leaves(64, 64)
    image[:20] = 0
    image[20:30] = -0.01
    assert np.isfinite(homomorphic_filter(image, 8.0)).all()


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"cutoff: expected a number in .*, got 0"):
        homomorphic_filter(np.ones((8, 8)), 0)
    with pytest.raises(ValueError, match=r"low_gain: .*, got -1"):
        homomorphic_gain((8, 8), 1.0, -1)
    with pytest.raises(ValueError, match="luminance: expected finite values"):
        homomorphic_filter(np.full((8, 8), np.inf), 1.0)
    with pytest.raises(ValueError, match=r"luminance: expected shape \(H, W\).*got \(8, 8, 3\)"):
        homomorphic_filter(np.ones((8, 8, 3)), 1.0)
