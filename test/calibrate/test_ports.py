"""Ports found from boards that a tracer of its own shows through panes."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from helpers.calibration_scenes import rig_of, sightings, truth_of

from uw_recon_ros.board_kinds import CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.depth_error import depth_sigmas
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.fit import Fit
from uw_recon_ros.calibrate.fit import solve as solve_rig
from uw_recon_ros.calibrate.ports import AirRig, PortGlass, PortRig, port_findings, solve_ports
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code, Severity
from uw_recon_ros.simulate.boards import hold_boards
from uw_recon_ros.simulate.ports import FlatPane, Port, look_through, pixels_of
from uw_recon_ros.types import Matrix

BOARD, AIR_BOARD = Board(CHECKERBOARD, 5, 4, 0.07), Board(CHECKERBOARD, 9, 6, 0.04)
TOLD = PortGlass(0.006, 1.49, 1.342)
SIZE = (640, 480)
LEANS = (0.02, -0.01, -0.015, 0.01)


def pane(distance_m: float, lean: tuple[float, float]) -> FlatPane:
    normal = np.array([*lean, 1.0])
    return FlatPane(distance_m, TOLD.thickness_m, TOLD.glass, TOLD.water, normal / np.linalg.norm(normal))


def panes(distance_m: float) -> tuple[Port, Port]:
    return pane(distance_m, LEANS[:2]), pane(distance_m, LEANS[2:])


@cache
def in_air(seed: int) -> AirRig:
    fit = solve_rig(sightings(rig_of(seed), 25, seed, noise_px=0.15), AIR_BOARD, SIZE)
    return AirRig(fit.bundle.numbers, fit.bundle.covariance, fit.bundle.noise_px, SIZE)


@cache
def solved(seed: int, distance_m: float) -> Fit:
    return solve_ports(through(seed, distance_m), BOARD, in_air(seed), TOLD)


@cache
def through(seed: int, distance_m: float) -> tuple[SeenPair, ...]:
    """Boards whole in both views behind panes."""
    rig, rng, pairs = rig_of(seed), np.random.default_rng([seed, 7]), []
    for k, pose in enumerate(hold_boards(rig, Board(CHECKERBOARD, 5, 4, 0.11), 10, seed, distances_m=(0.9, 1.6))):
        points = BOARD.points() @ pose.rotation.T + pose.position
        both = pixels_of(rig, points, panes(distance_m))
        seen = (Sighting(np.arange(20), px + 0.15 * rng.standard_normal(px.shape), 1.5, 40.0) for px in both)
        pairs.append(SeenPair(f"{k:02}", *seen))
    return tuple(pairs)


def misses(seed: int, distance_m: float) -> Matrix:
    bundle = solved(seed, distance_m).bundle
    true = np.array([distance_m, *LEANS])
    return np.asarray((bundle.numbers[24:] - true) / np.sqrt(np.diag(bundle.covariance)[24:]))


@pytest.mark.parametrize(("seed", "distance_m"), [(1, 0.02), (2, 0.06)])
def test_distance_and_normals_within_what_is_stated(seed: int, distance_m: float) -> None:
    fit = solved(seed, distance_m)
    assert np.abs(misses(seed, distance_m)).max() < 3.5
    assert np.sqrt(fit.bundle.covariance[24, 24]) < 0.008
    assert fit.bundle.noise_px == pytest.approx(0.15, rel=0.15)
    told = port_findings(fit.bundle, in_air(seed))
    assert [f.severity for f in told] == [Severity.OK]
    assert f"{1000 * fit.bundle.numbers[24]:.1f} ±" in told[0].text


def test_depth_through_the_ports_found() -> None:
    """Points in water by the simulator's tracer, located with what was found; sigma holds."""
    seed, distance_m = 2, 0.06
    fit, rig = solved(seed, distance_m), rig_of(seed)
    found = PortRig(fit.bundle.numbers, TOLD, SIZE)
    places = np.array([[200.0, 120.0], [420.0, 300.0], [330.0, 240.0]])
    origins, ahead = look_through(rig.calibration.left, panes(distance_m)[0])(places)
    for range_m in (0.7, 2.0):
        points = origins + ((range_m - origins[:, 2]) / ahead[:, 2])[:, None] * ahead
        located = found.located(*pixels_of(rig, points, panes(distance_m)))
        assert located[:, 2] / range_m == pytest.approx(1.0, abs=0.01)
        _, sigmas = depth_sigmas(found, fit.bundle.covariance, range_m)
        assert 1e-4 < np.median(sigmas) < 0.01
        assert np.abs(located[:, 2] / range_m - 1).max() < 4 * sigmas.max()


def test_without_a_port_depth_would_be_a_quarter_short() -> None:
    pairs, rig = through(1, 0.02), RigNumbers(truth_of(rig_of(1)), SIZE)
    short = [np.median(rig.located(p.left.pixels, p.right.pixels)[:, 2]) for p in pairs]
    found = PortRig(solved(1, 0.02).bundle.numbers, TOLD, SIZE)
    true = [np.median(found.located(p.left.pixels, p.right.pixels)[:, 2]) for p in pairs]
    assert 0.65 < np.median(np.array(short) / true) < 0.8


def test_a_pair_that_does_not_fit_is_named() -> None:
    pairs = list(through(1, 0.02))
    pairs[3] = SeenPair("03", pairs[3].left, pairs[4].right)
    fit = solve_ports(pairs, BOARD, in_air(1), TOLD)
    assert [out.name for out in fit.left_out] == ["03"]


def test_pictures_in_air_show_no_port() -> None:
    with pytest.raises(CalibrationError) as caught:
        solve_ports(sightings(rig_of(1), 5, 5, noise_px=0.15), AIR_BOARD, in_air(1), TOLD)
    assert caught.value.code == Code.CALIBRATE_PORT


def test_other_indices_are_refused() -> None:
    with pytest.raises(CalibrationError) as caught:
        solve_ports(through(1, 0.02), BOARD, in_air(1), PortGlass(0.006, 1.49, 1.2))
    assert caught.value.code == Code.CALIBRATE_PORT
