"""What an autopilot understands: the nearest trusted surface in each direction, and the distance along one axis.

Both are silent rather than wrong: a direction in which no trusted surface was seen is unknown, not free. Why they are
silent can be asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.camera_mount import MountParams
from uw_recon_ros.connected_pieces import label_pieces
from uw_recon_ros.params import Params, param
from uw_recon_ros.reconstruct.triangulation import points_from_depth
from uw_recon_ros.types import AxisRange, ByteImage, DepthMap, DisparityMap, Mask, Sectors, Status

_AXES = {"forward": (1.0, 0.0, 0.0), "down": (0.0, 0.0, -1.0), "up": (0.0, 0.0, 1.0)}

Floats = NDArray[np.float64]

#: What a pixel must be to be told of, in this order, and what it means where hardly any is.
_WITH_DEPTH, _LARGE, _CERTAIN, _OFF_LIMIT = "with depth", "of large things", "certain", "off the limit of the search"
_LIKELY = "likely"
_WITHIN, _IN_SLICE, _IN_CONE, _AGREEING = "within limits", "in the slice", "in the cone", "agreeing"
_LACKS = {
    _WITH_DEPTH: "no depth, mostly for {reason}",
    _LARGE: "small things alone, as drifting particles are: under obstacle_min_size_m",
    _CERTAIN: "low certainty: sigma over obstacle_max_relative_sigma (far away for this baseline, or little texture)",
    _OFF_LIMIT: "at the near limit of the search: nearer than f B / max_disparity, or water that shows nothing",
    _LIKELY: "low confidence: under obstacle_min_confidence",
    _WITHIN: "out of limits: nearer than cloud_min_range or further than cloud_max_range",
    _IN_SLICE: "nothing in the fan: it lies outside obstacle_field_deg, or above or below the obstacle heights",
    _IN_CONE: "nothing in the cone: it lies outside range_cone_deg about range_axis",
    _AGREEING: "no agreement: too few pixels at one distance, see obstacle_min_share",
}
_NO_DEPTH = {
    Status.LOW_TEXTURE: "open water, or surfaces without texture",
    Status.INCONSISTENT: "cameras that disagree",
    Status.OCCLUDED: "being seen by the left camera only",
    Status.OUTSIDE: "being seen by the left camera only",
    Status.OUT_OF_RANGE: "limits: min_disparity, max_disparity or max_relative_sigma",
    Status.UNSEEN: "images that show no scene",
    Status.FILTERED: "speckles",
}


@dataclass(frozen=True)
class ObstacleParams(Params):
    """What `obstacles` and `range` can be told. Defaults: ``test/benchmark/obstacles.py``."""

    obstacle_min_height_m: float = param(
        -0.5, "Lowest point that counts as an obstacle, in base_frame.", unit="m", low=-100.0, high=100.0
    )
    obstacle_max_height_m: float = param(
        0.5, "Highest point that counts as an obstacle, in base_frame.", unit="m", low=-100.0, high=100.0
    )
    obstacle_field_deg: float = param(
        90.0,
        "Angle that obstacles cover, half of it to either side of straight ahead.",
        unit="deg",
        low=1.0,
        high=360.0,
    )
    obstacle_axes: str = param(
        "flu",
        "Sectors go to the left, in base_frame (flu), or to the right, in base_frame_frd (frd), as mavros takes them.",
        choices=("flu", "frd"),
    )
    obstacle_sector_deg: float = param(5.0, "Angle of one sector of obstacles.", unit="deg", low=0.5, high=90.0)
    obstacle_min_share: float = param(
        2e-4, "Share of the image's pixels that must agree on a distance before it is told.", low=0.0, high=1.0
    )
    obstacle_min_size_m: float = param(
        0.03, "Things that show less than a square of this side are drifting particles, no obstacles; 0: all count.",
        unit="m", low=0.0, high=1.0,
    )  # fmt: skip
    obstacle_max_relative_sigma: float = param(
        0.05, "Depths less certain than this share of themselves tell of no obstacle.", low=0.001, high=1.0
    )
    obstacle_min_confidence: float = param(
        0.9, "Pixels less likely to be right than this tell of no obstacle (where disparity/confidence is known).",
        low=0.0, high=1.0,
    )  # fmt: skip
    range_axis: str = param("forward", "Direction in which range is measured, in base_frame.", choices=tuple(_AXES))
    range_cone_deg: float = param(10.0, "Full angle of the cone in which range looks.", unit="deg", low=0.5, high=90.0)

    def check_together(self) -> None:
        """Heights must leave a slice, and the field hold a sector."""
        if self.obstacle_min_height_m >= self.obstacle_max_height_m:
            raise ValueError(
                "obstacle_min_height_m, obstacle_max_height_m: expected the first below the second, "
                f"got {self.obstacle_min_height_m:g} and {self.obstacle_max_height_m:g} m"
            )
        if self.obstacle_sector_deg > self.obstacle_field_deg:
            raise ValueError(
                f"obstacle_sector_deg: expected at most obstacle_field_deg = {self.obstacle_field_deg:g} deg, "
                f"got {self.obstacle_sector_deg:g}"
            )


@dataclass(frozen=True, eq=False)
class ObstacleScan:
    """The trusted points of one depth map, as the vehicle sees them.

    Parameters
    ----------
    offsets : (N, 3) float64
        From the left camera, in the directions of the base, m.
    sigma : (N,) float64
        Standard deviation along the ray, m.
    fewest : int
        Points that must agree on a distance.
    min_range, max_range : float
        m; what may be told.
    stamp_ns : int
    params : ObstacleParams
    mount : MountParams
    left : mapping of str to int
        Pixels that were left after each rule, in order.
    status : (H, W) uint8
        `Status` bits of the depth map.
    """

    offsets: Floats
    sigma: Floats
    fewest: int
    min_range: float
    max_range: float
    stamp_ns: int
    params: ObstacleParams
    mount: MountParams
    left: Mapping[str, int]
    status: ByteImage

    def sectors(self) -> Sectors:
        """The nearest trusted surface in each sector.

        A distance from the base can be shorter than `min_range`, which is from the camera, or longer than
        `max_range`: the limits of the sectors are so wide that nobody throws a told one away.
        """
        flat, sector = self._slice()
        step, first = np.deg2rad(self.params.obstacle_field_deg) / self._number, self._first
        ranges = nearest_with_neighbors(flat, sector, self._number, self.fewest)
        furthest = self.max_range + float(np.hypot(*self.mount.place[:2]))
        frame = self.mount.base_frame + "_frd" if self._clockwise else self.mount.base_frame
        return Sectors(ranges, first + step / 2, step, 0.0, furthest, self.stamp_ns, frame)

    def along_axis(self) -> AxisRange | None:
        """The distance along the axis; None where nothing trusted lies in the cone."""
        along, inside = self._cone()
        cone = np.deg2rad(self.params.range_cone_deg)
        along, sigma = along[inside], self.sigma[inside]
        (nearest,) = nearest_agreed(along, np.zeros(len(along), np.int64), 1, self.fewest)
        if not np.isfinite(nearest):
            return None
        agreeing = (along >= nearest) & (along <= nearest * (1 + _AGREEMENT))
        return AxisRange(
            float(nearest), float(np.median(sigma[agreeing])), float(cone), self.min_range, self.max_range,
            self.stamp_ns, self.mount.base_frame,
        )  # fmt: skip

    def why_no_sector(self) -> str:
        """In a line, what the pixels lack where no sector is told."""
        _, sector = self._slice()
        return self._why(_IN_SLICE, int(np.count_nonzero((sector >= 0) & (sector < self._number))))

    def why_no_range(self) -> str:
        """In a line, what the pixels lack where no distance is told along the axis."""
        return self._why(_IN_CONE, int(np.count_nonzero(self._cone()[1])))

    @property
    def _number(self) -> int:
        return round(self.params.obstacle_field_deg / self.params.obstacle_sector_deg)

    @property
    def _first(self) -> float:
        return float(-np.deg2rad(self.params.obstacle_field_deg) / 2)

    @property
    def _clockwise(self) -> bool:
        return self.params.obstacle_axes == "frd"

    def _slice(self) -> tuple[Floats, NDArray[np.int64]]:
        """What lies in the slice of heights: horizontal distance from the base, and number of the sector."""
        p = self.params
        points = self.offsets + self.mount.place
        points = points[(points[:, 2] >= p.obstacle_min_height_m) & (points[:, 2] <= p.obstacle_max_height_m)]
        step = np.deg2rad(p.obstacle_field_deg) / self._number
        bearing = np.arctan2(-points[:, 1] if self._clockwise else points[:, 1], points[:, 0])
        return np.hypot(points[:, 0], points[:, 1]), np.floor((bearing - self._first) / step).astype(np.int64)

    def _cone(self) -> tuple[Floats, Mask]:
        """Distances along the axis, and which of them lie in its cone."""
        along = self.offsets @ np.array(_AXES[self.params.range_axis])
        half = np.deg2rad(self.params.range_cone_deg) / 2
        return along, np.asarray(along > np.cos(half) * np.linalg.norm(self.offsets, axis=1))

    def _why(self, place: str, number: int) -> str:
        left = {**self.left, place: number}
        lack = next((rule for rule, pixels in left.items() if pixels < self.fewest), _AGREEING)
        text = _LACKS[lack].format(reason=_commonest(self.status))
        return f"{text} (pixels: {', '.join(f'{n} {rule}' for rule, n in left.items())}; {self.fewest} must agree)"


def _commonest(status: ByteImage) -> str:
    """Why most pixels have no depth, in words."""
    numbers = {bit: np.count_nonzero(status & bit) for bit in _NO_DEPTH}
    return _NO_DEPTH[max(numbers, key=lambda bit: numbers[bit])]


@dataclass(frozen=True)
class FindObstacles:
    """What an autopilot is told of one depth map. Pure: the same input gives the same bits.

    Parameters
    ----------
    params : ObstacleParams
    mount : MountParams
    min_range, max_range : float
        m, along the ray: those of the filtered cloud.
    """

    params: ObstacleParams = field(default_factory=ObstacleParams)
    mount: MountParams = field(default_factory=MountParams)
    min_range: float = 0.1
    max_range: float = 20.0

    def look(self, depth: DepthMap, disparity: DisparityMap) -> ObstacleScan:
        """Take of a depth map what is trusted.

        Parameters
        ----------
        depth : DepthMap
            Metric.
        disparity : DisparityMap
            That it was made of: its confidence, where it has one, and the limits it was searched in.

        Raises
        ------
        ValueError
            The scale is unknown.
        """
        if not depth.geometry.metric:
            raise ValueError("obstacles and range: expected a metric depth map, got one of unknown scale")
        p, left = self.params, dict[str, int]()
        with np.errstate(invalid="ignore"):
            rules = {
                _WITH_DEPTH: np.isfinite(depth.depth),
                _LARGE: _of_large_things(depth, disparity, p.obstacle_min_size_m),
                _CERTAIN: depth.sigma <= np.float32(p.obstacle_max_relative_sigma) * depth.depth,
                _OFF_LIMIT: _within_search(disparity),
            }
            if disparity.confidence is not None:
                rules[_LIKELY] = disparity.confidence >= np.float32(p.obstacle_min_confidence)
        trusted = np.ones(depth.depth.shape, np.bool_)
        for rule, held in rules.items():
            trusted &= held
            left[rule] = int(np.count_nonzero(trusted))
        at = np.flatnonzero(trusted)
        points = points_from_depth(depth.depth, depth.geometry).reshape(-1, 3).take(at, axis=0).astype(np.float64)
        lengths = np.sqrt(np.einsum("ij,ij->i", points, points))
        near = (lengths >= self.min_range) & (lengths <= self.max_range)
        if not near.all():
            at, points, lengths = at[near], points[near], lengths[near]
        along_ray = depth.sigma.take(at) / depth.depth.take(at) * lengths
        fewest = max(1, round(p.obstacle_min_share * depth.depth.size))
        offsets = points @ self.mount.base_from_optical.T
        left[_WITHIN] = len(offsets)
        return ObstacleScan(
            offsets, along_ray, fewest, self.min_range, self.max_range, depth.stamp_ns, p, self.mount, left,
            depth.status,
        )  # fmt: skip


#: px; what differs by less from pixel to pixel is one thing.
_JUMP_PX = 1.0


def _of_large_things(depth: DepthMap, disparity: DisparityMap, side_m: float) -> Mask:
    """Where a connected piece of the depth map shows at least as much as a square of that side, seen from ahead."""
    known = np.isfinite(depth.depth)
    if side_m == 0:
        return known
    pieces = label_pieces(np.where(known, disparity.disparity, np.float32(np.nan)), _JUMP_PX)
    seen = np.bincount(pieces[known], depth.depth[known].astype(np.float64) ** 2, minlength=1)
    k = depth.geometry.intrinsics_left
    return np.asarray(known & (seen >= side_m**2 * k[0, 0] * k[1, 1])[pieces])


#: px from the near limit of the search: what would be nearer lands there, and so does water that shows nothing.
_AT_LIMIT_PX = 6


def _within_search(disparity: DisparityMap) -> Mask:
    """Where a disparity is not the nearest that was looked for; everywhere where nobody told the limits."""
    low, high = disparity.min_disparity, disparity.max_disparity
    if low >= high:
        return np.ones(disparity.disparity.shape, np.bool_)
    if disparity.geometry.focal_times_baseline > 0:
        return np.asarray(disparity.disparity <= high - _AT_LIMIT_PX)
    return np.asarray(disparity.disparity >= low + _AT_LIMIT_PX)


#: Distances within this share of the nearest one agree with it.
_AGREEMENT = 0.1


def nearest_agreed(distances: Floats, groups: NDArray[np.int64], number: int, fewest: int) -> Floats:
    """The smallest distance of each group that `fewest` agree on: as many lie within a tenth beyond it.

    Parameters
    ----------
    distances : (N,) float64
        Positive.
    groups : (N,) int64
        From 0 to `number` - 1.
    number, fewest : int

    Returns
    -------
    (number,) float64
        NaN where there is none.
    """
    order = np.argsort(groups.astype(np.int16), kind="stable")  # of 16 bits: sorted by counting
    ends = np.cumsum(np.bincount(groups, minlength=number))
    nearest = np.full(number, np.nan)
    for group, members in enumerate(np.split(order, ends[:-1])):
        distance = np.sort(distances[members])
        agreed = distance[fewest - 1 :] <= distance[: max(len(distance) - fewest + 1, 0)] * (1 + _AGREEMENT)
        if agreed.any():
            nearest[group] = distance[np.argmax(agreed)]
    return nearest


#: A sector's own share of the pixels that must agree; its neighbors may give the rest.
_OWN_SHARE = 0.05


def nearest_with_neighbors(distances: Floats, sectors: NDArray[np.int64], number: int, fewest: int) -> Floats:
    """The nearest of each sector, where both neighbors may stand for what shows too few pixels of its own.

    A thing that reaches into a sector by a corner shows few pixels there; the rest of it lies beside, as far away.

    Parameters
    ----------
    distances : (N,) float64
        Positive.
    sectors : (N,) int64
        From 0 to `number` - 1 in the field; what lies outside stands for its neighbors only.
    number : int
        Of sectors.
    fewest : int
        Points that must agree: own ones to a tenth beyond, or own ones and the neighbors' to a tenth nearer and beyond.

    Returns
    -------
    (number,) float64
        NaN where there is none.
    """
    mine = np.flatnonzero((sectors >= 0) & (sectors < number))
    nearest = nearest_agreed(distances[mine], sectors[mine], number, fewest)
    mine = mine[~(distances[mine] >= nearest[sectors[mine]])]  # few: more would have agreed alone
    least = max(1, round(_OWN_SHARE * fewest))
    for sector in np.flatnonzero(np.bincount(sectors[mine], minlength=number) >= least):
        near = np.sort(distances[mine[sectors[mine] == sector]])
        around = np.sort(distances[np.abs(sectors - sector) <= 1])
        told = _within(near, near, 1.0) >= least
        told &= _within(near, around, 1 + _AGREEMENT) >= fewest
        if told.any():
            nearest[sector] = near[told][0]
    return nearest


def _within(distances: Floats, others: Floats, nearer: float) -> NDArray[np.int64]:
    """How many of the sorted `others` lie from each distance divided by `nearer` to a tenth beyond it."""
    beyond = np.searchsorted(others, distances * (1 + _AGREEMENT), "right")
    return np.asarray(beyond - np.searchsorted(others, distances / nearer, "left"))
