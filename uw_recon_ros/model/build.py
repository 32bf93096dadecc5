"""From a finished survey to its model, read top-down."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ModelError
from uw_recon_ros.files.atomic import write_json
from uw_recon_ros.files.trajectories import read_poses, write_trajectory_csv, write_tum
from uw_recon_ros.findings import Code, Finding, Severity, worst
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.georeference.crs import NOT_PROJECTED, WITHOUT_SCALE, Crs
from uw_recon_ros.locate.estimate import Located, estimate_trajectory
from uw_recon_ros.locate.priors import priors_from_trajectory
from uw_recon_ros.model.compose import Composed, compose
from uw_recon_ros.model.external_poses import Outside, read_outside
from uw_recon_ros.model.files import notes_of
from uw_recon_ros.model.kept_frames import KeptFrames
from uw_recon_ros.model.keypoint_file import KeypointFile
from uw_recon_ros.model.measurable import MEASURE, measurable
from uw_recon_ros.model.mesh import within_triangles
from uw_recon_ros.model.page import SegmentPart, write_model_page
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.work import TileTask, World
from uw_recon_ros.survey.plan import versions
from uw_recon_ros.survey.report import MODEL, PAGE, show_model
from uw_recon_ros.survey.tables import depth_sigmas
from uw_recon_ros.system_errors import explain
from uw_recon_ros.trajectory import PoseStatus, Trajectory
from uw_recon_ros.types import Matrix

SUMMARY = "model.json"
_LARGE_M = 10_000.0  # positions beyond are moved by an origin, in whole kilometres, before they are float32
_HALVES = slice(0, 3), slice(3, 6)  # of a covariance: position, rotation
_LEAST_SIGMA = 1e-3  # m, rad: nobody is surer
_PRODUCTS = (
    "trajectory.txt", "trajectory.csv", "mesh.ply", "mesh.glb", "cloud.ply", "cloud.laz", "orthomosaic.tif",
    "elevation.tif", "area.tif", "slope.tif", "rugosity.tif", "tileset.json", "tiles/*.glb", MEASURE, PAGE,
)  # fmt: skip
Tell = Callable[[str], None]


@dataclass(frozen=True)
class ModelRequest:
    """What was asked for.

    Parameters
    ----------
    survey : str
        Folder of a finished survey.
    params : DiveModelParams
    poses : str or None
        File in the TUM format: poses of the left optical frame from outside.
    overwrite : bool
        Whether to make anew what stands there.
    bags : tuple of str
        Recordings whose odometry, attitudes, fixes and pressures are used as well.
    """

    survey: str
    params: DiveModelParams
    poses: str | None = None
    overwrite: bool = False
    bags: tuple[str, ...] = ()


def build_model(request: ModelRequest, tell: Tell) -> dict[str, Any]:
    """Make ``model/`` in a survey's folder; return what ``model.json`` holds.

    Raises
    ------
    ModelError
        Nothing can be made, with the reason.
    """
    shelf = KeptFrames(request.survey)
    place = Path(request.survey) / MODEL
    if is_built(request.survey) and not request.overwrite:
        raise ModelError(f"{place}: holds a model already: --overwrite makes it anew", Code.MODEL_EXISTS)
    outside = _outside(request, np.array(shelf.read(0).geometry.rect_from_raw_left))
    tell(f"{len(shelf.paths)} frames: estimating the trajectory")
    try:
        with KeypointFile(request.survey) as keypoints:
            located = estimate_trajectory(shelf.walk(), outside.priors, shelf=keypoints)
    except OSError as error:
        raise _stopped(place, error) from error
    located = replace(
        located, trajectory=replace(located.trajectory, origin=outside.origin),
        findings=(*located.findings, *outside.findings), links=(),  # a long dive's take hundreds of megabytes
    )  # fmt: skip
    parts = _parts(located.trajectory)
    if not parts:
        text = "expected frames that overlap, no two do: record more pairs per second, or move more slowly"
        raise ModelError(f"{request.survey}: {text}", Code.MODEL_NO_OVERLAP)
    try:
        world = _world(located.trajectory, outside.crs)
        return _written(place, shelf, located, parts, request, world, tell)
    except OSError as error:
        raise _stopped(place, error) from error


def _stopped(place: Path, error: OSError) -> ModelError:
    return ModelError(f"{place}: stopped: {explain(error)}; what is finished is kept", Code.MODEL_DISK)


def is_built(survey: str | Path) -> bool:
    """Whether a survey's folder holds a finished model."""
    return (Path(survey) / MODEL / SUMMARY).exists()


def _outside(request: ModelRequest, rect_from_raw: Matrix) -> Outside:
    """What is known from outside of the rectified view: poses in a file, or else what bags hold."""
    p = request.params
    if request.poses is None:
        if p.epsg:
            raise ModelError("epsg: expected --poses with it, got none", Code.MODEL_POSES)
        return read_outside(request.bags, rect_from_raw)
    if p.epsg in NOT_PROJECTED:
        text = f"epsg: expected a projected system in metres (UTM), got {p.epsg}, which is in degrees or not level"
        raise ModelError(text, Code.MODEL_POSES)
    first = read_poses(request.poses).positions[0]
    origin = np.where(np.abs(first) > _LARGE_M, np.round(first, -3), 0.0)
    given = read_poses(request.poses, origin=origin).turned(rect_from_raw.T)
    sigmas = _told_sigmas(given, p.poses_sigma_m, float(np.radians(p.poses_sigma_deg)))
    priors = priors_from_trajectory(given, *sigmas, round(p.poses_offset_s * 1e9))
    return Outside([priors], Crs(p.epsg or None), origin)


def _told_sigmas(given: Trajectory, position_m: float, rotation_rad: float) -> tuple[float, float]:
    """How sure poses are: as their file says, else as told."""
    known = given.covariances[np.isfinite(given.covariances).all(axis=(1, 2))]
    if not len(known):
        return position_m, rotation_rad
    places, turns = (float(np.sqrt(np.median(np.trace(known[:, k][:, :, k], axis1=1, axis2=2)) / 3)) for k in _HALVES)
    return max(places, _LEAST_SIGMA), max(turns, _LEAST_SIGMA)


def _parts(trajectory: Trajectory) -> list[NDArray[np.intp]]:
    """Frames to be fused of each segment, the largest first; segments of a single one are none."""
    seen = trajectory.status != int(PoseStatus.PREDICTED)
    parts = [np.flatnonzero(seen & (trajectory.segment == s)) for s in np.unique(trajectory.segment)]
    return sorted((part for part in parts if len(part) > 1), key=lambda part: (-len(part), part[0]))


def _written(
    place: Path, shelf: KeptFrames, located: Located, parts: list[NDArray[np.intp]], request: ModelRequest,
    world: World, tell: Tell,
) -> dict[str, Any]:  # fmt: skip
    place.mkdir(exist_ok=True)
    if is_built(request.survey):
        _clear(place)
    turn = shelf.read(0).geometry.rect_from_raw_left
    way = located.trajectory.turned(turn)
    write_trajectory_csv(place / "trajectory.csv", way)
    parts_made: list[SegmentPart] = []
    findings: list[Finding] = []
    for rank, part in enumerate(parts):
        number = int(way.segment[part[0]])
        folder = place if rank == 0 else place / f"segment_{number}"
        folder.mkdir(exist_ok=True)
        write_tum(folder / "trajectory.txt", way.picked(way.segment == number))
        tell(f"segment {number}: fusing {len(part)} frames")
        composed = _segment(folder, shelf, located, part, request.params, world, tell)
        findings += () if composed is None else composed.findings
        name = {"segment": number, "folder": folder.relative_to(place).as_posix()}
        clicks = None if composed is None else _measurable(composed, located, part, request, world, name)
        parts_made.append(SegmentPart(name | _entry(composed, len(part)), composed, clicks))
    models = [part.entry for part in parts_made]
    made = _summary(shelf, located, models, tuple(dict.fromkeys(findings)), request, world)
    for part_made in parts_made:
        if part_made.measurable is not None:
            part_made.measurable["reliable"] = made["reliable"]
            write_json(place / part_made.entry["folder"] / MEASURE, part_made.measurable, durable=False)
    write_model_page(place / PAGE, way, parts_made, made)
    show_model(request.survey)
    write_json(place / SUMMARY, made, durable=False)
    return made


def _measurable(
    composed: Composed, located: Located, part: NDArray[np.intp], request: ModelRequest, world: World,
    name: dict[str, Any],
) -> dict[str, Any]:  # fmt: skip
    """What lengths on a segment's surface are measured with."""
    way = located.trajectory
    told = {"segment": name["segment"], **notes_of(world), "click": composed.statistics["orthomosaic_cell"]}
    sigmas = depth_sigmas(Path(request.survey) / "report.json") if world.metric else ()
    shown = composed.shown
    sigma = within_triangles(shown, composed.statistics["voxel"])
    return measurable(shown.surface.vertices, sigma, way.poses, part, located.joint, sigmas, told)


def _clear(place: Path) -> None:
    """Remove a finished model, its summary first: what the next one does not make must not stand beside it.

    Files of other names are somebody else's, and stay.
    """
    (place / SUMMARY).unlink()
    for folder in (*place.glob("segment_*"), place):
        for path in [path for pattern in _PRODUCTS for path in folder.glob(pattern)]:
            path.unlink()
        for left in (folder / "tiles", folder):
            if left.is_dir() and left != place and not any(left.iterdir()):
                left.rmdir()


def _entry(composed: Composed | None, frames: int) -> dict[str, Any]:
    if composed is None:
        return {"frames": frames, "vertices": 0, "triangles": 0}
    return {**composed.statistics, "files": list(composed.files)}


class _Posed(Sequence[PosedFrame]):
    """The frames of one segment where they were taken, read when asked for."""

    def __init__(self, shelf: KeptFrames, located: Located, part: NDArray[np.intp]) -> None:
        self.shelf, self.located, self.part = shelf, located, part

    def __len__(self) -> int:
        return len(self.part)

    def __getitem__(self, index: Any) -> Any:
        k = int(self.part[index])
        return self.shelf.posed(k, self.located.trajectory.poses[k], self.located.applied)


def _segment(
    folder: Path, shelf: KeptFrames, located: Located, part: NDArray[np.intp], params: DiveModelParams, world: World,
    tell: Tell,
) -> Composed | None:  # fmt: skip
    """Fuse one segment and write its files; None where it has no surface."""
    task = TileTask(_Posed(shelf, located, part), folder, params, world, _steps(tell))
    try:
        return compose(task)
    except ModelError as error:
        if error.code is not Code.MODEL_NOTHING:
            raise
        return None


def _world(way: Trajectory, crs: Crs) -> World:
    if not way.metric:
        return World(way.origin, WITHOUT_SCALE, metric=False)
    return World(way.origin, crs)


def _steps(tell: Tell) -> Callable[[str, int, int], None]:
    """Tell each step once."""
    told: set[str] = set()

    def note(step: str, done: int, total: int) -> None:
        if step not in told:
            told.add(step)
            tell(f"{total} {step}")

    return note


def _summary(
    shelf: KeptFrames, located: Located, models: list[dict[str, Any]], more: tuple[Finding, ...], request: ModelRequest,
    world: World,
) -> dict[str, Any]:  # fmt: skip
    way, geometry = located.trajectory, shelf.read(0).geometry
    findings = [*located.findings, *_findings(shelf, located, models), *more]
    counts = {str(s): int((way.status == int(s)).sum()) for s in PoseStatus}
    rig = located.rig
    return {
        "scale": "metric" if way.metric else "unknown: lengths are in baselines of the rig",
        "origin": [float(x) for x in way.origin],
        "crs": world.crs.text,
        "poses": "world <- left optical frame of the camera; world z up",
        "frames": {"kept": len(shelf.paths), "dropped": shelf.dropped, **counts},
        "trajectory": located.statistics,
        "rig": None if rig is None else {"found": asdict(rig.error), "applied": asdict(located.applied)},
        "partners": _partners(Path(request.survey) / "report.json"),
        "params": {spec.name: getattr(request.params, spec.name) for spec in request.params.specs()},
        "camera": {
            "intrinsics": geometry.intrinsics_left.tolist(), "rect_from_raw_left": geometry.rect_from_raw_left,
            "width": shelf.read(0).left.shape[1], "height": shelf.read(0).left.shape[0],
        },
        "models": models,
        "completeness": "share of the cells within the outline of the known ones that have a height",
        "reliable": worst(tuple(findings)) < Severity.UNRELIABLE,
        "warnings": [finding.as_dict() for finding in findings],
        "versions": versions(),
    }  # fmt: skip


def _partners(report: Path) -> Any:
    """What the survey says of pairs whose images were not taken at one moment; None where there are none."""
    try:
        return json.loads(report.read_text())["partners"]
    except (OSError, ValueError, KeyError):
        return None


def _findings(shelf: KeptFrames, located: Located, models: list[dict[str, Any]]) -> list[Finding]:
    found = []
    if not located.trajectory.metric:
        text = "the rig's scale is unknown: all lengths are in baselines, none in metres"
        found.append(Finding(Code.MODEL_NOT_METRIC, text, Severity.UNRELIABLE, "give the rig's calibration"))
    if shelf.dropped:
        text = f"{shelf.dropped} frames left out: another scale than the others', or a stamp that does not increase"
        found.append(Finding(Code.MODEL_FRAMES_DROPPED, text))
    if any(model["vertices"] == 0 for model in models):
        text = (
            "a segment has no surface: all depths are less certain than max_sigma_m, or all parts have fewer "
            "triangles than island_faces"
        )
        found.append(Finding(Code.MODEL_NOTHING, text, Severity.UNRELIABLE))
    return found
