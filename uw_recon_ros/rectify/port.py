"""Flat ports: an in-air calibration used in water, exact at a stated range.

Behind a flat pane rays do not meet in one point any more; a camera in water is no pinhole. Seen from where the rays
of one zone seem to meet it nearly is: near the normal that is ``n_w (d + t / n_g)`` behind the outer face. There the
rectified view stands. A rectified pixel means the point at the stated range that it looks at, and is read where Snell's
law images that point. Points at other ranges are off by the little that rays miss the meeting point; `port_errors` says
by how much. Source: Treibitz, Schechner, Kunz, Singh: Flat refractive geometry (2012); Luczynski, Pfingsthorn, Birk:
The pinax-model (2017).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, distorted, undistorted
from uw_recon_ros.types import Axis, FlatPorts, Matrix

_STEPS = 12
_ZONE = 0.7  # of the corner's tangent: errors grow with its square, and are as large in the middle as in the corners
_SOLVED = 1e-9  # of the distance from the axis, relative
_REPORTED_M = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
_FINE_PERCENT, _FINE_ROW_PX = 1.0, 0.5
AHEAD = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class FlatPort:
    """A flat pane before a camera.

    Parameters
    ----------
    distance_m : float
        From the camera's centre of projection to the inner face, along the normal.
    thickness_m : float
    glass, water : float
        Refractive indices: acrylic 1.49, glass 1.52; fresh water 1.333, sea water 1.342.
    normal : (x, y, z)
        Unit vector outwards, in the camera's frame.
    zone : float
        Tangent, in air, of the rays whose meeting point the rectified view stands at; 0: those near the normal.
    """

    distance_m: float
    thickness_m: float
    glass: float = 1.49
    water: float = 1.333
    normal: tuple[float, float, float] = AHEAD
    zone: float = 0.0

    @property
    def outer_m(self) -> float:
        """Of the outer face, along the normal from the camera, m."""
        return self.distance_m + self.thickness_m

    @property
    def meeting_m(self) -> float:
        """Where rays of the zone seem to meet, along the normal from the camera, m: negative, behind it."""
        air = np.array([max(self.zone, 1e-6)])
        glass, water = self._tangents(air)
        return float(self.outer_m - ((self.distance_m * air + self.thickness_m * glass) / water)[0])

    @property
    def meeting_point(self) -> Matrix:
        """(3,) m in the camera's frame."""
        return self.meeting_m * np.array(self.normal)

    def _tangents(self, air: Matrix) -> tuple[Matrix, Matrix]:
        """Tangents of the angles in the pane and in the water for those in air."""
        sine = air / np.sqrt(1 + air**2)
        return tuple(sine / np.sqrt(n**2 - sine**2) for n in (self.glass, self.water))  # type: ignore[return-value]

    def into_water(self, rays: Matrix) -> tuple[Matrix, Matrix]:
        """Where rays in air leave the pane, and where they go on.

        Parameters
        ----------
        rays : (N, 2) float64
            ``(x, y, 1)`` in air.

        Returns
        -------
        (N, 3), (N, 3) float64
            Points on the outer face, m; directions in water, one unit along the normal.
        """
        normal = np.array(self.normal)
        solid = np.c_[rays, np.ones(len(rays))]
        along = solid @ normal
        aside = solid / along[:, None] - normal  # across the normal, of a ray one unit along it
        air = np.linalg.norm(aside, axis=1)
        unit = aside / np.maximum(air, 1e-300)[:, None]
        glass, water = self._tangents(air)
        offset = self.distance_m * air + self.thickness_m * glass
        return self.outer_m * normal + offset[:, None] * unit, normal + water[:, None] * unit

    def into_air(self, points: Matrix) -> Matrix:
        """Rays in air on which the camera sees points in water.

        Parameters
        ----------
        points : (N, 3) float64
            In the camera's frame, m, beyond the outer face.

        Returns
        -------
        (N, 2) float64
            ``(x, y, 1)``; NaN where a point cannot be seen.
        """
        normal = np.array(self.normal)
        along = points @ normal
        aside = points - along[:, None] * normal
        away, beyond = np.linalg.norm(aside, axis=1), along - self.outer_m
        with np.errstate(invalid="ignore", divide="ignore"):
            air = self._solved(away, np.where(beyond > 0, beyond, np.nan))
            solid = normal + air[:, None] * aside / np.maximum(away, 1e-300)[:, None]
            rays: Matrix = np.where(solid[:, 2:] > 0, solid[:, :2] / solid[:, 2:], np.nan)
        return rays

    def _solved(self, away: Matrix, beyond: Matrix) -> Matrix:
        """Tangent of the angle in air at which a ray arrives `away` from the axis.

        The offset grows with the tangent, ever more slowly: Newton from 0 climbs to the root and never passes it.
        """
        air = np.zeros_like(away)
        for _ in range(_STEPS):
            offset, slope = self._offset(air, beyond)
            air = air + (away - offset) / slope
        offset, _ = self._offset(air, beyond)
        return np.where(np.abs(offset - away) <= _SOLVED * np.maximum(away, self.outer_m), air, np.nan)

    def _offset(self, air: Matrix, beyond: Matrix) -> tuple[Matrix, Matrix]:
        """Distance from the axis at which a ray arrives, and its slope by the tangent in air."""
        sine2 = air**2 / (1 + air**2)
        glass, water = self._tangents(air)
        offset = self.distance_m * air + self.thickness_m * glass + beyond * water
        slope = self.distance_m * np.ones_like(air)
        for n, length in ((self.glass, self.thickness_m), (self.water, beyond)):
            slope = slope + length * n**2 / (n**2 - sine2) ** 1.5 * (1 - sine2) ** 1.5
        return offset, slope


@dataclass(frozen=True, eq=False)
class PortCamera(RectifiedCamera):
    """A rectified view in water of a camera calibrated in air.

    Parameters
    ----------
    port : FlatPort
    range_m : float
        Depth in the rectified frame at which the view is exact, m.
    """

    port: FlatPort = FlatPort(0.0, 0.0)
    range_m: float = 1.0

    @property
    def identity(self) -> bool:
        """Never: water bends rays."""
        return False

    def rectified(self, raw: Matrix) -> Matrix:
        """Rectified pixels of raw ones, (N, 2) px, as if they showed points at the stated range."""
        origins, directions = self.port.into_water(undistorted(self, raw))
        origins, directions = (origins - self.port.meeting_point) @ self.r.T, directions @ self.r.T
        with np.errstate(invalid="ignore", divide="ignore"):
            reach = (self.range_m - origins[:, 2]) / directions[:, 2]
            points = origins + np.where(reach > 0, reach, np.nan)[:, None] * directions
        pixels: Matrix = points @ (self.k_new[:2] / self.range_m).T
        return pixels

    def raw(self, rectified: Matrix) -> Matrix:
        """Raw pixels of rectified ones, (N, 2) px; NaN where nothing is seen."""
        rays = np.c_[rectified, np.ones(len(rectified))] @ np.linalg.inv(self.k_new).T
        points = self.range_m * rays @ self.r + self.port.meeting_point
        return distorted(self, self.port.into_air(points))

    def raw_grid(self, width: int, height: int) -> Matrix:
        """`raw` of every pixel of a rectified image of that size, (height, width, 2) px."""
        u, v = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
        return self.raw(np.stack([u.ravel(), v.ravel()], axis=1)).reshape(height, width, 2)


def behind_ports(
    views: tuple[RectifiedCamera, RectifiedCamera],
    baseline: Matrix,
    ports: tuple[FlatPort, FlatPort],
    range_m: float,
    size: tuple[int, int],
) -> tuple[PortCamera, PortCamera, Matrix]:
    """Rectified views in water of two cameras calibrated in air, each behind a pane of its own.

    Parameters
    ----------
    views : two of RectifiedCamera
        As the calibration in air prescribes.
    baseline : (3,) float64
        Of the right camera in the rectified left frame, m.
    ports : two of FlatPort
        Each in its raw camera's frame.
    range_m : float
    size : (width, height)
        Of the raw images, px.

    Returns
    -------
    PortCamera, PortCamera, (3,) float64
        The views turned so that the line between the points where rays meet is the baseline again, and that baseline.
    """
    zone = _ZONE * max(_corner(view, size) for view in views)
    panes = [replace(port, zone=zone) for port in ports]
    away = [view.r @ pane.meeting_point for view, pane in zip(views, panes, strict=True)]
    moved = baseline + away[1] - away[0]
    axis = int(np.argmax(np.abs(baseline)))
    wanted = np.sign(baseline[axis]) * np.eye(3)[axis]
    turn = _onto(moved, wanted)
    along = np.linalg.norm(moved) * wanted
    made = [
        PortCamera(
            view.k, turn @ view.r, _magnified(view.k_new, pane.water), view.d, view.distortion_model, pane, range_m
        )
        for view, pane in zip(views, panes, strict=True)
    ]
    return made[0], made[1], along


def _corner(view: RectifiedCamera, size: tuple[int, int]) -> float:
    """Tangent in air of the farther corners of an image, those that the lens shows."""
    corners = np.array([[u, v] for u in (0, size[0] - 1) for v in (0, size[1] - 1)], np.float64)
    found = np.linalg.norm(undistorted(view, corners), axis=1)
    return float(np.nanmax(found)) if np.isfinite(found).any() else 0.0


def _onto(vector: Matrix, direction: Matrix) -> Matrix:
    """The smallest rotation that turns a vector onto a unit direction."""
    unit = vector / np.linalg.norm(vector)
    axis = np.cross(unit, direction)
    sine = float(np.linalg.norm(axis))
    turn = axis / max(sine, 1e-300) * np.arcsin(min(sine, 1.0))
    return np.asarray(Rotation.from_rotvec(turn).as_matrix(), np.float64)


def _magnified(k_new: Matrix, water: float) -> Matrix:
    """Water makes images larger by its index: keep the size of a pixel."""
    return k_new @ np.diag([water, water, 1.0])


@dataclass(frozen=True)
class PortErrors:
    """What a port leaves at a range.

    Parameters
    ----------
    range_m : float
    depth_percent : float
        Largest error of depth over the view.
    row_px : float
        Largest difference of rows.
    """

    range_m: float
    depth_percent: float
    row_px: float


def port_errors(
    left: PortCamera, right: PortCamera, baseline: Matrix, size: tuple[int, int], ranges_m: Matrix
) -> tuple[PortErrors, ...]:
    """Errors at other ranges, from the traced images of points there, over a grid of the view."""
    u, v = np.meshgrid(np.linspace(0, size[0] - 1, 9), np.linspace(0, size[1] - 1, 7))
    rays = np.c_[u.ravel(), v.ravel(), np.ones(u.size)] @ np.linalg.inv(left.k_new).T
    return tuple(_at_range(left, right, baseline, size, float(r) * rays) for r in ranges_m)


def _at_range(
    left: PortCamera, right: PortCamera, baseline: Matrix, size: tuple[int, int], points: Matrix
) -> PortErrors:
    axis, rows = int(np.argmax(np.abs(baseline))), 1 - int(np.argmax(np.abs(baseline)))
    seen = []
    for view, centre in ((left, np.zeros(3)), (right, baseline)):
        raw = _imaged(view, points - centre)
        with np.errstate(invalid="ignore"):
            inside = np.all((raw >= 0) & (raw <= np.array(size) - 1), axis=1)
        pixels = np.full(raw.shape, np.nan)
        pixels[inside] = view.rectified(raw[inside])
        seen.append(pixels)
    with np.errstate(invalid="ignore", divide="ignore"):
        disparity = seen[0][:, axis] - seen[1][:, axis] + right.k_new[axis, 2] - left.k_new[axis, 2]
        depth = left.k_new[axis, axis] * baseline[axis] / disparity
    error, row = np.abs(depth / points[:, 2] - 1), np.abs(seen[0][:, rows] - seen[1][:, rows])
    known = np.isfinite(error) & np.isfinite(row)
    worst = (float(part[known].max()) if known.any() else float("nan") for part in (100 * error, row))
    return PortErrors(float(points[0, 2]), *worst)


def _imaged(view: PortCamera, points: Matrix) -> Matrix:
    """Raw pixels of points in the rectified frame at any range: what the camera truly shows."""
    at = replace(view, range_m=float(points[0, 2]))
    with np.errstate(invalid="ignore", divide="ignore"):
        pixels = points @ (view.k_new / points[:, 2:].mean()).T
    return at.raw(pixels[:, :2])


def ports_of(params: RectifyParams) -> FlatPorts:
    """The ports that parameters describe."""
    return FlatPorts(
        params.port_distance_mm / 1e3, params.port_thickness_mm / 1e3, params.port_index, params.water_index
    )


def panes_of(ports: FlatPorts) -> tuple[FlatPort, FlatPort]:
    """The left and the right one, to trace rays through."""
    left, right = (
        FlatPort(ports.distance_m, ports.thickness_m, ports.glass, ports.water, normal)
        for normal in (ports.normal_left, ports.normal_right)
    )
    return left, right


def through_flat_ports(
    views: tuple[RectifiedCamera, RectifiedCamera], baseline_m: float, axis: Axis, size: tuple[int, int],
    ports: FlatPorts, range_m: float,
) -> tuple[PortCamera, PortCamera, float, Finding]:  # fmt: skip
    """What a calibration in air becomes behind flat ports, and how exact that is.

    Returns
    -------
    PortCamera, PortCamera, float, Finding
        The baseline in m, signed as before.
    """
    along = 0 if axis == "horizontal" else 1
    left, right, baseline = behind_ports(views, baseline_m * np.eye(3)[along], panes_of(ports), range_m, size)
    errors = port_errors(left, right, baseline, size, np.array(_REPORTED_M))
    return left, right, float(baseline[along]), _told(left.port, errors, range_m)


def _told(port: FlatPort, errors: tuple[PortErrors, ...], range_m: float) -> Finding:
    known = [e for e in errors if np.isfinite(e.depth_percent)]
    if not known:
        return Finding(Code.RECTIFY_PORT, "flat port: its error at other ranges could not be traced", Severity.WARN)
    depth, row = max(known, key=lambda e: e.depth_percent), max(known, key=lambda e: e.row_px)
    text = (
        f"flat port traced, exact at {range_m:g} m: depth at most {depth.depth_percent:.1f} % wrong "
        f"({depth.range_m:g} m) and rows {row.row_px:.2f} px ({row.range_m:g} m) from {known[0].range_m:g} to "
        f"{known[-1].range_m:g} m; depth counts from {-1000 * port.meeting_m:.1f} mm behind the lens"
    )
    fine = depth.depth_percent <= _FINE_PERCENT and row.row_px <= _FINE_ROW_PX
    advice = "" if fine else "set port_range_m to the range worked at, or calibrate in water"
    return Finding(Code.RECTIFY_PORT, text, Severity.OK if fine else Severity.WARN, advice)
