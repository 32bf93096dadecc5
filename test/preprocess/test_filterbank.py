from __future__ import annotations

import numpy as np
import pytest
import pywt
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.preprocess.filterbank import FARRAS, WAVELETS, analyse, named_wavelet, noise_gains, synthesise


@settings(max_examples=25)
@given(st.integers(1, 40), st.integers(1, 40))
def test_perfect_reconstruction(half_height: int, half_width: int) -> None:
    image = np.random.default_rng(half_height).random((2 * half_height, 2 * half_width))
    np.testing.assert_allclose(synthesise(*analyse(image)), image, rtol=0, atol=1e-12)


@settings(max_examples=25)
@given(st.integers(1, 40), st.integers(1, 40))
def test_coefficients_are_those_of_pywavelets(half_height: int, half_width: int) -> None:
    image = np.random.default_rng(half_width).normal(0, 1, (2 * half_height, 2 * half_width))
    lowpass, bands = analyse(image)
    theirs, their_bands = pywt.dwt2(image, named_wavelet(FARRAS), mode="periodization")
    np.testing.assert_allclose([lowpass, *bands], [theirs, *their_bands], atol=1e-13)


def test_filters_are_orthonormal_to_their_even_shifts() -> None:
    farras = named_wavelet(FARRAS)
    low, high = np.array(farras.dec_lo), np.array(farras.dec_hi)
    for shift in range(0, 10, 2):
        expected = 1.0 if shift == 0 else 0.0
        assert low[shift:] @ low[: 10 - shift] == pytest.approx(expected, abs=1e-12)
        assert high[shift:] @ high[: 10 - shift] == pytest.approx(expected, abs=1e-12)
        assert low[shift:] @ high[: 10 - shift] == pytest.approx(0, abs=1e-12)
    assert low.sum() == pytest.approx(np.sqrt(2), abs=1e-10)
    assert high.sum() == pytest.approx(0, abs=1e-10)


def test_energy_is_preserved() -> None:
    image = np.random.default_rng(0).normal(0, 1, (32, 64))
    lowpass, bands = analyse(image)
    assert sum(np.square(band).sum() for band in (lowpass, *bands)) == pytest.approx(np.square(image).sum())


def test_float32_stays_float32() -> None:
    image = np.random.default_rng(0).random((16, 16)).astype(np.float32)
    lowpass, bands = analyse(image)
    assert {band.dtype for band in (lowpass, *bands, synthesise(lowpass, bands))} == {np.dtype(np.float32)}


@pytest.mark.parametrize("name", ["haar", "db4", "sym8", "coif2", "bior4.4", "bior2.2", "rbio3.3"])
def test_any_wavelet_reconstructs(name: str) -> None:
    image = np.random.default_rng(0).random((64, 96))
    np.testing.assert_allclose(synthesise(*analyse(image, name), name), image, rtol=0, atol=1e-10)


@pytest.mark.parametrize("name", ["db4", "bior4.4", "bior2.2", "rbio3.3", "bior3.1"])
def test_noise_gains_are_what_white_noise_shows(name: str) -> None:
    lowpass = np.random.default_rng(0).normal(0, 1, (1024, 1024))
    for gains in noise_gains(name, 3):
        lowpass, bands = analyse(lowpass, name)
        np.testing.assert_allclose([band.std() for band in bands], gains, rtol=0.03)


def test_names_are_those_of_pywavelets_and_ours() -> None:
    assert set(WAVELETS) == {FARRAS, *pywt.wavelist(kind="discrete")} - {"dmey"}
    with pytest.raises(ValueError, match=r"wavelet: expected farras or one of PyWavelets .* got 'mexh'"):
        named_wavelet("mexh")
