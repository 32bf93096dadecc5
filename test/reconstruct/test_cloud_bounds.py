"""The filtered cloud is bounded in points and in work, whatever the depth map holds."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.reconstruct import cloud as module
from uw_recon_ros.reconstruct.cloud import thin_cloud
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.types import PointCloud

PASSES = 16


def of(points: np.ndarray) -> PointCloud:
    points = points.astype(np.float32)
    return PointCloud(points, np.zeros(points.shape, np.uint8), metric=True)


def lattice(count: int, spacing: float) -> np.ndarray:
    """Points that no voxel smaller than the spacing unites."""
    side = int(np.ceil(count ** (1 / 3)))
    grid = np.stack(np.meshgrid(*[np.arange(side) - side / 2] * 3), axis=-1).reshape(-1, 3)[:count]
    return (grid + 0.5) * spacing


def line(count: int) -> np.ndarray:
    return np.stack([np.linspace(0.2, 900.0, count), np.zeros(count), np.full(count, 0.3)], axis=1)


def two_scales(count: int) -> np.ndarray:
    rng = np.random.default_rng(0)
    clusters = rng.uniform(-500, 500, (64, 3))
    return clusters[rng.integers(0, 64, count)] + rng.normal(0, 1e-3, (count, 3))


SHAPES: dict[str, np.ndarray] = {
    "nothing valid": np.full((120, 160, 3), np.nan),
    "one voxel": np.full((120, 160, 3), 0.7),
    "a point among NaN": np.vstack([np.full((5000, 3), np.nan), [[0.1, 0.2, 1.5]]]),
    "lattice": lattice(20_000, 20.0),
    "line": line(20_000),
    "two scales": two_scales(20_000),
    "powers of two": np.array([[x, y, 1.0] for x in 2.0 ** np.arange(-8, 9) for y in 2.0 ** np.arange(-8, 9)]),
    "infinite": np.full((100, 3), np.inf),
    "on all octants": np.random.default_rng(1).normal(0, 300, (20_000, 3)),
}


@pytest.fixture
def passes(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the passes over the points."""
    counted: list[int] = []
    real = module._occupied

    def spy(cells: Any) -> Any:
        counted.append(len(cells))
        return real(cells)

    monkeypatch.setattr(module, "_occupied", spy)
    return counted


@pytest.mark.parametrize("most", [8, 1000, 19_990])
@pytest.mark.parametrize("voxel", [1e-4, 0.02, 10.0])
@pytest.mark.parametrize("name", SHAPES)
def test_points_and_passes_are_bounded(name: str, voxel: float, most: int, passes: list[int]) -> None:
    thin = thin_cloud(of(SHAPES[name]), min_range=0.1, max_range=1000.0, voxel=voxel, max_points=most)
    assert len(thin.points) <= most
    assert np.isfinite(thin.points).all()
    assert len(passes) <= PASSES
    if name in ("nothing valid", "infinite"):
        assert len(thin.points) == 0
    if name in ("one voxel", "a point among NaN"):
        assert len(thin.points) == 1


@settings(max_examples=60)
@given(
    count=st.integers(0, 400),
    scale=st.floats(-3, 3),
    spread=st.floats(0, 4),
    holes=st.floats(0, 1),
    voxel=st.floats(-4, 1),
    most=st.integers(8, 300),
    seed=st.integers(0, 2**16),
)
def test_any_cloud(count: int, scale: float, spread: float, holes: float, voxel: float, most: int, seed: int) -> None:
    """Dense, in range, no more than asked for, and every point within a cloud's voxel of points that were there."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, 3)) * 10 ** (scale + spread * rng.uniform(-0.5, 0.5, (count, 1)))
    points[rng.random(count) < holes] = np.nan
    thin = thin_cloud(of(points), min_range=0.05, max_range=500.0, voxel=10**voxel, max_points=most)
    length = np.linalg.norm(thin.points, axis=1)
    assert len(thin.points) <= most
    assert np.isfinite(thin.points).all()
    assert (length <= 500.0 * (1 + 1e-6)).all()
    kept = points[np.isfinite(points).all(axis=1)].astype(np.float32)
    kept = kept[(np.linalg.norm(kept, axis=1) >= 0.05) & (np.linalg.norm(kept, axis=1) <= 500.0)]
    assert (len(thin.points) > 0) == (len(kept) > 0)
    if len(kept):
        assert (thin.points >= kept.min(axis=0) - 1e-3).all()
        assert (thin.points <= kept.max(axis=0) + 1e-3).all()


def test_the_voxel_is_no_larger_than_needed() -> None:
    """What hurries through the passes must not thin a surface far below what is allowed."""
    u, v = np.meshgrid(np.linspace(-1, 1, 400), np.linspace(-1, 1, 300))
    surface = np.stack([u, v, 2 + 0.2 * np.sin(3 * u)], axis=-1)
    thin = thin_cloud(of(surface), min_range=0.1, max_range=20.0, voxel=0.002, max_points=10_000)
    assert 5_000 < len(thin.points) <= 10_000


def test_regular_cells_do_not_share_their_slots() -> None:
    """A stride of many powers of two: with a weak hash this walks through the table, for minutes."""
    stride = 2.0**12 * 1e-4
    points = np.stack(
        [np.arange(60_000) % 300 * stride, np.arange(60_000) // 300 * stride, np.full(60_000, 0.5)], axis=1
    )
    started = time.process_time()
    thin = thin_cloud(of(points), min_range=0.1, max_range=1000.0, voxel=1e-4, max_points=100_000)
    assert len(thin.points) == 60_000
    assert time.process_time() - started < 30.0  # a limit on hanging


def test_the_stage_passes_its_limit_on() -> None:
    stage = Reconstruct(ReconstructParams(cloud_max_points=64))
    assert len(stage.thin(of(SHAPES["on all octants"][:, :] / 100)).points) <= 64


def test_no_end_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match=r"max_range: expected .* finite, got .* and inf"):
        thin_cloud(of(np.ones((3, 3))), min_range=0.0, max_range=np.inf, voxel=0.1, max_points=100)
