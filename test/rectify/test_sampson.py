"""Eq. 13 against its definition, and its derivative against finite differences."""

import numpy as np
import pytest

from uw_recon_ros.rectify.sampson import (
    homogeneous,
    sampson_distance,
    sampson_error,
    sampson_jacobian,
    sampson_residuals,
)


def matches(seed=0, count=20):
    rng = np.random.default_rng(seed)
    return rng.normal(size=(3, 3)), rng.uniform(-2, 2, (count, 2)), rng.uniform(-2, 2, (count, 2))


def test_error_is_equation_13_written_out():
    fundamental, left, right = matches()
    errors = sampson_error(fundamental, left, right)
    for error, m_l, m_r in zip(errors, homogeneous(left), homogeneous(right), strict=True):
        a, b = fundamental @ m_l, m_r @ fundamental
        expected = (m_r @ fundamental @ m_l) ** 2 / (a[0] ** 2 + a[1] ** 2 + b[0] ** 2 + b[1] ** 2)
        assert error == pytest.approx(expected, rel=1e-12)


def test_rows_of_a_rectified_pair():
    rectified = np.array([[0.0, 0, 0], [0, 0, -1], [0, 1, 0]])  # eq. 11
    distance = sampson_distance(rectified, [[10.0, 50.0]], [[3.0, 53.0]])
    assert abs(distance[0]) == pytest.approx(3 / np.sqrt(2))


def test_distance_does_not_depend_on_the_scale_of_f_and_squares_to_the_error():
    fundamental, left, right = matches(1)
    distance = sampson_distance(fundamental, left, right)
    np.testing.assert_allclose(sampson_distance(7.0 * fundamental, left, right), distance)
    np.testing.assert_allclose(sampson_error(fundamental, left, right), distance**2)


def test_jacobian_equals_central_differences():
    fundamental, left, right = matches(2)
    left, right = homogeneous(left), homogeneous(right)
    step = 1e-6
    for entry in range(9):
        nudge = np.zeros(9)
        nudge[entry] = step
        nudge = nudge.reshape(3, 3)
        ahead, behind = (sampson_residuals(fundamental + s * nudge, left, right) for s in (1, -1))
        slope = sampson_jacobian(fundamental, left, right)[:, entry]
        np.testing.assert_allclose(slope, (ahead - behind) / (2 * step), rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize(
    ("fundamental", "left", "right"),
    [(np.eye(2), np.zeros((4, 2)), np.zeros((4, 2))), (np.eye(3), np.zeros((4, 2)), np.zeros((5, 2)))],
)
def test_wrong_shapes_are_named(fundamental, left, right):
    with pytest.raises(ValueError, match="expected shape"):
        sampson_distance(fundamental, left, right)
