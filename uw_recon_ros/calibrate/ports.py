"""Flat ports found from a board in water, before a rig whose calibration in air is known.

Told are the pane's thickness and the indices; found are the distance, common to both cameras, and where each pane
faces. The rig's own numbers move too, as far as their covariance in air lets them, so that what is not known of them is
in what is not known of the ports. Source: Treibitz, Schechner, Kunz, Singh: Flat refractive geometry (2012), section 5;
Agrawal, Ramalingam, Taguchi, Chari: A theory of multi-layer flat refractive geometry (2012).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import Bundle, Prior, Project, SeenPair, adjust
from uw_recon_ros.calibrate.fit import Fit, LeftOut, enough, ordered_alike, without_outlying
from uw_recon_ros.calibrate.guess import guess_pose
from uw_recon_ros.calibrate.optics import EXTRINSIC, NAMES, SIDES, intrinsic_matrix
from uw_recon_ros.calibrate.rig import RigNumbers, at_range, inside
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.rectify.port import FlatPort, panes_of
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, undistorted
from uw_recon_ros.types import FlatPorts, Mask, Matrix

#: After a rig's own numbers: m, and by how much each normal leans to the right and down, tangents.
PORT_NAMES = ("port_distance", "left_lean_x", "left_lean_y", "right_lean_x", "right_lean_y")
ALL_NAMES = (*NAMES, *PORT_NAMES)
_RIG = len(NAMES)
_LEAN = (slice(_RIG + 1, _RIG + 3), slice(_RIG + 3, _RIG + 5))
_START_M = 0.02
_STEP = 1e-6  # of slopes by differences: m, rad, tangents
_MUCH_WORSE = 2.0  # points miss by so many times more than in air: no flat port, or other indices
_FAR_OFF = 5.0  # times the median error, with a port that is only guessed
_IMPOSSIBLE = 3.0  # sigmas under 0 that a distance may be found at


@dataclass(frozen=True, eq=False)
class AirRig:
    """A rig calibrated in air.

    Parameters
    ----------
    numbers : (24,) float64
        See `calibrate.optics`.
    covariance : (24, 24) float64
    noise_px : float
        Standard deviation of a coordinate, by its fit.
    size : (width, height)
        px.
    """

    numbers: Matrix
    covariance: Matrix
    noise_px: float
    size: tuple[int, int]


@dataclass(frozen=True)
class PortGlass:
    """What is told of the ports: m, and refractive indices."""

    thickness_m: float = 0.006
    glass: float = 1.49
    water: float = 1.333


@dataclass(frozen=True, eq=False)
class PortRig:
    """A rig behind flat ports, by its numbers.

    Parameters
    ----------
    numbers : (29,) float64
        In the order of `ALL_NAMES`.
    told : PortGlass
    size : (width, height)
        px.
    """

    numbers: Matrix
    told: PortGlass
    size: tuple[int, int]

    @property
    def ports(self) -> FlatPorts:
        """What stands before the cameras."""
        left, right = (_normal(self.numbers[part]) for part in _LEAN)
        return FlatPorts(
            max(float(self.numbers[_RIG]), 0.0), self.told.thickness_m, self.told.glass, self.told.water, left, right
        )

    @property
    def in_air(self) -> RigNumbers:
        """The cameras themselves."""
        return RigNumbers(self.numbers[:_RIG], self.size)

    def moved(self, by: Matrix) -> PortRig:
        """The rig of numbers that differ by (29,)."""
        return replace(self, numbers=self.numbers + by)

    def common_view(self, range_m: float) -> tuple[Matrix, Matrix, Matrix]:
        """As `RigNumbers.common_view`."""
        k = self.in_air.calibration.left.k @ np.diag([self.told.water, self.told.water, 1.0])
        points, nowhere = at_range(k, self.size, range_m), np.zeros(6)
        left, right = (_pixels(self.numbers, nowhere, points, side, self.told) for side in (0, 1))
        seen = inside(left, self.size) & inside(right, self.size)
        return points[seen], left[seen], right[seen]

    def located(self, left: Matrix, right: Matrix) -> Matrix:
        """Points (N, 3) m in the left camera's frame where the traced rays of raw pixels come nearest to each other."""
        calibration, rays = self.in_air.calibration, []
        for camera, pixels, pane in zip(
            (calibration.left, calibration.right), (left, right), panes_of(self.ports), strict=True
        ):
            rays.append(pane.into_water(undistorted(RectifiedCamera.of_camera(camera), pixels)))
        turn = np.asarray(cv2.Rodrigues(self.numbers[EXTRINSIC][:3])[0], np.float64)
        starts, ahead = (rays[1][0] - self.numbers[EXTRINSIC][3:]) @ turn, rays[1][1] @ turn
        return _nearest(*rays[0], starts, ahead)


def _nearest(start: Matrix, ahead: Matrix, other: Matrix, there: Matrix) -> Matrix:
    """On rays (N, 3) the points nearest to other rays."""
    one, two = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (ahead, there))
    gap, cosine = other - start, np.sum(one * two, axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = (np.sum(gap * one, axis=1) - cosine * np.sum(gap * two, axis=1)) / (1 - cosine**2)
    points: Matrix = start + reach[:, None] * one
    return points


def _normal(lean: Matrix) -> tuple[float, float, float]:
    x, y, z = np.array([*lean, 1.0]) / np.sqrt(1 + lean @ lean)
    return float(x), float(y), float(z)


def _places(numbers: Matrix, pose: Matrix, points: Matrix, side: int) -> Matrix:
    """Board points in a camera's frame, (N, 3) m."""
    left = Rotation.from_rotvec(pose[:3]).apply(points) + pose[3:]
    if not side:
        return np.asarray(left, np.float64)
    return np.asarray(Rotation.from_rotvec(numbers[EXTRINSIC][:3]).apply(left) + numbers[EXTRINSIC][3:], np.float64)


def _rays(places: Matrix, port: Matrix, told: PortGlass) -> Matrix:
    """``(x, y, 1)`` in air of points in water, (N, 3); `port`: distance and lean."""
    pane = FlatPort(port[0], told.thickness_m, told.glass, told.water, _normal(port[1:]))
    rays: Matrix = np.c_[pane.into_air(places), np.ones(len(places))]
    return rays


def _imaged(rays: Matrix, camera: Matrix) -> tuple[Matrix, Matrix]:
    """Pixels (N, 2) and their slopes (2N, 15), by turn, move and the camera's numbers; NaN where nothing is seen."""
    known = np.isfinite(rays).all(axis=1)
    pixels, slopes = np.full((len(rays), 2), np.nan), np.full((2 * len(rays), 15), np.nan)
    if known.any():
        none = np.zeros(3)
        found = cv2.projectPoints(rays[known], none, none, intrinsic_matrix(camera), camera[4:].copy())
        pixels[known] = np.asarray(found[0], np.float64).reshape(-1, 2)
        slopes[np.repeat(known, 2)] = np.asarray(found[1], np.float64)[:, :15]
    return pixels, slopes


def _port_of(numbers: Matrix, side: int) -> Matrix:
    return np.array([numbers[_RIG], *numbers[_LEAN[side]]])


def _pixels(numbers: Matrix, pose: Matrix, points: Matrix, side: int, told: PortGlass) -> Matrix:
    """Raw pixels (N, 2) of board points in water; NaN where they are not seen."""
    rays = _rays(_places(numbers, pose, points, side), _port_of(numbers, side), told)
    return _imaged(rays, numbers[SIDES[side]])[0]


def _projection(side: int, told: PortGlass) -> Project:
    """Pixels of one camera behind its port, with slopes: of the lens exact, of the rays by differences."""
    port_columns = [_RIG, *range(*_LEAN[side].indices(len(ALL_NAMES)))]

    def project(numbers: Matrix, pose: Matrix, points: Matrix) -> tuple[Matrix, Matrix, Matrix]:
        places, port = _places(numbers, pose, points, side), _port_of(numbers, side)
        pixels, slopes = _imaged(_rays(places, port, told), numbers[SIDES[side]])
        by_ray = slopes[:, 3:5].reshape(-1, 2, 2)
        by_place = by_ray @ _differences(lambda x: _rays(places + x, port, told)[:, :2], 3)
        by_port = by_ray @ _differences(lambda x: _rays(places, port + x, told)[:, :2], 3)
        by_pose = by_place @ _differences(lambda x: _places(numbers, pose + x, points, side), 6)
        by_numbers = np.zeros((2 * len(points), len(numbers)))
        by_numbers[:, SIDES[side]] = slopes[:, 6:]
        by_numbers[:, port_columns] = by_port.reshape(-1, 3)
        if side:
            moves = _differences(lambda x: _places(_extrinsic_moved(numbers, x), pose, points, side), 6)
            by_numbers[:, EXTRINSIC] = (by_place @ moves).reshape(-1, 6)
        return pixels, by_numbers, by_pose.reshape(-1, 6)

    return project


def _extrinsic_moved(numbers: Matrix, by: Matrix) -> Matrix:
    moved: Matrix = numbers.copy()
    moved[EXTRINSIC] += by
    return moved


def _differences(value: Callable[[Matrix], Matrix], count: int) -> Matrix:
    """(N, m, count) slopes of (N, m) values by each of some numbers."""
    steps = _STEP * np.eye(count)
    slopes: Matrix = np.stack([(value(step) - value(-step)) / (2 * _STEP) for step in steps], axis=-1)
    return slopes


def solve_ports(pairs: Sequence[SeenPair], board: Board, air: AirRig, told: PortGlass) -> Fit:
    """Find the ports; pairs that do not agree with the others are left out, by name.

    Parameters
    ----------
    pairs : sequence of SeenPair
        Of the board in water.
    board : Board
    air : AirRig
    told : PortGlass

    Returns
    -------
    Fit
        Numbers and covariance are those of `ALL_NAMES`.

    Raises
    ------
    CalibrationError
        Fewer than four pairs, or no port explains them.
    """
    points, known = board.points(), np.diag(air.covariance) > 0
    kept = tuple(ordered_alike(pair, board) for pair in pairs)
    enough(kept, ())
    numbers = np.concatenate([air.numbers, [_START_M, 0.0, 0.0, 0.0, 0.0]])
    poses = np.array([_guess(air, pair, points, told) for pair in kept])
    free: Mask = np.concatenate([known, np.ones(len(PORT_NAMES), np.bool_)])
    project = (_projection(0, told), _projection(1, told))
    prior = _prior(air, known)

    def fitted(start: Matrix, places: Matrix, chosen: Sequence[SeenPair]) -> Bundle:
        return adjust(start, places, chosen, points, free, project=project, prior=prior)

    start = adjust(numbers, poses, kept, points, np.zeros(len(ALL_NAMES), np.bool_), project=project)
    kept, poses, wrong = _first_look(start, kept)
    try:
        bundle, kept, left_out = without_outlying(fitted(numbers, poses, kept), kept, fitted, wrong)
    except (np.linalg.LinAlgError, CalibrationError) as error:
        if getattr(error, "code", Code.CALIBRATE_UNSYNCHRONISED) != Code.CALIBRATE_UNSYNCHRONISED:
            raise
        raise _impossible("none that explains the pictures") from error
    distance, sigma = float(bundle.numbers[_RIG]), float(np.sqrt(bundle.covariance[_RIG, _RIG]))
    if not distance >= -_IMPOSSIBLE * sigma:
        raise _impossible(f"{1000 * distance:.1f} ± {1000 * sigma:.1f} mm")
    return Fit(bundle, kept, left_out)


def _first_look(start: Bundle, pairs: Sequence[SeenPair]) -> tuple[tuple[SeenPair, ...], Matrix, list[LeftOut]]:
    """Pairs whose two pictures cannot be of one board behind any port: they would pull the port away."""
    errors, usual = start.pair_rms_px, float(np.median(start.pair_rms_px))
    far = ~(errors <= _FAR_OFF * usual)
    wrong = [
        LeftOut(pair.name, f"points miss by {error:.1f} px before a port like others (others {usual:.1f})",
                Code.CALIBRATE_OUTLIER)
        for pair, error, out in zip(pairs, errors, far, strict=True) if out
    ]  # fmt: skip
    kept = tuple(pair for pair, out in zip(pairs, far, strict=True) if not out)
    enough(kept, wrong)
    return kept, start.poses[~far], wrong


def _guess(air: AirRig, pair: SeenPair, points: Matrix, told: PortGlass) -> Matrix:
    """Water behind a flat port makes images larger, by its index."""
    camera = air.numbers[SIDES[0]].copy()
    camera[:2] *= told.water
    return guess_pose(camera, pair.left, points)


def _prior(air: AirRig, known: Mask) -> Prior:
    information = np.zeros((len(ALL_NAMES), len(ALL_NAMES)))
    at = np.flatnonzero(known)
    covariance = air.covariance[np.ix_(known, known)]
    scale = 1 / np.sqrt(np.diag(covariance))
    inverse = np.linalg.pinv(scale[:, None] * covariance * scale, rcond=1e-12, hermitian=True)
    information[np.ix_(at, at)] = air.noise_px**2 * scale[:, None] * inverse * scale
    return Prior(np.concatenate([air.numbers, np.zeros(len(PORT_NAMES))]), information)


def _impossible(found: str) -> CalibrationError:
    return CalibrationError(
        f"port: expected a distance over 0, found {found}: were these pictures taken in water, through flat ports, "
        "with the rig of the calibration in air?",
        Code.CALIBRATE_PORT,
    )


def port_findings(bundle: Bundle, air: AirRig) -> tuple[Finding, ...]:
    """What was found, with how sure it is, and what speaks against it."""
    distance, *leans = bundle.numbers[_RIG:]
    sigmas = np.sqrt(np.diag(bundle.covariance)[_RIG:])
    text = (
        f"flat ports {1000 * distance:.1f} ± {1000 * sigmas[0]:.1f} mm before the cameras, turned by "
        f"{_degrees(leans[:2])} (left) and {_degrees(leans[2:])} degrees (right), ± {np.rad2deg(sigmas[1:].max()):.2f}"
    )
    found = [Finding(Code.CALIBRATE_PORT, text, Severity.OK)]
    if bundle.noise_px > _MUCH_WORSE * air.noise_px:
        text = f"behind the ports points miss by {bundle.noise_px:.2f} px a coordinate, in air by {air.noise_px:.2f}"
        advice = "are the ports flat, the indices and the thickness right, was the rig not touched in between?"
        found.append(Finding(Code.CALIBRATE_PORT, text, Severity.UNRELIABLE, advice))
    return tuple(found)


def _degrees(lean: Sequence[float]) -> str:
    return f"{np.rad2deg(np.arctan(np.linalg.norm(lean))):.2f}"
