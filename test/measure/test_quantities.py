"""Lengths, heights and areas on surfaces of known truth."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.measure.quantities import fit_plane, measure_patch, measure_polyline, measure_to_plane, point_of
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix, StereoGeometry

GEOMETRY = StereoGeometry(600.0, 320.0, 320.0, 240.0, 0.12)
V, U = np.mgrid[:480, :640].astype(float)
FLOOR, FLOOR_M = np.array([0.1, -0.2, -1.0]) / np.linalg.norm([0.1, -0.2, -1.0]), 2.0
BAR = np.array([0.5, 0.0, -1.0]) / np.linalg.norm([0.5, 0.0, -1.0])


def on_plane(normal: Matrix, distance: float, geometry: StereoGeometry = GEOMETRY) -> Matrix:
    """Disparity of a plane ``normal x = -distance``."""
    rays = np.stack([U, V, np.ones_like(U)], axis=-1) @ np.linalg.inv(geometry.intrinsics_left).T
    return np.asarray(geometry.disparity_from_depth(-distance / (rays @ normal)), np.float64)


def frame_of(
    disparity: Matrix, noise_px: float = 0.2, seed: int = 0, geometry: StereoGeometry = GEOMETRY
) -> DisparityFrame:
    """With errors that neighbours share, as a matcher's are."""
    noise = cv2.GaussianBlur(np.random.default_rng(seed).standard_normal(disparity.shape), (0, 0), 2.5)
    noisy = disparity + noise_px * noise / noise.std()
    sigma = np.full(disparity.shape, max(noise_px, 0.01), np.float32)
    return DisparityFrame(0, np.zeros((480, 640, 3), np.uint8), noisy.astype(np.float32), sigma, geometry)


def bar_before_floor() -> Matrix:
    bar = (np.abs(V - 200) < 8) & (U > 200) & (U < 450)
    return np.where(bar, on_plane(BAR, 1.0), on_plane(FLOOR, FLOOR_M))


def true_point(u: float, v: float, disparity: Matrix) -> Matrix:
    return point_of(GEOMETRY, u, v, float(disparity[int(v), int(u)]))


@pytest.mark.parametrize("seed", range(4))
def test_a_length_from_silhouette_to_silhouette(seed: int) -> None:
    """Both clicks may fall just beside the bar, on a background that is a metre behind it."""
    true = np.linalg.norm(true_point(201, 200, on_plane(BAR, 1.0)) - true_point(449, 200, on_plane(BAR, 1.0)))
    for ends in ([(201.0, 200.0), (449.0, 200.0)], [(199.0, 200.0), (451.0, 200.0)]):
        made = measure_polyline(frame_of(bar_before_floor(), seed=seed), ends)
        assert made.value == pytest.approx(true, rel=0.02)
        assert made.quantity == "length"
        assert made.unit == "m"
        assert made.agreed > 0.9


def test_the_stated_sigma_is_the_spread() -> None:
    rng, misses = np.random.default_rng(1), []
    disparity = on_plane(FLOOR, FLOOR_M)
    true = np.linalg.norm(true_point(150, 300, disparity) - true_point(450, 350, disparity))
    for seed in range(60):
        clicks = np.array([[150.0, 300.0], [450.0, 350.0]]) + rng.standard_normal((2, 2))
        made = measure_polyline(frame_of(disparity, seed=seed), [tuple(click) for click in clicks], click_px=1.0)
        misses.append((made.value - true) / made.sigma)
    assert 0.6 < np.sqrt(np.mean(np.square(misses))) < 1.4


def test_a_polyline_is_the_sum_of_its_parts() -> None:
    frame, points = frame_of(on_plane(FLOOR, FLOOR_M), 0.0), [(100.0, 300.0), (300.0, 320.0), (500.0, 200.0)]
    parts = [measure_polyline(frame, points[:2]).value, measure_polyline(frame, points[1:]).value]
    made = measure_polyline(frame, points)
    assert made.quantity == "polyline"
    assert made.value == pytest.approx(sum(parts), rel=1e-3)


def test_height_above_the_bottom() -> None:
    true = FLOOR @ true_point(300, 200, on_plane(BAR, 1.0)) + FLOOR_M
    made = measure_to_plane(frame_of(bar_before_floor()), (300.0, 200.0))
    assert made.value == pytest.approx(true, abs=3 * made.sigma)
    assert made.sigma < 0.02
    corners = [(50.0, 260.0), (600.0, 260.0), (600.0, 470.0), (50.0, 470.0)]
    assert measure_to_plane(frame_of(bar_before_floor()), (300.0, 200.0), corners).value == pytest.approx(
        true, abs=0.02
    )


def test_area_of_a_flat_patch_is_flat() -> None:
    """Noise does not look like roughness."""
    disparity, corners = on_plane(FLOOR, FLOOR_M), [(100.0, 300.0), (500.0, 300.0), (500.0, 450.0), (100.0, 450.0)]
    p = [true_point(*corner, disparity) for corner in corners]
    true = sum(np.linalg.norm(np.cross(p[k] - p[0], p[k + 1] - p[0])) / 2 for k in (1, 2))
    area, rugosity = measure_patch(frame_of(disparity), corners)
    assert area.value == pytest.approx(true, rel=0.02)
    assert rugosity.value == pytest.approx(1.0, abs=0.02)
    assert area.unit == "m2"


def test_a_ridge_is_rough() -> None:
    """A tent of two planes at 45 degrees has sqrt(2) times the area below it."""
    x = np.abs(U - 320.0) / 600.0  # z = 1 + |x|, x = z (u - cx) / f
    area, rugosity = measure_patch(
        frame_of(72.0 * (1 - x), 0.02), [(200.0, 100.0), (440.0, 100.0), (440.0, 400.0), (200.0, 400.0)]
    )
    assert rugosity.value == pytest.approx(np.sqrt(2), rel=0.02)
    assert area.cell < 0.05


def test_the_calibration_has_its_part() -> None:
    frame = frame_of(on_plane(FLOOR, FLOOR_M))
    made = measure_polyline(frame, [(150.0, 300.0), (450.0, 350.0)], calibration=lambda depth: 0.01 * depth)
    assert made.sigma_calibration == pytest.approx(0.01 * made.depth * made.value)
    parts = np.hypot(np.hypot(made.sigma_disparity, made.sigma_click), made.sigma_calibration)
    assert made.sigma == pytest.approx(parts)
    assert np.isnan(measure_polyline(frame, [(150.0, 300.0), (450.0, 350.0)]).sigma_calibration)


def test_a_vertical_rig_measures_the_same() -> None:
    geometry = StereoGeometry(600.0, 240.0, 240.0, 320.0, 0.12, "vertical")
    frames = [frame_of(on_plane(FLOOR, FLOOR_M, g), 0.0, geometry=g) for g in (GEOMETRY, geometry)]
    lengths = [measure_polyline(f, [(150.0, 300.0), (450.0, 350.0)]).value for f in frames]
    heights = [measure_to_plane(f, (300.0, 200.0)).value for f in frames]
    assert lengths[0] == pytest.approx(lengths[1], rel=1e-3)
    assert heights == pytest.approx([0.0, 0.0], abs=1e-3)


def test_where_nothing_is_known_nothing_is_measured() -> None:
    disparity = on_plane(FLOOR, FLOOR_M)
    disparity[:, :300] = np.nan
    frame = frame_of(np.where(np.isnan(disparity), 0.0, disparity))
    frame.disparity[:, :300] = np.nan
    for action in (
        lambda: measure_polyline(frame, [(50.0, 200.0), (250.0, 200.0)]),
        lambda: measure_to_plane(frame, (100.0, 100.0)),
        lambda: measure_patch(frame, [(10.0, 10.0), (200.0, 10.0), (200.0, 200.0)]),
    ):
        with pytest.raises(EstimationError) as caught:
            action()
        assert caught.value.code == Code.MEASURE_NO_DEPTH


def test_no_plane_is_said() -> None:
    rough = 30 + 20 * np.random.default_rng(0).random((480, 640))
    with pytest.raises(EstimationError) as caught:
        fit_plane(frame_of(rough))
    assert caught.value.code == Code.MEASURE_NO_PLANE


@pytest.mark.parametrize("turn", range(4))
def test_an_outline_that_crosses_itself_is_refused(turn: int) -> None:
    square = [(100.0, 100.0), (300.0, 100.0), (300.0, 300.0), (100.0, 300.0)]
    frame = frame_of(on_plane(FLOOR, FLOOR_M))
    bow = [square[0], square[2], square[1], square[3]]
    with pytest.raises(EstimationError, match="crosses itself"):
        measure_patch(frame, bow[turn:] + bow[:turn])
    area, rugosity = measure_patch(frame, square[turn:] + square[:turn])
    assert area.value > 0
    assert rugosity.value >= 1


def test_an_end_at_an_edge_tells_the_other_surface() -> None:
    """Two pixels inside a bar before a floor the floor may be meant, ten pixels inside it may not."""
    disparity = bar_before_floor()
    edge, inside = ((202.0, 200.0), (300.0, 200.0)), ((215.0, 200.0), (300.0, 200.0))
    floor, bar = on_plane(FLOOR, FLOOR_M), on_plane(BAR, 1.0)
    by_floor = np.linalg.norm(true_point(202, 200, floor) - true_point(300, 200, bar))
    assert measure_polyline(frame_of(disparity, 0.05), edge).other == pytest.approx(by_floor, rel=0.02)
    assert np.isnan(measure_polyline(frame_of(disparity, 0.05), inside).other)
    assert np.isnan(measure_to_plane(frame_of(disparity), (300.0, 200.0)).other)


def test_no_plane_goes_through_two_surfaces_where_sigma_is_large() -> None:
    """A matcher that is unsure at an edge says so by a large sigma: no reason to take the middle of both sides."""
    frame = frame_of(np.where(U < 300, 40.0, 60.0), 0.02)
    frame.sigma[:, 290:310] = 10.0
    true = np.linalg.norm(point_of(GEOMETRY, 301, 200, 60.0) - point_of(GEOMETRY, 400, 200, 60.0))
    assert measure_polyline(frame, [(301.0, 200.0), (400.0, 200.0)]).value == pytest.approx(true, rel=0.02)


def test_a_line_that_ends_before_the_end_says_nothing_of_it() -> None:
    """A box stands over the last part of a floor that is straight from the other end."""
    floor = 40.0 + 0.0 * U
    disparity = np.where((U > 380) & (np.abs(V - 200) < 60), 50.0, floor)
    true = np.linalg.norm(point_of(GEOMETRY, 200, 200, 40.0) - point_of(GEOMETRY, 384, 200, 50.0))
    assert measure_polyline(frame_of(disparity, 0.05), [(200.0, 200.0), (384.0, 200.0)]).value == pytest.approx(
        true, rel=0.01
    )


@pytest.mark.parametrize("corner", [(0.0, 0.0), (639.0, 0.0), (0.0, 479.0), (639.0, 479.0)])
def test_an_end_in_the_image_s_corner(corner: tuple[float, float]) -> None:
    disparity = on_plane(FLOOR, FLOOR_M)
    true = np.linalg.norm(true_point(*corner, disparity) - true_point(320, 240, disparity))
    made = measure_polyline(frame_of(disparity, 0.01), [corner, (320.0, 240.0)])
    assert made.value == pytest.approx(true, rel=0.02)
