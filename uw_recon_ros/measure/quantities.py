"""What can be measured in one view, with its standard deviation.

``report/measure_numbers.js`` does the same in pages; a test holds the two together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.measure.endpoints import CORRELATED_PX, End, segment_ends
from uw_recon_ros.measure.random_draws import below, normals
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Mask, Matrix, StereoGeometry

CLICK_PX = 1.0  #: how well people hit a point, standard deviation
_SPOT_PX = 6  # radius of what stands for a single point
_PLANE_DRAWS = 300
_PLANE_MOST = 4000  # disparities that a plane is fitted to
_CELLS_MOST = 60  # of a patch, each way
_CELLS_LEAST = 8
_TILTED_BY_NOISE = 0.1  # slope of a cell that noise alone makes: it adds half its square to an area
_REPEATS = 24

#: Relative standard deviation of depth by the calibration at a depth in m; None: not known.
CalibrationError = Callable[[float], float]


@dataclass(frozen=True)
class Measurement:
    """A result.

    Parameters
    ----------
    quantity : str
        ``length``, ``polyline``, ``to_plane``, ``height``, ``area``, ``rugosity``.
    value, sigma : float
    unit : str
        m, m2 or nothing; baselines where the scale is not known.
    sigma_disparity, sigma_click, sigma_calibration : float
        Its parts; NaN: not known, and not in `sigma`.
    points : tuple of (u, v)
        Rectified px.
    depth : float
        Mean, m.
    agreed : float
        Least share of disparities that agreed at an end, 0 to 1.
    cell : float
        Side of the cells of a patch: roughness finer than that is not seen; NaN elsewhere.
    other : float
        Length with an end at an edge on the other surface seen there; NaN: no end lies at an edge.
    """

    quantity: str
    value: float
    sigma: float
    unit: str
    sigma_disparity: float
    sigma_click: float
    sigma_calibration: float
    points: tuple[tuple[float, float], ...]
    depth: float
    agreed: float
    cell: float = float("nan")
    other: float = float("nan")


def point_of(geometry: StereoGeometry, u: float, v: float, disparity: float) -> Matrix:
    """(3,) point in the rectified left frame, m (baselines where the scale is not known)."""
    depth = geometry.focal_times_baseline / (disparity + geometry.offset_px)
    ray: Matrix = np.linalg.solve(geometry.intrinsics_left, np.array([u, v, 1.0]))
    return depth * ray


def measure_polyline(
    frame: DisparityFrame, points: Sequence[tuple[float, float]], *, click_px: float = CLICK_PX,
    calibration: CalibrationError | None = None,
) -> Measurement:  # fmt: skip
    """Length along points; two make a length.

    Parameters
    ----------
    frame : DisparityFrame
    points : sequence of (u, v)
        Rectified px.
    click_px : float
        Standard deviation of each coordinate of a point, px.
    calibration : callable or None

    Raises
    ------
    EstimationError
        There is no depth.
    """
    pixels = [np.asarray(point, np.float64) for point in points]
    if len(pixels) < 2:
        raise ValueError(f"points: expected at least two, got {len(pixels)}")
    segments = [segment_ends(frame, one, other) for one, other in pairwise(pixels)]
    inner = (_joined(before[1], after[0]) for before, after in pairwise(segments))
    ends = [segments[0][0], *inner, segments[-1][1]]

    def length(values: Matrix) -> float:
        found = [point_of(frame.geometry, *row) for row in values.reshape(-1, 3)]
        return float(sum(np.linalg.norm(b - a) for a, b in pairwise(found)))

    made = _propagated("length" if len(ends) == 2 else "polyline", length, ends, frame, click_px, calibration)
    return replace(made, other=_with_another(length, ends, made.value))


def _with_another(length: Callable[[Matrix], float], ends: Sequence[End], found: float) -> float:
    """The length that differs most, with one end on the other surface seen there; NaN where no end has one."""
    inputs, others = np.array([[end.u, end.v, end.disparity] for end in ends]), list[float]()
    for k, end in enumerate(ends):
        if np.isfinite(end.beside):
            moved = inputs.copy()
            moved[k, 2] = end.beside
            others.append(length(moved))
    return max(others, key=lambda other: abs(other - found), default=float("nan"))


def _joined(one: End, other: End) -> End:
    """The same point, seen along the segment before and the one after."""
    weights = np.array([1 / one.sigma**2, 1 / other.sigma**2])
    disparity = float(np.average([one.disparity, other.disparity], weights=weights))
    apart = abs(one.disparity - other.disparity) / 2
    sigma = max(float(1 / np.sqrt(weights.sum())), apart)
    return replace(one, disparity=disparity, sigma=sigma, agreed=min(one.agreed, other.agreed))


def _propagated(
    quantity: str, value: Callable[[Matrix], float], ends: Sequence[End], frame: DisparityFrame, click_px: float,
    calibration: CalibrationError | None,
) -> Measurement:  # fmt: skip
    """First-order propagation; slopes by differences."""
    inputs = np.array([[end.u, end.v, end.disparity] for end in ends])
    sigmas = np.array([[click_px, click_px, end.sigma] for end in ends])
    slopes = np.zeros_like(inputs)
    for k in np.ndindex(*inputs.shape):
        step = np.zeros_like(inputs)
        step[k] = 1e-3
        slopes[k] = (value(inputs + step) - value(inputs - step)) / 2e-3
    parts = (slopes * sigmas) ** 2
    found = value(inputs)
    depth = float(np.mean([point_of(frame.geometry, *row)[2] for row in inputs]))
    by_calibration = abs(found) * calibration(depth) if calibration else float("nan")
    by_disparity, by_click = float(np.sqrt(parts[:, 2].sum())), float(np.sqrt(parts[:, :2].sum()))
    sigma = float(np.sqrt(by_disparity**2 + by_click**2 + np.nan_to_num(by_calibration) ** 2))
    return Measurement(
        quantity, found, sigma, unit_of(frame.geometry), by_disparity, by_click, by_calibration,
        tuple((end.u, end.v) for end in ends), depth, min(end.agreed for end in ends),
    )  # fmt: skip


def unit_of(geometry: StereoGeometry) -> str:
    """Of lengths there."""
    return "m" if geometry.metric else "baselines"


def _spot(frame: DisparityFrame, point: tuple[float, float]) -> End:
    """The surface about a point: the middle of what is seen near it."""
    u, v = round(point[0]), round(point[1])
    part = slice(max(v - _SPOT_PX, 0), v + _SPOT_PX + 1), slice(max(u - _SPOT_PX, 0), u + _SPOT_PX + 1)
    d, sigma = frame.disparity[part], frame.sigma[part]
    known = np.isfinite(d)
    if known.sum() < 8:
        raise EstimationError(f"no depth at ({u}, {v}): click where the picture has depth", Code.MEASURE_NO_DEPTH)
    middle, noise = float(np.median(d[known])), max(float(np.nanmedian(sigma[known])), 0.05)
    agree = np.abs(d[known] - middle) <= max(3 * noise, 0.5)
    return End(point[0], point[1], float(d[known][agree].mean()), noise, float(agree.mean()))


def fit_plane(frame: DisparityFrame, corners: Sequence[tuple[float, float]] | None = None) -> tuple[Matrix, float]:
    """The plane that most of a view lies in: disparity is linear in the image on it.

    Parameters
    ----------
    frame : DisparityFrame
    corners : sequence of (u, v) or None
        Of a polygon in which it lies; None: the whole view.

    Returns
    -------
    (3,), float
        ``d = a u + b v + c``, px; share of the disparities that agree.

    Raises
    ------
    EstimationError
        Fewer than half lie in one plane.
    """
    known = np.isfinite(frame.disparity) & (_polygon(frame, corners) if corners else np.True_)
    v, u = np.nonzero(known)
    if len(u) < 50:
        raise EstimationError(f"plane: expected at least 50 disparities, got {len(u)}", Code.MEASURE_NO_DEPTH)
    chosen = below(len(u), _PLANE_MOST) if len(u) > _PLANE_MOST else np.arange(len(u))
    places = np.stack([u, v, np.ones(len(u))], axis=1)[chosen].astype(np.float64)
    d = frame.disparity[v, u][chosen].astype(np.float64)
    limit = max(3 * float(np.nanmedian(frame.sigma[known])), 0.5)
    agreed = np.zeros(len(d), np.bool_)
    for triple in below(len(d), 3 * _PLANE_DRAWS, _PLANE_MOST).reshape(-1, 3):
        if abs(np.linalg.det(places[triple])) > 1:
            plane = np.linalg.solve(places[triple], d[triple])
            agree = np.abs(places @ plane - d) <= limit
            if agree.sum() > agreed.sum():
                agreed = agree
    share = float(agreed.mean())
    if share < 0.5:
        text = f"plane: expected at least half of the view to lie in one, got {share:.0%}"
        raise EstimationError(text, Code.MEASURE_NO_PLANE)
    fitted = np.linalg.lstsq(places[agreed], d[agreed], rcond=None)[0]
    return np.asarray(fitted, np.float64), share


def _polygon(frame: DisparityFrame, corners: Sequence[tuple[float, float]]) -> Mask:
    """(H, W) pixels whose middles lie inside: those from which a ray to the left crosses the outline an odd number of
    times."""
    if _crosses_itself(corners):
        text = "outline: expected corners in order, got an outline that crosses itself"
        raise EstimationError(text, Code.MEASURE_INPUT)
    if _flat(corners):
        text = "outline: expected three corners or more that are not in one line"
        raise EstimationError(text, Code.MEASURE_INPUT)
    height, width = frame.disparity.shape
    v, u = np.arange(height)[:, None], np.arange(width)[None]
    inside = np.zeros((height, width), np.bool_)
    for (u0, v0), (u1, v1) in pairwise([*corners, corners[0]]):
        if v0 != v1:
            crossed = u0 + (v - v0) * (u1 - u0) / (v1 - v0)
            inside ^= ((v0 <= v) != (v1 <= v)) & (crossed < u)
    return inside


def _flat(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether an outline is hardly wider than a pixel."""
    twice = sum(u0 * v1 - u1 * v0 for (u0, v0), (u1, v1) in pairwise([*corners, corners[0]]))
    across = max(np.hypot(u - corners[0][0], v - corners[0][1]) for u, v in corners)
    return bool(abs(twice) < 2 * across)


def _crosses_itself(corners: Sequence[tuple[float, float]]) -> bool:
    """Whether two sides that do not follow each other meet."""
    ends = [(np.array(a, float), np.array(b, float)) for a, b in zip(corners, [*corners[1:], corners[0]], strict=True)]

    def turn(a: Matrix, b: Matrix, c: Matrix) -> float:
        return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))

    return any(
        turn(*ends[i], ends[j][0]) * turn(*ends[i], ends[j][1]) < 0
        and turn(*ends[j], ends[i][0]) * turn(*ends[j], ends[i][1]) < 0
        for i in range(len(ends))
        for j in range(i)
    )


def _outline_px(corners: Sequence[tuple[float, float]]) -> float:
    return float(sum(np.hypot(u1 - u0, v1 - v0) for (u0, v0), (u1, v1) in pairwise([*corners, corners[0]])))


def _plane_in_space(geometry: StereoGeometry, plane: Matrix) -> tuple[Matrix, float]:
    """Unit normal towards the camera and distance of the plane ``n x = distance``.

    ``a u + b v + c + offset = f B / Z`` times Z says ``m K x = f B`` with ``m = (a, b, c + offset)``.
    """
    normal = (plane + np.array([0.0, 0.0, geometry.offset_px])) @ geometry.intrinsics_left
    length = float(np.linalg.norm(normal)) * (-1 if normal[2] > 0 else 1)
    return normal / length, geometry.focal_times_baseline / length


def measure_to_plane(
    frame: DisparityFrame, point: tuple[float, float], corners: Sequence[tuple[float, float]] | None = None, *,
    click_px: float = CLICK_PX, calibration: CalibrationError | None = None,
) -> Measurement:  # fmt: skip
    """Distance of a point from a plane, positive towards the camera; without corners from the bottom: its height.

    Raises
    ------
    EstimationError
        There is no depth, or no plane.
    """
    plane, share = fit_plane(frame, corners)
    normal, distance = _plane_in_space(frame.geometry, plane)
    end = _spot(frame, point)

    def away(values: Matrix) -> float:
        return float(normal @ point_of(frame.geometry, *values.reshape(-1)) - distance)

    made = _propagated("to_plane" if corners else "height", away, [end], frame, click_px, calibration)
    return replace(made, agreed=min(made.agreed, share))


def measure_patch(
    frame: DisparityFrame, corners: Sequence[tuple[float, float]], *, click_px: float = CLICK_PX,
    calibration: CalibrationError | None = None,
) -> tuple[Measurement, Measurement]:  # fmt: skip
    """Area of a surface within a polygon, and its roughness: that area over the area of its projection onto a plane.

    Disparities are averaged over cells, so that their noise does not look like roughness; what noise is left adds is
    estimated by adding it again, and taken off.

    Raises
    ------
    EstimationError
        Less than half of the patch has depth, or its outline crosses itself.
    """
    if len(corners) < 3:
        raise ValueError(f"corners: expected at least three, got {len(corners)}")
    mask = _polygon(frame, corners)
    known = mask & np.isfinite(frame.disparity)
    if known.sum() < 200 or known.sum() < 0.5 * mask.sum():
        raise EstimationError(
            f"patch: expected depth on half of it, got {known.sum()} of {mask.sum()} pixels", Code.MEASURE_NO_DEPTH
        )
    cells, noise, step = _cells(frame, mask)
    area, flat = _areas(frame.geometry, *cells)
    again = np.array([_areas(frame.geometry, *cells[:2], cells[2] + noise * _noise(noise, k)) for k in range(_REPEATS)])
    spread, added = again.std(axis=0), again.mean(axis=0) - (area, flat)
    whole = mask.sum() / max(np.isfinite(cells[2]).sum() * step**2, 1)  # edge cells and gaps
    depth = frame.geometry.focal_times_baseline / (float(np.median(frame.disparity[known])) + frame.geometry.offset_px)
    edge = float(np.sqrt(_outline_px(corners) * step) / mask.sum()) * click_px
    made = _patch_results(frame, corners, (area - added[0], flat - added[1]), spread, whole, edge, depth, calibration)
    cell = step * depth / frame.geometry.focal_px
    return replace(made[0], cell=cell), replace(made[1], cell=cell)


def _noise(like: Matrix, turn: int) -> Matrix:
    return normals(like.size, turn * like.size).reshape(like.shape)


def _patch_results(
    frame: DisparityFrame, corners: Sequence[tuple[float, float]], areas: tuple[float, float], spread: Matrix,
    whole: float, edge: float, depth: float, calibration: CalibrationError | None,
) -> tuple[Measurement, Measurement]:  # fmt: skip
    area, flat = float(areas[0] * whole), float(areas[1] * whole)
    told = calibration(depth) if calibration else float("nan")
    places = tuple((float(u), float(v)) for u, v in corners)
    by_disparity, by_click, by_calibration = float(spread[0] * whole), area * edge, 2 * area * told
    sigma = float(np.sqrt(by_disparity**2 + by_click**2 + np.nan_to_num(by_calibration) ** 2))
    unit = f"{unit_of(frame.geometry)}2"
    nothing = float("nan")
    rough = float(np.hypot(spread[0] / areas[1], spread[1] * areas[0] / areas[1] ** 2))
    return (
        Measurement("area", area, sigma, unit, by_disparity, by_click, by_calibration, places, depth, 1.0),
        Measurement("rugosity", max(area / flat, 1.0), rough, "", rough, nothing, nothing, places, depth, 1.0),
    )


def _cells(frame: DisparityFrame, mask: Mask) -> tuple[tuple[Matrix, Matrix, Matrix], Matrix, int]:
    """Middles and mean disparities of square cells, NaN outside, their noise, and their side in px."""
    v, u = np.nonzero(mask)
    top, left = int(v.min()), int(u.min())
    step = _cell_px(frame, mask, max(int(np.ptp(v)), int(np.ptp(u))))
    rows, columns = (int(np.ptp(side)) // step + 1 for side in (v, u))
    d = np.where(mask, frame.disparity, np.nan).astype(np.float64)[
        top : top + rows * step, left : left + columns * step
    ]
    sigma = frame.sigma[top : top + rows * step, left : left + columns * step].astype(np.float64)
    rows, columns = d.shape[0] // step, d.shape[1] // step
    blocks = [part[: rows * step, : columns * step].reshape(rows, step, columns, step) for part in (d, sigma)]
    known = np.isfinite(blocks[0])
    count = known.sum(axis=(1, 3))
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count >= step * step / 2, np.where(known, blocks[0], 0).sum(axis=(1, 3)) / count, np.nan)
        noise = np.where(known & np.isfinite(blocks[1]), blocks[1], 0).sum(axis=(1, 3)) / count
    us = left + step * np.arange(columns) + (step - 1) / 2
    vs = top + step * np.arange(rows) + (step - 1) / 2
    grid = np.meshgrid(us, vs)
    return (grid[0], grid[1], mean.astype(np.float64)), np.nan_to_num(noise) * min(1.0, CORRELATED_PX / step), step


def _cell_px(frame: DisparityFrame, mask: Mask, longest: int) -> int:
    """Side of cells so large that noise tilts them little, and so small that there are some."""
    known = mask & np.isfinite(frame.disparity)
    geometry, disparity = frame.geometry, float(np.median(frame.disparity[known]))
    noise = float(np.nanmedian(frame.sigma[known]))
    baseline_px = abs(disparity + geometry.offset_px)  # px that the baseline is long at that depth
    least, most = max(4, -(-longest // _CELLS_MOST)), max(longest // _CELLS_LEAST, 4)
    for step in range(least, most):
        slope = noise * min(1.0, CORRELATED_PX / step) * geometry.focal_px / (baseline_px * step)
        if slope <= _TILTED_BY_NOISE:
            return step
    return max(most, least)


def _areas(geometry: StereoGeometry, u: Matrix, v: Matrix, disparity: Matrix) -> tuple[float, float]:
    """Area of the surface through the cells' middles, and of its projection onto its own plane; scaled to all cells."""
    depth = geometry.focal_times_baseline / (disparity + geometry.offset_px)
    rays = np.stack([u.ravel(), v.ravel(), np.ones(u.size)]) * depth.ravel()
    points = np.linalg.solve(geometry.intrinsics_left, rays).T.reshape(*u.shape, 3)
    a, b, c, d = points[:-1, :-1], points[:-1, 1:], points[1:, :-1], points[1:, 1:]
    double = np.concatenate([np.cross(b - a, c - a).reshape(-1, 3), np.cross(c - d, b - d).reshape(-1, 3)])
    double = double[np.isfinite(double).all(axis=1)]
    if not len(double):
        return float("nan"), float("nan")
    shown = points[np.isfinite(points).all(axis=2)]
    normal = np.linalg.svd(shown - shown.mean(axis=0), full_matrices=False)[2][2]
    all_cells = 2 * np.isfinite(disparity).sum() / len(double)
    surface, flat = np.linalg.norm(double, axis=1).sum() / 2, np.abs(double @ normal).sum() / 2
    return float(surface * all_cells), float(flat * all_cells)
