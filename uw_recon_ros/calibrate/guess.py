"""A guess to start from, so that no solver is left to find a focal length on flat views by itself."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.detect import Sighting
from uw_recon_ros.calibrate.optics import EXTRINSIC, NAMES, OF_CAMERA, SIDES, intrinsic_matrix, project_camera
from uw_recon_ros.lenses import EQUIDISTANT, PLUMB_BOB
from uw_recon_ros.types import Mask, Matrix

_FOCAL_LENGTHS = np.geomspace(0.4, 4.0, 24)  # over the longer side of the image
_MOST_VIEWS = 10
_WIDEST = np.deg2rad(80.0)  # off the axis: a pinhole camera sees hardly farther
_LEAST_POINTS = 4
_BEFORE: Matrix = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def guess_rig(
    pairs: Sequence[SeenPair], points: Matrix, size: tuple[int, int], lens: str = PLUMB_BOB
) -> tuple[Matrix, Matrix]:
    """Numbers and poses to start from.

    Parameters
    ----------
    pairs : sequence of SeenPair
    points : (N, 3) float64
        Of the board, m.
    size : (width, height)
        Of both images, px.
    lens : {'plumb_bob', 'equidistant'}

    Returns
    -------
    (24,), (P, 6) float64
        See `Bundle`: no distortion, the principal point in the middle.
    """
    numbers = np.zeros(len(NAMES))
    for side, sightings in zip(SIDES, ([p.left for p in pairs], [p.right for p in pairs]), strict=True):
        numbers[side] = _camera(sightings, points, size, lens)
    lefts = [guess_pose(numbers[SIDES[0]], pair.left, points, lens) for pair in pairs]
    rights = [guess_pose(numbers[SIDES[1]], pair.right, points, lens) for pair in pairs]
    numbers[EXTRINSIC] = np.median(right_from_left(lefts, rights), axis=0)
    return numbers, np.array(lefts)


def _camera(sightings: Sequence[Sighting], points: Matrix, size: tuple[int, int], lens: str) -> Matrix:
    """The focal length of a scan that explains the views best."""
    views = sightings[:: max(len(sightings) // _MOST_VIEWS, 1)]
    candidates = [_ideal(share * max(size), size) for share in _FOCAL_LENGTHS]
    return min(candidates, key=lambda camera: float(np.mean([_miss(camera, view, points, lens) for view in views])))


def _ideal(focal: float, size: tuple[int, int]) -> Matrix:
    camera = np.zeros(OF_CAMERA)
    camera[:4] = focal, focal, (size[0] - 1) / 2, (size[1] - 1) / 2
    return camera


def _miss(camera: Matrix, sighting: Sighting, points: Matrix, lens: str) -> float:
    """Mean squared distance, over the board's size in the image: near views do not outvote the others."""
    pose = guess_pose(camera, sighting, points, lens)
    pixels, _ = project_camera(camera, pose, points[sighting.numbers], lens)
    return float(((pixels - sighting.pixels) ** 2).mean()) / sighting.spacing_px**2


def guess_pose(camera: Matrix, sighting: Sighting, points: Matrix, lens: str = PLUMB_BOB) -> Matrix:
    """Of a board before a camera, left camera from board: the better of a plane's two solutions, refined."""
    seen, k, pixels = points[sighting.numbers], intrinsic_matrix(camera), sighting.pixels
    if lens == EQUIDISTANT:
        pixels, ahead = _by_pinhole(camera, pixels)
        seen, pixels = seen[ahead], pixels[ahead]
    if len(seen) < _LEAST_POINTS:
        return np.array(_BEFORE)
    _, turns, moves, errors = cv2.solvePnPGeneric(seen, pixels, k, np.zeros(5), flags=cv2.SOLVEPNP_IPPE)
    if not len(turns):
        return np.array(_BEFORE)
    best = int(np.argmin(np.asarray(errors).ravel()))
    turn, move = cv2.solvePnPRefineLM(seen, pixels, k, np.zeros(5), turns[best], moves[best])
    return np.concatenate([np.asarray(turn).ravel(), np.asarray(move).ravel()])


def _by_pinhole(camera: Matrix, pixels: Matrix) -> tuple[Matrix, Mask]:
    """Where a pinhole camera of the same focal length would see what an equidistant one sees, and what it does see."""
    aside = (pixels - camera[2:4]) / camera[:2]
    angle = np.linalg.norm(aside, axis=1)
    ahead = angle < _WIDEST
    stretch = np.tan(np.where(ahead, angle, 0.0)) / np.maximum(angle, 1e-9)
    return camera[2:4] + camera[:2] * stretch[:, None] * aside, ahead


def right_from_left(lefts: Sequence[Matrix], rights: Sequence[Matrix]) -> Matrix:
    """(P, 6) rotation vector and translation that every pair tells, from the board's poses before both cameras."""
    found = []
    for left, right in zip(lefts, rights, strict=True):
        one, other = (cv2.Rodrigues(pose[:3])[0] for pose in (left, right))
        turn = other @ one.T
        found.append(np.concatenate([cv2.Rodrigues(turn)[0].ravel(), right[3:] - turn @ left[3:]]))
    return np.array(found)
