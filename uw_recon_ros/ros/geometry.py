"""A pair of ``CameraInfo`` -> rectified geometry; `uw_recon_ros.messages.cameras` tells what travels.

Zero at the places of the baseline, as uncalibrated drivers publish it, is read as an unknown baseline of a horizontal
rig.
"""

from __future__ import annotations

import math

import numpy as np
from sensor_msgs.msg import CameraInfo

from uw_recon_ros.calibration.judge import SAME_FOCAL, SAME_ROW_PX, Judgement, is_rotation, judge_baseline
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.types import Axis, Matrix, StereoGeometry, Window

_LARGEST_PX = 1e7  # what a focal length or a principal point may be


def geometry_from_infos(left: CameraInfo, right: CameraInfo) -> StereoGeometry:
    """Read what `messages.cameras.rectified_infos`, or any other rectification node, wrote.

    Raises
    ------
    CalibrationError
        The two are not a rectified pair; the text names the numbers.
    """
    if (left.width, left.height) != (right.width, right.height):
        raise CalibrationError(
            f"rectified camera_info: expected both views of one size, got {left.width}x{left.height} and "
            f"{right.width}x{right.height}"
        )
    for info in (left, right):
        window_from_info(info)
    p_left, p_right = _projection("left", left), _projection("right", right)
    _check_alike(p_left, p_right)
    axis, shift = _axis_and_shift(p_left, p_right)
    along, across = (0, 1) if axis == "horizontal" else (1, 0)
    if abs(p_left[across, 2] - p_right[across, 2]) > SAME_ROW_PX:
        raise CalibrationError(
            f"rectified camera_info: expected one principal point across the {axis} baseline in both views, "
            f"got {p_left[across, 2]:g} and {p_right[across, 2]:g} px"
        )
    if axis == "horizontal" and shift > 0:
        raise CalibrationError(f"rectified right camera_info: P[3]: expected < 0, got {shift:g} (swapped cameras?)")
    focal = float(p_left[along, along])
    unknown = math.isnan(shift) or shift == 0.0
    if not unknown:
        Judgement(judge_baseline(-shift / focal)).raise_refused()
    return StereoGeometry(
        focal_px=focal,
        cx_left=float(p_left[along, 2]),
        cx_right=float(p_right[along, 2]),
        cy=float(p_left[across, 2]),
        baseline_m=None if unknown else -shift / focal,
        axis=axis,
        baseline_sign=int(math.copysign(1.0, shift if math.isnan(shift) else -shift)) if shift else 1,
        focal_across_px=float(p_left[across, across]),
        rect_from_raw_left=_rotation(left),
    )


def _projection(side: str, info: CameraInfo) -> Matrix:
    p: Matrix = np.asarray(info.p, np.float64).reshape(3, 4)
    upright = p[0, 1] == 0 and p[1, 0] == 0 and p[2].tolist() == [0, 0, 1, 0]
    sound = upright and bool((np.abs(p[:2, :3]) <= _LARGEST_PX).all())  # NaN compares as false
    if not (sound and p[0, 0] > 0 and p[1, 1] > 0):
        raise CalibrationError(
            f"rectified {side} camera_info: expected P with focal lengths > 0, [fx 0 cx Tx; 0 fy cy Ty; 0 0 1 0], "
            f"got P = {p.ravel().tolist()}"
        )
    return p


def _check_alike(left: Matrix, right: Matrix) -> None:
    for axis in (0, 1):
        a, b = left[axis, axis], right[axis, axis]
        if abs(a - b) > SAME_FOCAL * a:
            raise CalibrationError(f"rectified camera_info: expected equal focal lengths in P, got {a:g} and {b:g} px")


def _axis_and_shift(left: Matrix, right: Matrix) -> tuple[Axis, float]:
    """Direction of the baseline, and ``-f B`` along it: finite, zero, or NaN with a sign."""
    x, y = (float(right[i, 3] - left[i, 3] if left[i, 3] else right[i, 3]) for i in (0, 1))
    if math.isnan(y) or (not math.isnan(x) and abs(y) > abs(x)):
        axis, shift, other = "vertical", y, x
    else:
        axis, shift, other = "horizontal", x, y
    if not math.isnan(shift) and (math.isinf(shift) or abs(other) > SAME_FOCAL * abs(shift)):
        raise CalibrationError(
            f"rectified camera_info: expected a horizontal or a vertical baseline, got P[3] = {x:g}, P[7] = {y:g}"
        )
    return ("vertical" if axis == "vertical" else "horizontal"), shift


def _rotation(info: CameraInfo) -> tuple[tuple[float, ...], ...]:
    r = np.asarray(info.r, np.float64).reshape(3, 3)
    if not r.any():  # a field left alone
        r = np.eye(3)
    if not is_rotation(r):
        raise CalibrationError(f"rectified left camera_info: expected a rotation in R, got {r.ravel().tolist()}")
    return tuple(tuple(float(x) for x in row) for row in r)


def window_from_info(info: CameraInfo) -> Window | None:
    """Which part of a rectified image shows something, as ``roi`` tells; None: all of it.

    Raises
    ------
    CalibrationError
        The window leaves the image.
    """
    roi = info.roi
    if not (roi.width and roi.height):
        return None
    if roi.x_offset + roi.width > info.width or roi.y_offset + roi.height > info.height:
        raise CalibrationError(
            f"rectified camera_info: expected a roi within {info.width}x{info.height} px, got {roi.width}x{roi.height} "
            f"at ({roi.x_offset}, {roi.y_offset})"
        )
    return Window(roi.x_offset, roi.y_offset, roi.width, roi.height)


def check_size(info: CameraInfo, shape: tuple[int, ...]) -> None:
    """Raise `CalibrationError` where a rectified image is not as large as its camera_info says."""
    if (info.height, info.width) != tuple(shape[:2]):
        raise CalibrationError(
            f"rectified camera_info: expected the image's size {shape[1]}x{shape[0]}, got {info.width}x{info.height}"
        )
