"""Boards before a simulated rig: where their points fall, and pictures of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.board_kinds import APRILGRID, CHARUCO, CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.simulate.rig import Pose, Rig, pixel_directions, project, rotation_about
from uw_recon_ros.types import ByteImage, CameraModel, FloatImage, Mask, Matrix

_PX = 52  # of a drawing, for a square: markers of 3/4 and of 1/1.3 of it are whole pixels
_SUPER = 3  # rays a pixel, each way
_WHITE, _BLACK, _WALL = 200.0, 35.0, 95.0
_MARGIN = 1.0  # of white round a board, squares
_CIRCLE = 0.3  # radius, squares

#: Origins and unit directions, (N, 3) each, of rays that pixels (N, 2) look along, in the camera's frame.
Look = Callable[[Matrix], tuple[Matrix, Matrix]]


@dataclass(frozen=True, eq=False)
class Shot:
    """A board held before the rig.

    Parameters
    ----------
    pose : Pose
        x_left = rotation x_board + position, m.
    left, right : (H, W) uint8
    """

    pose: Pose
    left: ByteImage
    right: ByteImage


def hold_boards(
    rig: Rig, board: Board, count: int, seed: int, *, tilt_rad: float = 0.4,
    distances_m: tuple[float, float] = (0.6, 2.0),
) -> list[Pose]:  # fmt: skip
    """Hold a board at drawn places that both cameras see whole.

    Parameters
    ----------
    rig : Rig
    board : Board
    count, seed : int
    tilt_rad : float
        Standard deviation of the turns about the board's two axes, rad.
    distances_m : (nearest, farthest)

    Raises
    ------
    ValueError
        The board does not fit into both images at these distances.
    """
    rng, found = np.random.default_rng([seed, 11]), list[Pose]()
    for _ in range(200 * count):
        pose = _drawn_pose(rig, board, rng, tilt_rad, distances_m)
        if all(
            _inside(pixels, camera) for pixels, camera in zip(seen_points(rig, board, pose), _cameras(rig), strict=True)
        ):
            found.append(pose)
        if len(found) == count:
            return found
    raise ValueError(f"{board}: expected to fit into both images from {distances_m[0]:g} to {distances_m[1]:g} m")


def _drawn_pose(
    rig: Rig, board: Board, rng: np.random.Generator, tilt_rad: float, distances_m: tuple[float, float]
) -> Pose:
    camera = rig.calibration.left
    turn = np.array([*(tilt_rad * rng.standard_normal(2)), 0.2 * rng.standard_normal()])
    rotation = rotation_about(turn)
    distance = rng.uniform(*distances_m)
    u, v = rng.uniform(0.1, 0.9, 2) * (camera.width, camera.height)
    middle = distance * np.linalg.solve(camera.k, np.array([u, v, 1.0])) + rig.right_center / 2
    return Pose(rotation, middle - rotation @ board.points().mean(axis=0))


def _cameras(rig: Rig) -> tuple[CameraModel, CameraModel]:
    return rig.calibration.left, rig.calibration.right


def _inside(pixels: Matrix, camera: CameraModel, margin: float = 4.0) -> bool:
    high = np.array([camera.width, camera.height]) - 1 - margin
    return bool(np.isfinite(pixels).all() and (pixels >= margin).all() and (pixels <= high).all())


def seen_points(rig: Rig, board: Board, pose: Pose) -> tuple[Matrix, Matrix]:
    """Exact pixels (N, 2) of a board's points in the left and the right camera, without a port; NaN behind them."""
    left = board.points() @ pose.rotation.T + pose.position
    right = (left - rig.right_center) @ rig.right_from_left.T
    both = (np.stack(project(p, camera), axis=1) for p, camera in zip((left, right), _cameras(rig), strict=True))
    first, second = both
    return first, second


def photograph(
    rig: Rig, board: Board, poses: list[Pose], seed: int, *, noise: float = 2.0, blur_px: float = 0.6,
    smear_px: int = 0, looks: tuple[Look, Look] | None = None,
) -> Iterator[Shot]:  # fmt: skip
    """Take pictures of a board.

    Parameters
    ----------
    rig : Rig
    board : Board
    poses : list of Pose
    seed : int
    noise : float
        Standard deviation, grey values.
    blur_px : float
        Of lens and pixel, standard deviation, px.
    smear_px : int
        Length of a smear along rows by motion, px; 0: none.
    looks : two of Look or None
        Where pixels look, e.g. through ports; None: as the cameras' calibration says.
    """
    rng, drawing = np.random.default_rng([seed, 12]), draw_board(board)
    turns = np.eye(3), rig.right_from_left
    centres = np.zeros(3), rig.right_center
    rays = [_fine_rays(camera, look) for camera, look in zip(_cameras(rig), looks or (None, None), strict=True)]
    for pose in poses:
        pictures = []
        for (origins, directions), turn, centre, camera in zip(rays, turns, centres, _cameras(rig), strict=True):
            seen_from = (origins @ turn + centre).astype(np.float32), directions @ turn.astype(np.float32)
            light = _light(board, drawing, pose, seen_from, camera)
            pictures.append(_taken(light, rng, noise, blur_px, smear_px))
        yield Shot(pose, pictures[0], pictures[1])


def _fine_rays(camera: CameraModel, look: Look | None) -> tuple[FloatImage, FloatImage]:
    """Rays of all parts of all pixels, in the camera's frame."""
    steps = (np.arange(_SUPER) - (_SUPER - 1) / 2) / _SUPER
    u = (np.arange(camera.width)[:, None] + steps).ravel()
    v = (np.arange(camera.height)[:, None] + steps).ravel()
    if look is not None:
        origins, ahead = look(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
        return origins.astype(np.float32), ahead.astype(np.float32)
    coarse = pixel_directions(camera).astype(np.float32)
    grid = np.stack(np.meshgrid(u, v), axis=-1).astype(np.float32)
    fine = cv2.remap(coarse, grid[..., 0], grid[..., 1], cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    directions = np.asarray(fine, np.float32).reshape(-1, 3)
    return np.zeros((1, 3), np.float32), directions


def _light(
    board: Board, drawing: FloatImage, pose: Pose, rays: tuple[FloatImage, FloatImage], camera: CameraModel
) -> FloatImage:
    """Mean grey value over the parts of every pixel, (H, W)."""
    to_board = pose.rotation.astype(np.float32)
    origins, directions = (rays[0] - pose.position.astype(np.float32)) @ to_board, rays[1] @ to_board
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = -origins[:, 2] / directions[:, 2]
        x, y = (origins[:, k] + reach * directions[:, k] for k in (0, 1))
    shape, start = (camera.height * _SUPER, camera.width * _SUPER), _drawing_origin(board)
    sides = [
        np.where(reach > 0, (side / np.float32(board.square_m) + np.float32(first)) * np.float32(_PX) - np.float32(0.5),
                 np.float32(-1e4)).clip(-1e4, 1e4).reshape(shape)
        for side, first in ((x, start[0]), (y, start[1]))
    ]  # fmt: skip
    seen = cv2.remap(drawing, sides[0], sides[1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=_WALL)
    mean = cv2.resize(seen, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    return np.asarray(mean, np.float32)


def _taken(light: FloatImage, rng: np.random.Generator, noise: float, blur_px: float, smear_px: int) -> ByteImage:
    if smear_px:
        light = np.asarray(cv2.blur(light, (smear_px, 1)), np.float32)
    if blur_px > 0:
        light = np.asarray(cv2.GaussianBlur(light, (0, 0), blur_px), np.float32)
    return np.clip(np.rint(light + noise * rng.standard_normal(light.shape, dtype=np.float32)), 0, 255).astype(np.uint8)


def _drawing_origin(board: Board) -> Matrix:
    """Where the board's first point is in its drawing, squares."""
    if board.kind in (CHECKERBOARD, CHARUCO):
        return np.full(2, _MARGIN + 1.0)
    if board.kind == APRILGRID:
        return np.full(2, _MARGIN + _gap(board))
    return np.full(2, _MARGIN + 0.5)


def draw_board(board: Board, square_px: int = _PX) -> FloatImage:
    """The board as printed, (H, W) float32 grey values, a square `square_px` wide; white margin included.

    An AprilGrid has black squares between its tags, as kalibr prints them; its tags' rows are counted downwards here.
    """
    if board.kind == CHECKERBOARD:
        return _checkers(board.columns + 1, board.rows + 1, square_px)
    if board.kind == CHARUCO:
        return _charuco(board, square_px)
    return _tags(board, square_px) if board.kind == APRILGRID else _circles(board, square_px)


def _sheet(columns: float, rows: float, px: int) -> FloatImage:
    return np.full((round((rows + 2 * _MARGIN) * px), round((columns + 2 * _MARGIN) * px)), _WHITE, np.float32)


def _square(sheet: FloatImage, column: float, row: float, side: float, px: int) -> None:
    top, left = round((row + _MARGIN) * px), round((column + _MARGIN) * px)
    sheet[top : top + round(side * px), left : left + round(side * px)] = _BLACK


def _checkers(columns: int, rows: int, px: int) -> FloatImage:
    sheet = _sheet(columns, rows, px)
    for row in range(rows):
        for column in range(row % 2, columns, 2):
            _square(sheet, column, row, 1.0, px)
    return sheet


def _charuco(board: Board, px: int) -> FloatImage:
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    size, sides = (board.columns, board.rows), (board.square_m, board.marker_side_m)
    if hasattr(cv2.aruco, "CharucoBoard_create"):  # before OpenCV 4.7; its first square is white where rows are even
        draw = cv2.aruco.CharucoBoard_create(*size, *sides, dictionary).draw
    else:
        draw = cv2.aruco.CharucoBoard(size, *sides, dictionary).generateImage
    inner = draw((board.columns * px, board.rows * px), marginSize=0, borderBits=1)
    return _framed(np.asarray(inner) > 127, board.columns, board.rows, px)


def _framed(white: Mask | NDArray[np.bool_], columns: float, rows: float, px: int) -> FloatImage:
    sheet, edge = _sheet(columns, rows, px), round(_MARGIN * px)
    sheet[edge : edge + white.shape[0], edge : edge + white.shape[1]] = np.where(white, _WHITE, _BLACK)
    return sheet


def _gap(board: Board) -> float:
    """Between tags, squares."""
    return 1.0 - board.marker_side_m / board.square_m


def _tags(board: Board, px: int) -> FloatImage:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    aruco: Any = cv2.aruco
    draw = getattr(aruco, "generateImageMarker", None) or aruco.drawMarker  # before OpenCV 4.7
    gap, side = _gap(board), round(board.marker_side_m / board.square_m * px)
    sheet = _sheet(board.columns + gap, board.rows + gap, px)
    for row in range(board.rows + 1):
        for column in range(board.columns + 1):
            _square(sheet, column, row, gap, px)
    for number in range(board.rows * board.columns):
        row, column = divmod(number, board.columns)
        tag = draw(dictionary, number, side, borderBits=2)
        top, left = (round((at + gap + _MARGIN) * px) for at in (row, column))
        sheet[top : top + side, left : left + side] = np.where(tag > 127, _WHITE, _BLACK)
    return sheet


def _circles(board: Board, px: int) -> FloatImage:
    places = board.points()[:, :2] / board.square_m
    columns, rows = np.ptp(places, axis=0) + 1
    sheet = _sheet(columns, rows, px)
    middle = (places + _drawing_origin(board)) * px - 0.5
    v, u = np.mgrid[: sheet.shape[0], : sheet.shape[1]]
    for x, y in middle:
        sheet[np.hypot(u - x, v - y) < _CIRCLE * px] = _BLACK
    return sheet
