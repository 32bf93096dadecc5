"""Sessions of a simulated board before a simulated rig: points with noise, and pictures in folders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from uw_recon_ros.board_kinds import CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.optics import EXTRINSIC, NAMES, SIDES
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.files.images import write_image
from uw_recon_ros.simulate.boards import Shot, hold_boards, photograph, seen_points
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.rig import Rig, make_rig
from uw_recon_ros.types import Matrix

BOARD = Board(CHECKERBOARD, 9, 6, 0.04)
NEAR_M = (0.6, 1.1)
LARGE = {"width": 1280, "height": 960, "fov_deg": 65.24}  # f = 1000 px


def rig_of(seed: int, **params: object) -> Rig:
    return make_rig(SimulateParams.from_mapping({"seed": seed, "distance_m": 1.0, **params}))


def sightings(rig: Rig, count: int, seed: int, *, noise_px: float = 0.3, tilt_rad: float = 0.4) -> list[SeenPair]:
    rng = np.random.default_rng([seed, 99])
    poses = hold_boards(rig, BOARD, count, seed, tilt_rad=tilt_rad)
    return [_pair(f"{k:03}", rng, noise_px, *seen_points(rig, BOARD, pose)) for k, pose in enumerate(poses)]


def erring_alike(pairs: list[SeenPair], rms_px: float, seed: int) -> list[SeenPair]:
    """Pairs whose points err smoothly over each view of the board: polynomials up to the third power."""
    rng, sides = np.random.default_rng([seed, 98]), BOARD.points()[:, :2]
    x, y = (2 * side / side.max() - 1 for side in sides.T)
    shapes = np.stack([x**i * y**j for i in range(4) for j in range(4 - i)], axis=1)
    shapes /= np.sqrt((shapes**2).mean(axis=0) * shapes.shape[1])

    def moved(seen: Sighting) -> Sighting:
        return replace(seen, pixels=seen.pixels + rms_px * shapes @ rng.standard_normal((shapes.shape[1], 2)))

    return [SeenPair(pair.name, moved(pair.left), moved(pair.right)) for pair in pairs]


def _pair(name: str, rng: np.random.Generator, noise_px: float, left: Matrix, right: Matrix) -> SeenPair:
    numbers = np.arange(len(left))
    seen = (Sighting(numbers, px + noise_px * rng.standard_normal(px.shape), 1.5, 40.0) for px in (left, right))
    return SeenPair(name, *seen)


def truth_of(rig: Rig) -> Matrix:
    """The rig's numbers as `calibrate.optics` counts them."""
    import cv2

    numbers = np.zeros(len(NAMES))
    for side, camera in zip(SIDES, (rig.calibration.left, rig.calibration.right), strict=True):
        k = camera.k
        numbers[side] = [k[0, 0], k[1, 1], k[0, 2], k[1, 2], *camera.d]
    turn = cv2.Rodrigues(rig.right_from_left)[0].ravel()
    numbers[EXTRINSIC] = [*turn, *(-rig.right_from_left @ rig.right_center)]
    return numbers


def depth_misses(found: RigNumbers, rig: Rig, range_m: float) -> Matrix:
    """Relative errors of depth over what both true cameras see at a range."""
    true = RigNumbers(truth_of(rig), found.size)
    points, left, right = true.common_view(range_m)
    return np.asarray(found.located(left, right)[:, 2] / points[:, 2] - 1)


def write_stills(folder: Path, shots: list[Shot]) -> None:
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True, exist_ok=True)
    for k, shot in enumerate(shots, 1):
        write_image(folder / "left" / f"{k:02}.png", shot.left)
        write_image(folder / "right" / f"{k:02}.png", shot.right)


def small_session(count: int, seed: int = 1, board: Board = BOARD) -> tuple[Rig, list[Shot]]:
    rig = rig_of(1)
    return rig, list(photograph(rig, board, hold_boards(rig, board, count, seed, distances_m=NEAR_M), seed))


def smeared(rig: Rig, board: Board, seed: int, length_px: int) -> Shot:
    return next(photograph(rig, board, hold_boards(rig, board, 1, seed, distances_m=NEAR_M), seed, smear_px=length_px))


def of_two_moments(one: Shot, other: Shot) -> Shot:
    return replace(one, right=other.right)
