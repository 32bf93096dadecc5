"""Rectification behind flat ports against a ray tracer that knows nothing of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from uw_recon_ros.findings import Code, Severity
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.port import FlatPort
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.ports import Dome, FlatPane, look_through, pixels_of
from uw_recon_ros.simulate.rig import Rig, make_rig
from uw_recon_ros.types import Matrix

PORT = {"port": "flat", "port_distance_mm": 10.0, "port_thickness_mm": 6.0}
WIDE = {"fov_deg": 75.0, "misalignment_deg": 1.0}


def seen_through(rig: Rig, pane: FlatPane, range_m: float, count: int = 12) -> tuple[Matrix, Matrix, Matrix]:
    """Points at a depth of the left camera, m, and where both cameras see them, px, by the simulator's tracer."""
    rng = np.random.default_rng(0)
    pixels = np.stack([rng.uniform(130, 600, count), rng.uniform(20, 460, count)], axis=1)
    origins, directions = look_through(rig.calibration.left, pane)(pixels)
    points = origins + ((range_m - origins[:, 2]) / directions[:, 2])[:, None] * directions
    left, right = pixels_of(rig, points, (pane, pane))
    assert left == pytest.approx(pixels, abs=1e-6)
    inside = (right > 0).all(axis=1) & (right[:, 0] < 639)
    return points[inside], left[inside], right[inside]


def errors(rig: Rig, params: RectifyParams, pane: FlatPane, range_m: float) -> tuple[Matrix, Matrix]:
    """Relative errors of depth and differences of rows, px."""
    points, left, right = seen_through(rig, pane, range_m)
    made = rectification_from_calibration(rig.calibration, params)
    rectified = made.left.rectified(left), made.right.rectified(right)
    depth = made.geometry.depth_from_disparity(rectified[0][:, 0] - rectified[1][:, 0])
    behind = made.left.port.meeting_point if params.port == "flat" else np.zeros(3)
    true = ((points - behind) @ made.left.r.T)[:, 2]
    return depth / true - 1, rectified[0][:, 1] - rectified[1][:, 1]


@pytest.mark.parametrize("water", [1.333, 1.342])
@pytest.mark.parametrize("range_m", [0.5, 1.0, 2.0, 3.0])
def test_depth_behind_a_flat_port(range_m: float, water: float) -> None:
    rig, pane = make_rig(SimulateParams(seed=3, **WIDE)), FlatPane(0.01, 0.006, water=water)
    depth, rows = errors(rig, RectifyParams(**PORT, water_index=water), pane, range_m)
    assert np.abs(depth).max() < 0.01
    assert np.abs(rows).max() < 0.3
    if range_m == 1.0:
        assert np.abs(depth).max() < 1e-4
        assert np.abs(rows).max() < 5e-3
    wrong, _ = errors(rig, RectifyParams(), pane, range_m)
    assert -0.55 < wrong.min() < wrong.max() < -0.24


def test_what_a_port_leaves_is_told() -> None:
    rig = make_rig(SimulateParams(seed=3, **WIDE))
    for distance, severity in ((10.0, Severity.OK), (80.0, Severity.WARN)):
        params = RectifyParams(**{**PORT, "port_distance_mm": distance})
        made = rectification_from_calibration(rig.calibration, params)
        told = next(f for f in made.quality.warnings if f.code == Code.RECTIFY_PORT)
        assert told.severity == severity
        assert "exact at 1 m" in told.text


def test_maps_and_points_agree() -> None:
    rig = make_rig(SimulateParams(seed=4, axis="vertical", **WIDE))
    made = rectification_from_calibration(rig.calibration, RectifyParams(**PORT))
    assert made.left_map is not None
    places = np.array([[100.0, 80.0], [200.0, 150.0], [50.0, 200.0]])
    raw = made.left.raw(places)
    assert made.left_map[places[:, 1].astype(int), places[:, 0].astype(int)] == pytest.approx(raw, abs=1e-2)
    assert made.left.rectified(raw) == pytest.approx(places, abs=1e-6)


def test_a_port_of_nothing_is_none() -> None:
    port = FlatPort(0.02, 0.005, 1.0, 1.0)
    points = np.array([[0.1, 0.2, 1.0], [0.0, 0.0, 0.5], [-0.4, 0.1, 0.7]])
    assert port.into_air(points) == pytest.approx(points[:, :2] / points[:, 2:], abs=1e-12)
    assert port.meeting_m == pytest.approx(0.0, abs=1e-12)


def test_in_and_out_are_inverse() -> None:
    port = FlatPort(0.03, 0.01, 1.49, 1.342, (np.sin(0.1), 0.0, np.cos(0.1)))
    rays = np.random.default_rng(1).uniform(-0.7, 0.7, (50, 2))
    origins, directions = port.into_water(rays)
    assert port.into_air(origins + 1.3 * directions) == pytest.approx(rays, abs=1e-8)
    pane = FlatPane(0.03, 0.01, 1.49, 1.342, np.array(port.normal))
    solid = np.c_[rays, np.ones(50)]
    traced = pane.into_water(solid / np.linalg.norm(solid, axis=1, keepdims=True))
    assert traced[0] == pytest.approx(origins, abs=1e-12)
    assert np.cross(traced[1], directions) == pytest.approx(0.0, abs=1e-12)


def test_a_centred_dome_bends_nothing() -> None:
    rays = np.array([[0.3, 0.2, 1.0], [0.0, 0.0, 1.0], [-0.5, 0.1, 1.0]])
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    centred, moved = Dome(0.05, 0.005), Dome(0.05, 0.005, np.array([0.0, 0.0, 0.005]))
    assert centred.into_water(rays)[1] == pytest.approx(rays, abs=1e-12)
    assert np.abs(moved.into_water(rays)[1] - rays).max() > 1e-3


def test_replacing_keeps_the_port() -> None:
    rig = make_rig(SimulateParams(seed=3, **WIDE))
    made = rectification_from_calibration(rig.calibration, RectifyParams(**PORT))
    assert replace(made.left.moved(5, 7), range_m=2.0).port == made.left.port
    assert not made.left.identity
