"""The whole way: frame to frame, loops, pose graph, the rig's own error, level ground. Reads top-down as that."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.align.loops import candidates, footprints, loop_chi2, passes_chi2_gate, summed_covariances
from uw_recon_ros.align.pose_graph import Anchors, Edges, Solved, joined, no_anchors, solve_graph
from uw_recon_ros.align.self_calibration import RigFinding, calibrate, corrected
from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.locate.adjusted_links import adjusted_links
from uw_recon_ros.locate.level import levelled
from uw_recon_ros.locate.params import LocateParams
from uw_recon_ros.locate.priors import Priors, anchors_at, fit_to, held_loosely, relative_guesses
from uw_recon_ros.locate.visual_odometry import KeypointShelf, Link, VisualOdometry, first_poses, stretches, walk_frames
from uw_recon_ros.track.keypoints import RigError
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import is_ambiguous, relate, repeats_itself
from uw_recon_ros.trajectory import DisparityFrame, JointCovariance, PoseStatus, Trajectory
from uw_recon_ros.types import Matrix, StereoGeometry

_LOOP_CHI2 = 40.0  # of 6; a loop farther from the graph than this is dropped
_PRIOR_CHI2, _PRIOR_SHARE = 40.0, 0.2  # of 6; share of the frames that may miss what is known from outside by more
_PRIOR_SPREAD, _ANOTHER_UNIT = 2.0, 2.0  # sigmas of a way that tells its unit; how much longer or shorter it may seem
_SHORT = 3  # frames of a part that may be put between their neighbours
_STILL_SHARE = 0.02  # of the depth, within which all positions of a camera that does not move lie
_BEYOND_DRIFT = 0.75  # share of the footprint within which loops are sought


@dataclass(frozen=True, eq=False)
class Located:
    """What `estimate_trajectory` finds.

    Parameters
    ----------
    trajectory : Trajectory
    findings : tuple of Finding
    statistics : dict
        Counts and figures, for files.
    links : tuple of Link
        The relations that the trajectory is made from.
    rig : RigFinding or None
        The told rig's error.
    applied : RigError
        The part of it that was corrected: the same correction belongs to every depth that is fused.
    joint : JointCovariance or None
        How the errors of some poses hang together; numbers of frames.
    """

    trajectory: Trajectory
    findings: tuple[Finding, ...]
    statistics: dict[str, Any] = field(default_factory=dict)
    links: tuple[Link, ...] = ()
    rig: RigFinding | None = None
    applied: RigError = RigError()  # noqa: RUF009
    joint: JointCovariance | None = None


def estimate_trajectory(
    frames: Iterable[DisparityFrame],
    priors: Priors | Sequence[Priors] = (),
    params: LocateParams | None = None,
    track: TrackParams | None = None,
    shelf: KeypointShelf | None = None,
) -> Located:
    """Find where the left camera was at each frame.

    Parameters
    ----------
    frames : iterable of DisparityFrame
        In the order of time; each is looked at once.
    priors : Priors or sequence of Priors
        Poses, attitudes, places or depths from outside, with how sure they are.
    params : LocateParams, optional
    track : TrackParams, optional
    shelf : KeypointShelf, optional
        Where key points are kept, about 90 kB a frame; None: in memory.

    Raises
    ------
    EstimationError
        No frame.
    """
    chosen, tracking = params or LocateParams(), track or TrackParams()
    known = (priors,) if isinstance(priors, Priors) else tuple(priors)
    walk = _walked(frames, known, tracking, shelf)
    loops, tried = _loops(walk, chosen, tracking)
    links = [*walk.links, *loops]
    rig = calibrate([link.relation for link in links], walk.geometries[0], tracking.keypoint_sigma_px)
    applied = rig.applied if rig is not None and chosen.self_calibrate else RigError()
    if applied != RigError():
        links = _corrected(links, walk.geometries[0], tracking.keypoint_sigma_px, applied)
    parts = stretches(len(walk.stamps_ns), links)
    start = first_poses(len(parts), [link for link in links if link.kind != "loop"])
    given = anchors_at(walk.stamps_ns, known)
    upright = any(len(a.index) and p.known[3:5].all() for p, a in zip(known, given, strict=True))
    if chosen.level and known and not upright:
        start = levelled(start, parts, links, walk.geometries[0], applied)
    start = fit_to(start, parts, walk.stamps_ns, [p for p in known if p.absolute])
    anchors = joined([*given, held_loosely(start, parts, given)])
    solved, kept = _solved(start, links, parts, anchors)
    if chosen.bundle:
        better = adjusted_links(walk, solved.poses, kept, _reach(walk), applied, tracking.keypoint_sigma_px)
        solved = _solve_plainly(solved.poses, better, parts, anchors)
    poses = solved.poses
    if chosen.level and not known:
        poses = levelled(poses, parts, links, walk.geometries[0], applied)
    trajectory = _trajectory(walk, poses, solved.covariances, kept)
    missed = np.split(solved.anchor_squares, np.cumsum([len(a.index) for a in given]))[: len(known)]
    found = _findings(walk, trajectory, kept, len(links) - len(kept), rig, applied)
    found += tuple(_prior_findings(known, missed, walk.stamps_ns, upright=upright))
    if trajectory.metric:
        found += tuple(_span_findings(known, given, poses))
    numbers = _statistics(walk, trajectory, kept, len(tried), len(links) - len(kept), solved)
    numbers["priors"] = {p.name: len(squares) for p, squares in zip(known, missed, strict=True)}
    return Located(trajectory, found, numbers, tuple(kept), rig, applied, solved.joint)


def _walked(
    frames: Iterable[DisparityFrame], priors: Sequence[Priors], tracking: TrackParams, shelf: KeypointShelf | None
) -> VisualOdometry:
    """Every frame looked at once, with a guess where priors know one."""
    if not priors:
        walk = walk_frames(frames, tracking, shelf=shelf)
    else:
        stamps: list[int] = []

        def noted() -> Iterator[DisparityFrame]:
            for frame in frames:
                stamps.append(frame.stamp_ns)
                yield frame

        walk = walk_frames(noted(), tracking, relative_guesses(stamps, priors), shelf)
    if not walk.stamps_ns:
        raise EstimationError("frames: expected at least one, got none", Code.TRAJECTORY)
    return walk


def _loops(
    walk: VisualOdometry, chosen: LocateParams, tracking: TrackParams
) -> tuple[list[Link], set[tuple[int, int]]]:
    """Places seen again, sought twice: along the track, then along the track that the first loops mended."""
    loops: list[Link] = []
    tried: set[tuple[int, int]] = set()
    if chosen.loops_a_frame == 0:
        return loops, tried
    parts = stretches(len(walk.stamps_ns), walk.links)
    poses = first_poses(len(parts), walk.links)
    sums = summed_covariances(poses, _steps(len(parts), walk.links))
    for each in (chosen.loops_a_frame, 1):
        pairs = candidates(footprints(poses, _depths(walk)), _reach(walk), parts, each, tried)
        for i, k in pairs:
            tried.add((i, k))
            link = _loop(walk, i, k, chosen, tracking)
            if link is not None and passes_chi2_gate(
                loop_chi2(poses, sums, i, k, link.relation.motion, link.relation.covariance)
            ):
                loops.append(link)
        if not loops:
            break
        poses = solve_graph(poses, _edges([*walk.links, *loops]), _held(parts, no_anchors()), final=False).poses
    return loops, tried


def _depths(walk: VisualOdometry) -> Matrix:
    depths: Matrix = np.nan_to_num(np.array(walk.depths), nan=1.0)
    return depths


def _reach(walk: VisualOdometry) -> Matrix:
    """(N,) how far apart footprints may be that show a common place, m."""
    k = walk.geometries[0].intrinsics_left
    return _depths(walk) * (_BEYOND_DRIFT * 2 * float(k[1, 2] / k[1, 1]))


def _steps(count: int, links: list[Link]) -> Matrix:
    steps = np.zeros((count, 6, 6))
    for link in links:
        steps[link.second] = link.relation.covariance
    return steps


def _loop(walk: VisualOdometry, i: int, k: int, chosen: LocateParams, tracking: TrackParams) -> Link | None:
    first, second, geometry = walk.keypoints[i].unpacked(), walk.keypoints[k].unpacked(), walk.geometries[k]
    relation = relate(first, second, geometry, tracking, inliers=chosen.loop_inliers)
    if relation is None or repeats_itself(second) or is_ambiguous(first, second, geometry, tracking, relation):
        return None
    return Link(i, k, relation, "loop")


def _corrected(links: list[Link], geometry: StereoGeometry, sigma_px: float, applied: RigError) -> list[Link]:
    return [replace(link, relation=corrected(link.relation, geometry, sigma_px, applied)) for link in links]


def _edges(links: list[Link]) -> Edges:
    return Edges(
        np.array([link.first for link in links], np.int64), np.array([link.second for link in links], np.int64),
        np.array([link.relation.motion for link in links]).reshape(-1, 4, 4),
        np.array([link.relation.covariance for link in links]).reshape(-1, 6, 6),
        np.array([link.kind == "loop" for link in links], np.bool_),
    )  # fmt: skip


def _held(parts: NDArray[np.int64], anchors: Anchors) -> NDArray[np.int64]:
    """The first frame of each part that no anchor ties."""
    first = np.unique(parts, return_index=True)[1]
    return first[~np.isin(parts[first], parts[anchors.index])].astype(np.int64)


def _solved(start: Matrix, links: list[Link], parts: NDArray[np.int64], anchors: Anchors) -> tuple[Solved, list[Link]]:
    """The graph robustly, then without the loops that do not fit the others."""
    held = _held(parts, anchors)
    robust = solve_graph(start, _edges(links), held, anchors, final=False)
    kept = [
        link for link, square in zip(links, robust.squares, strict=True) if link.kind != "loop" or square < _LOOP_CHI2
    ]
    return _solve_plainly(robust.poses, kept, parts, anchors), kept


def _solve_plainly(start: Matrix, links: list[Link], parts: NDArray[np.int64], anchors: Anchors) -> Solved:
    """The graph of links that are all believed."""
    edges = replace(_edges(links), robust=np.zeros(len(links), np.bool_))
    return solve_graph(start, edges, _held(parts, anchors), anchors, rounds=10)


def _trajectory(walk: VisualOdometry, poses: Matrix, covariances: Matrix, links: list[Link]) -> Trajectory:
    status = np.full(len(poses), int(PoseStatus.TRACKED), np.uint8)
    for link in links:
        if link.kind == "bridge":
            status[link.second] = int(PoseStatus.BRIDGED)
    stamps = np.array(walk.stamps_ns, np.int64)
    parts = stretches(len(poses), links)
    poses, covariances, parts, predicted = _between(stamps, poses, covariances, parts)
    status[predicted] = int(PoseStatus.PREDICTED)
    metric = all(geometry.metric for geometry in walk.geometries)
    numbers = np.unique(parts, return_inverse=True)[1].astype(np.int64)
    return Trajectory(stamps, poses, covariances, status, numbers, np.zeros(3), metric)


def _between(
    stamps: NDArray[np.int64], poses: Matrix, covariances: Matrix, parts: NDArray[np.int64]
) -> tuple[Matrix, Matrix, NDArray[np.int64], NDArray[np.int64]]:
    """Short parts between frames of one other part: put where the motion across them says, with half of it as sigma."""
    poses, covariances, parts = poses.copy(), covariances.copy(), parts.copy()
    predicted = []
    for number, size in zip(*np.unique(parts, return_counts=True), strict=True):
        where = np.flatnonzero(parts == number)
        a, b = int(where[0]) - 1, int(where[-1]) + 1
        if size > _SHORT or a < 0 or b >= len(parts) or parts[a] != parts[b] or len(where) != b - a - 1:
            continue
        across = rigid.log(rigid.inverse(poses[a]) @ poses[b])
        for k in where:
            share = (stamps[k] - stamps[a]) / (stamps[b] - stamps[a])
            poses[k] = poses[a] @ rigid.exp(share * across)
            unsure = np.r_[np.full(3, np.linalg.norm(across[:3])), np.full(3, np.linalg.norm(across[3:]) + 0.02)] / 2
            covariances[k] = covariances[a] + np.diag(unsure**2)
            predicted.append(k)
        parts[where] = parts[a]
    return poses, covariances, parts, np.array(predicted, np.int64)


def _findings(
    walk: VisualOdometry, trajectory: Trajectory, kept: list[Link], dropped: int, rig: RigFinding | None,
    applied: RigError,
) -> tuple[Finding, ...]:  # fmt: skip
    found = []
    counts = {status: int((trajectory.status == int(status)).sum()) for status in PoseStatus}
    segments = int(trajectory.segment.max()) + 1
    if counts[PoseStatus.BRIDGED]:
        text = f"{counts[PoseStatus.BRIDGED]} frames bridged by the bottom's shape alone, features were lost"
        found.append(Finding(Code.TRACK_BRIDGED, text))
    if counts[PoseStatus.PREDICTED]:
        text = (
            f"{counts[PoseStatus.PREDICTED]} frames related to no other: interpolated between their neighbours, "
            "do not measure in them"
        )
        found.append(Finding(Code.TRACK_PREDICTED, text, Severity.UNRELIABLE))
    if segments > 1:
        text = f"the dive is in {segments} segments that nothing joins: where they lie to each other is unknown"
        found.append(Finding(Code.TRACK_SEGMENTS, text, advice="more overlap, or poses from outside, joins them"))
    if walk.ambiguous:
        text = f"{len(set(walk.ambiguous))} frames fit at several places about as well: a bottom that repeats itself"
        found.append(Finding(Code.TRACK_AMBIGUOUS, text, advice="poses from outside (odometry, DVL) tell which"))
    if dropped:
        found.append(Finding(Code.TRACK_LOOPS_DROPPED, f"{dropped} loops did not fit the others and were dropped"))
    if rig is not None and rig.applied != RigError():
        found.append(_rig_finding(rig, applied))
    return (*found, *_still(walk, trajectory))


def _still(walk: VisualOdometry, trajectory: Trajectory) -> Iterator[Finding]:
    """Whether all frames were taken from one place: a whole dive's worth of pictures that shows one view."""
    places = trajectory.positions
    extent = float(np.linalg.norm(np.ptp(places, axis=0)))
    if len(places) > 1 and trajectory.segment.max() == 0 and extent < _STILL_SHARE * float(np.nanmedian(walk.depths)):
        unit = "m" if trajectory.metric else "baselines"
        text = f"the camera stood still: all {len(places)} frames within {extent:.2g} {unit}: the model shows one view"
        yield Finding(Code.TRACK_STILL, text, advice="move along the bottom while recording")


def _prior_findings(
    priors: Sequence[Priors], missed: Sequence[Matrix], stamps_ns: Sequence[int], *, upright: bool
) -> Iterator[Finding]:
    """What poses from outside do not tell, and those that the pictures contradict."""
    if not upright:
        text = "gravity is unknown: no attitude from outside; the bottom's plane is laid level"
        advice = "give the dive's recording (--bag: attitude, pressure, fixes) or --poses, where there are any"
        yield Finding(Code.TRACK_GRAVITY_UNKNOWN, text, advice=advice)
    for prior, squares in zip(priors, missed, strict=True):
        if prior.absolute and not len(squares):
            spans = f"expected stamps {_span(stamps_ns)} as the frames', got {_span(prior.stamps_ns)}"
            text = f"{prior.name}: not used: {spans}"
            yield Finding(Code.TRACK_PRIORS_LEFT_OUT, text, advice="its clock is another: give its offset")
        elif len(squares) and (far := int((squares > _PRIOR_CHI2).sum())) > _PRIOR_SHARE * len(squares):
            text = f"{prior.name}: {far} of {len(squares)} do not agree with the pictures and hardly count"
            yield Finding(
                Code.TRACK_PRIORS_DISAGREE, text, advice="check its clock, its frame, and how sure it is said to be"
            )


def _span_findings(priors: Sequence[Priors], given: Sequence[Anchors], poses: Matrix) -> Iterator[Finding]:
    """Positions in another unit: the way they tell is much longer or shorter than the pictures'."""
    for prior, anchors in zip(priors, given, strict=True):
        if not prior.known[:2].all() or len(anchors.index) < 2:
            continue
        told, seen = (_spread(at[:, :2, 3]) for at in (anchors.poses, poses[anchors.index]))
        sure = _PRIOR_SPREAD / np.sqrt(prior.information[0, 0])
        if max(told, seen) > sure and not seen / _ANOTHER_UNIT < told < seen * _ANOTHER_UNIT:
            text = f"{prior.name}: positions spread by {told:.2g} m where the pictures' way spreads by {seen:.2g} m"
            advice = "give positions in metres, in a projected system such as UTM, not in degrees, feet or millimetres"
            yield Finding(Code.TRACK_PRIORS_DISAGREE, text, advice=advice)


def _spread(places: Matrix) -> float:
    return float(np.sqrt(((places - places.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _span(stamps_ns: Sequence[int] | NDArray[np.int64]) -> str:
    return f"{stamps_ns[0] / 1e9:.3f} to {stamps_ns[-1] / 1e9:.3f} s" if len(stamps_ns) else "none"


def _rig_finding(rig: RigFinding, applied: RigError) -> Finding:
    text = (
        f"the given calibration is off: disparity by {-rig.error.offset_px:+.3f} px "
        f"(sigma {rig.offset_sigma_px:.3f}), "
        f"focal length by {-100 * rig.error.focal:+.2f} % (sigma {100 * rig.focal_sigma:.2f})"
    )
    done = "corrected here" if applied != RigError() else "not corrected"
    return Finding(Code.TRACK_RIG_OFF, f"{text}; {done}", advice="calibrate the rig anew, in water")


def _statistics(
    walk: VisualOdometry, trajectory: Trajectory, kept: list[Link], tried: int, dropped: int, solved: Solved
) -> dict[str, Any]:
    kinds = [link.kind for link in kept]
    return {
        "frames": len(trajectory), "segments": int(trajectory.segment.max()) + 1, "relations": kinds.count("track"),
        "bridges": kinds.count("bridge"), "loops": kinds.count("loop"), "loops_tried": tried, "loops_dropped": dropped,
        "ambiguous": len(set(walk.ambiguous)), "graph_rounds": solved.rounds,
        "inliers_median": float(np.median([link.relation.inliers for link in kept])) if kept else 0.0,
    }  # fmt: skip
