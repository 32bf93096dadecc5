"""Key frames along an odometry, their loops and their graph, and the submaps that hang on them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.align.loops import candidates, footprints, loop_chi2, passes_chi2_gate, summed_covariances
from uw_recon_ros.align.pose_graph import Edges, solve_graph
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.live.params import LiveModelParams
from uw_recon_ros.live.submap import OpenSubmap, Submap
from uw_recon_ros.texturing.simplify import clustered, vertex_normals
from uw_recon_ros.track.keypoints import PackedKeypoints, find_keypoints, packed
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import is_ambiguous, relate
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix, PointCloud, StereoGeometry, Surface

_KEYPOINTS = 600
_EACH = 2  # loops tried for a key frame
_LOOP_INLIERS = 30
_BEYOND_DRIFT = 0.75  # share of the footprint within which loops are sought
_LEAST_STEP = np.diag([1e-3**2] * 3 + [1e-3**2] * 3)  # covariance that no step is surer than, m^2, rad^2


@dataclass(frozen=True, eq=False)
class KeyFrame:
    """A frame that was fused.

    Parameters
    ----------
    stamp_ns : int
    pose : (4, 4) float64
        Odometry's frame <- left rectified view, m.
    step : (6, 6) float64
        Covariance of the motion from the key frame before, twist on the right.
    """

    stamp_ns: int
    pose: Matrix
    step: Matrix


@dataclass(frozen=True, eq=False)
class _Place:
    """A key frame that is recognised when it is seen again."""

    number: int
    keypoints: PackedKeypoints
    geometry: StereoGeometry
    depth: float


@dataclass(frozen=True, eq=False)
class _Loop:
    first: int
    second: int
    motion: Matrix
    covariance: Matrix


@dataclass(eq=False)
class LiveModel:
    """Grows frame by frame, in one thread.

    Parameters
    ----------
    params : LiveModelParams
    """

    params: LiveModelParams
    frames: list[KeyFrame] = field(default_factory=list)
    submaps: list[Submap] = field(default_factory=list)
    loops: list[_Loop] = field(default_factory=list)
    poses: Matrix = field(default_factory=lambda: np.zeros((0, 4, 4)))
    _places: list[_Place] = field(default_factory=list)
    _open: OpenSubmap | None = None
    _solved: int = 0
    _covariance: Matrix = field(default_factory=lambda: np.zeros((6, 6)))
    _track: TrackParams = field(default_factory=TrackParams)

    def wants(self, pose: Matrix) -> bool:
        """Whether a frame at `pose` shows enough that is new."""
        if not self.frames:
            return True
        moved = rigid.log(rigid.inverse(self.frames[-1].pose) @ pose)
        turn = np.rad2deg(np.linalg.norm(moved[3:]))
        return bool(np.linalg.norm(moved[:3]) >= self.params.model_keyframe_m or turn >= self.params.model_keyframe_deg)

    def add(self, frame: DisparityFrame, posed: PosedFrame, covariance: Matrix) -> bool:
        """Fuse a key frame.

        Parameters
        ----------
        frame : DisparityFrame
        posed : PosedFrame
            The same, where odometry says.
        covariance : (6, 6) float64
            Odometry's, of the twist on the right.

        Returns
        -------
        bool
            Whether a submap was closed by it.
        """
        self._note(posed, covariance)
        if self._open is None:
            self._open = OpenSubmap(len(self.frames) - 1, self.params.model_voxel_m)
        self._open.add(posed)
        self._recognise(frame)
        if len(self._open) < self.params.model_submap_frames:
            return False
        self.submaps.append(self._open.closed())
        self._open = None
        if len(self.loops) > self._solved:
            self._solved = len(self.loops)
            self.poses = self._graph()
        return True

    @property
    def correction(self) -> Matrix:
        """(4, 4) the map's frame <- odometry's, at the last key frame."""
        return self._correction(len(self.frames) - 1)

    def cloud(self, stamp_ns: int, frame_id: str, *, last: bool = False) -> PointCloud:
        """All closed submaps, or the last alone, in the map's frame; thinned out to `model_most_points`."""
        points, colors, _ = self._moved(self.submaps[-1:] if last else self.submaps)
        step = max(1, -(-len(points) // self.params.model_most_points))
        return PointCloud(points[::step].astype(np.float32), colors[::step], None, True, stamp_ns, frame_id)

    def surface(self, stamp_ns: int, frame_id: str) -> Surface:
        """All closed submaps as triangles in the map's frame, coarsened to `model_most_triangles`."""
        points, colors, faces = self._moved(self.submaps)
        wanted = float(self.params.model_most_triangles)
        while len(faces) > self.params.model_most_triangles:
            wanted *= 0.8
            kept, faces = clustered(points, faces, round(wanted))
            points, colors = points[kept], colors[kept]
        normals, uv = vertex_normals(points, faces), np.zeros((len(points), 2), np.float32)
        blank = np.zeros((1, 1, 3), np.uint8)
        return Surface(points.astype(np.float32), faces, normals, uv, colors, blank, True, stamp_ns, frame_id)

    def _moved(self, submaps: list[Submap]) -> tuple[Matrix, np.ndarray, np.ndarray]:
        places, faces, start = [np.zeros((0, 3))], [np.zeros((0, 3), np.int32)], 0
        for submap in submaps:
            there = self._correction(submap.anchor)
            places.append(submap.patch.vertices @ there[:3, :3].T + there[:3, 3])
            faces.append(submap.patch.faces + np.int32(start))
            start += len(submap.patch.vertices)
        colors = np.concatenate([np.zeros((0, 3), np.uint8), *(submap.colors for submap in submaps)])
        return np.concatenate(places), colors, np.concatenate(faces)

    def _correction(self, number: int) -> Matrix:
        corrected: Matrix = self.poses[number] @ rigid.inverse(self.frames[number].pose)
        return corrected

    def _note(self, posed: PosedFrame, covariance: Matrix) -> None:
        step = np.zeros((6, 6))
        correction = self.correction if self.frames else np.eye(4)
        if self.frames:
            back = rigid.adjoint(rigid.inverse(rigid.inverse(self.frames[-1].pose) @ posed.pose))
            step = _surely_positive(covariance - back @ self._covariance @ back.T)
        self._covariance = covariance
        self.frames.append(KeyFrame(posed.stamp_ns, posed.pose, step))
        self.poses = np.concatenate([self.poses, (correction @ posed.pose)[None]])

    def _recognise(self, frame: DisparityFrame) -> None:
        """Look whether the place was seen before."""
        number, spacing = len(self.frames) - 1, self.params.model_loop_m
        moved = self.poses[number] - self.poses[self._places[-1].number] if self._places else np.full((4, 4), np.inf)
        if spacing <= 0 or np.linalg.norm(moved[:3, 3]) < spacing:
            return
        keypoints = find_keypoints(frame.left, frame.disparity, frame.sigma, self._track)
        depth = frame.geometry.depth_from_disparity(frame.disparity[::8, ::8])
        middle = float(np.nanmedian(depth)) if np.isfinite(depth).any() else float("nan")
        if not np.isfinite(middle):
            return
        self._places.append(_Place(number, packed(keypoints, _KEYPOINTS), frame.geometry, middle))
        self.loops += self._found()

    def _found(self) -> list[_Loop]:
        """Loops of the newest place that another one explains no better, and that the odometry could lead to."""
        places = self._places
        numbers, depths = [p.number for p in places], np.array([p.depth for p in places])
        k = places[-1].geometry.intrinsics_left
        radii = _BEYOND_DRIFT * 2 * k[1, 2] / k[1, 1] * depths
        seen = footprints(self.poses[numbers], depths)
        parts = np.zeros(len(places), np.int64)
        found = []
        for i, j in candidates(seen, radii, parts, _EACH, set(), first=len(places) - 1):
            first, second = places[i], places[j]
            a, b = first.keypoints.unpacked(), second.keypoints.unpacked()
            if first.geometry != second.geometry:
                continue
            relation = relate(a, b, second.geometry, self._track, inliers=_LOOP_INLIERS)
            if relation is None or is_ambiguous(a, b, second.geometry, self._track, relation):
                continue
            loop = _Loop(first.number, second.number, relation.motion, relation.covariance)
            if self._believable(loop):
                found.append(loop)
        return found

    def _believable(self, loop: _Loop) -> bool:
        sums = summed_covariances(self.poses, np.array([f.step for f in self.frames]))
        return passes_chi2_gate(loop_chi2(self.poses, sums, loop.first, loop.second, loop.motion, loop.covariance))

    def _graph(self) -> Matrix:
        """All poses that fit odometry and loops best."""
        steps = range(1, len(self.frames))
        poses = [frame.pose for frame in self.frames]
        loops = self.loops
        edges = Edges(
            np.array([*(k - 1 for k in steps), *(loop.first for loop in loops)], np.int64),
            np.array([*steps, *(loop.second for loop in loops)], np.int64),
            np.array([*(rigid.inverse(poses[k - 1]) @ poses[k] for k in steps), *(loop.motion for loop in loops)]),
            np.array([*(self.frames[k].step for k in steps), *(loop.covariance for loop in loops)]),
            np.array([*(False for _ in steps), *(True for _ in loops)]),
        )
        held, plain = np.zeros(1, np.int64), replace(edges, robust=np.zeros_like(edges.robust))
        near = solve_graph(self.poses, plain, held, final=False).poses  # a large drift is no reason to doubt a loop
        return solve_graph(near, edges, held, final=False).poses


def _surely_positive(covariance: Matrix) -> Matrix:
    """The nearest one that is no surer than `_LEAST_STEP`."""
    values, axes = np.linalg.eigh((covariance + covariance.T) / 2)
    whole: Matrix = (axes * np.maximum(values, 0)) @ axes.T + _LEAST_STEP
    return whole
