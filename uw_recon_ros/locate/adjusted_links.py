"""Relations made anew by bundle adjustment of a bounded number of frames at a time; the graph lays them together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.align.bundle_adjustment import Adjusted, adjust
from uw_recon_ros.align.bundle_groups import Indices, groups, partners
from uw_recon_ros.align.loops import footprints
from uw_recon_ros.align.point_tracks import guided_matches, join_tracks
from uw_recon_ros.locate.visual_odometry import Link, VisualOdometry
from uw_recon_ros.track.keypoints import RigError, constants
from uw_recon_ros.track.relate import expected_places
from uw_recon_ros.types import Matrix

_LEAST_MATCHES = 20  # of two frames
_SHARP_PX = 0.15  # key points that are worse than this err together: in mud they hang on snow and on the lamp's glow
_AGREE, _BELIEVED = 10.0, 40.0  # chi2 of 6 by which relations may differ from what they were: half of them, each


def adjusted_links(
    walk: VisualOdometry, poses: Matrix, links: list[Link], radii: Matrix, rig: RigError, sigma_px: float
) -> list[Link]:
    """The links, those that bundle adjustment knows better replaced.

    Parameters
    ----------
    walk : VisualOdometry
    poses : (N, 4, 4) float64
        As the graph found them.
    links : list of Link
        Bridges stay as they are.
    radii : (N,) float64
        How far apart two footprints may be that show a common place, m.
    rig : RigError
        What is corrected.
    sigma_px : float
        Of a key point's place.

    Notes
    -----
    A group stays as it was where its key points are not sharp, where what it finds contradicts the relations and how
    sure they are (adjusted, a dive in mud was wrong by three times as much), and where it is no surer than they are.
    """
    seen = footprints(poses, np.nan_to_num(np.array(walk.depths), nan=1.0))
    joined = [link for link in links if link.kind != "bridge"]
    first, second = (np.array([getattr(link, end) for link in joined], np.int64) for end in ("first", "second"))
    pairs = partners(seen, radii, first, second)
    number = {(link.first, link.second): k for k, link in enumerate(links) if link.kind != "bridge"}
    made = list(links)
    for own, whole in groups(seen, pairs):
        group = _Group(walk, poses, whole, pairs, rig)
        found = group.adjusted(sigma_px)
        if found is None or found.sigma_px > _SHARP_PX:
            continue
        inside = set(own.tolist())
        mine = [k for ends, k in number.items() if ends in group.matched and ends[0] in inside]
        better = [_relinked(links[k], found, whole) for k in mine]
        differ = [_differs(links[k], link) for k, link in zip(mine, better, strict=True)]
        if not mine or np.median(differ) > _AGREE or not _is_surer([links[k] for k in mine], better):
            continue
        for k, link, chi2 in zip(mine, better, differ, strict=True):
            if chi2 < _BELIEVED:
                made[k] = link
    return made


class _Group:
    """Frames adjusted together, and what they have in common."""

    def __init__(self, walk: VisualOdometry, poses: Matrix, frames: Indices, pairs: Indices, rig: RigError) -> None:
        self.poses = poses[frames]
        self.lenses = np.array([constants(walk.geometries[k], rig) for k in frames])
        keypoints = [walk.keypoints[int(k)] for k in frames]
        place = {int(k): n for n, k in enumerate(frames)}
        matches = {}
        self.matched: set[tuple[int, int]] = set()
        for i, j in pairs[np.isin(pairs, frames).all(axis=1)].tolist():
            a, b = place[i], place[j]
            motion = rigid.inverse(self.poses[a]) @ self.poses[b]
            expected = expected_places(keypoints[a].measured.astype(np.float64), walk.geometries[j], motion)
            found = guided_matches(keypoints[a], keypoints[b], expected)
            if len(found) >= _LEAST_MATCHES:
                matches[a, b] = found
                self.matched.add((i, j))
        self.seen = join_tracks(keypoints, matches)

    def adjusted(self, sigma_px: float) -> Adjusted | None:
        return adjust(self.poses, self.lenses, self.seen, sigma_px)


def _relinked(link: Link, found: Adjusted, frames: Indices) -> Link:
    """The link as the adjusted poses give it."""
    a, b = np.searchsorted(frames, [link.first, link.second])
    motion = rigid.inverse(found.poses[a]) @ found.poses[b]
    slopes = np.hstack([-rigid.adjoint(rigid.inverse(motion)), np.eye(6)])
    where = np.r_[6 * a : 6 * a + 6, 6 * b : 6 * b + 6]
    covariance = slopes @ found.covariance[np.ix_(where, where)] @ slopes.T
    return replace(link, relation=replace(link.relation, motion=motion, covariance=(covariance + covariance.T) / 2))


def _is_surer(before: list[Link], after: list[Link]) -> bool:
    """Whether most of them are known better than they were."""
    old, new = (
        np.linalg.slogdet(np.array([link.relation.covariance for link in group]))[1] for group in (before, after)
    )
    return bool(np.median(new - old) < 0)


def _differs(before: Link, after: Link) -> float:
    """chi2 of 6 of the change, by what the link was known to before."""
    missed = rigid.log(rigid.inverse(before.relation.motion) @ after.relation.motion)
    return float(missed @ np.linalg.solve(before.relation.covariance, missed))
