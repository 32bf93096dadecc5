"""Distances between surfaces, where they are known."""

from __future__ import annotations

import json

import numpy as np
import pytest
import trimesh

from uw_recon_ros.errors import ModelError
from uw_recon_ros.evaluate_surface import TriangleSearch, nearest_on_triangles, sample_triangles, surface_errors
from uw_recon_ros.findings import Code

SQUARE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
TWO = np.array([[0, 1, 2], [0, 2, 3]])


def test_a_shifted_square() -> None:
    found = surface_errors(SQUARE + np.array([0, 0, 0.004]), TWO, SQUARE, TWO, samples=5000)
    assert found.median_m == pytest.approx(0.004)
    assert found.p95_m == pytest.approx(0.004)
    assert found.bias_m == pytest.approx(0.004)
    assert found.completeness == 1.0
    assert surface_errors(SQUARE - np.array([0, 0, 0.02]), TWO, SQUARE, TWO, samples=5000).bias_m == pytest.approx(
        -0.02
    )
    json.dumps(found.as_dict(), allow_nan=False)


def test_half_of_a_square_is_half_complete() -> None:
    half = SQUARE * [0.5, 1, 1]
    found = surface_errors(half, TWO, SQUARE, TWO, samples=20_000)
    assert found.median_m < 1e-12
    assert found.completeness == pytest.approx(0.51, abs=0.01)  # 10 mm beyond its rim count
    only = surface_errors(half, TWO, SQUARE, TWO, samples=5000, truth_points=np.array([[0.2, 0.2, 0], [0.9, 0.2, 0]]))
    assert only.completeness == 0.5


def test_nearest_points_against_brute_force() -> None:
    rng = np.random.default_rng(0)
    corners, points = rng.normal(size=(200, 3, 3)), rng.normal(size=(200, 3))
    found = np.linalg.norm(nearest_on_triangles(points, corners) - points, axis=1)
    a, b = np.meshgrid(np.linspace(0, 1, 150), np.linspace(0, 1, 150))
    shares = np.stack([a, b, 1 - a - b], axis=-1)[a + b <= 1 + 1e-9]
    brute = np.array([np.linalg.norm(shares @ c - p, axis=1).min() for c, p in zip(corners, points, strict=True)])
    assert (found <= brute + 1e-9).all()
    np.testing.assert_allclose(found, brute, atol=0.03)


def test_a_ball_against_its_formula() -> None:
    ball = trimesh.creation.icosphere(4, 1.0)
    search = TriangleSearch(np.asarray(ball.vertices)[ball.faces], 20_000)
    points = np.random.default_rng(0).normal(size=(2000, 3))
    points *= (np.random.default_rng(1).uniform(0.8, 1.2, 2000) / np.linalg.norm(points, axis=1))[:, None]
    apart, signed = search.distances(points)
    np.testing.assert_allclose(signed, np.linalg.norm(points, axis=1) - 1, atol=2e-3)
    np.testing.assert_allclose(apart, np.abs(signed))


def test_samples_are_even_by_area() -> None:
    corners = np.array([[[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 0, 5], [3, 0, 5], [0, 3, 5]]])
    points, owners = sample_triangles(corners, 10_000)
    assert (owners == 1).mean() == pytest.approx(0.9, abs=0.01)
    np.testing.assert_allclose(points[owners == 1].mean(axis=0), [1, 1, 5], atol=0.05)


def test_nothing_to_compare_is_refused() -> None:
    with pytest.raises(ModelError, match="estimate: expected") as caught:
        surface_errors(SQUARE, np.empty((0, 3), int), SQUARE, TWO)
    assert caught.value.code is Code.MODEL_NOTHING
