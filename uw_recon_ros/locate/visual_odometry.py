"""From frame to frame: which relation joins each frame to those before it, and what had to be done for it."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.track.bridge import Relief, bridge, make_relief
from uw_recon_ros.track.keypoints import Keypoints, PackedKeypoints, find_keypoints, packed
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import RelativePose, contradicts, is_ambiguous, relate, repeats_itself
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import Matrix, StereoGeometry

_BEFORE = 3  # frames back to which a relation is sought
_LOOP_KEYPOINTS = 600


class KeypointShelf(Protocol):
    """Where the key points of all frames are kept: a list, or a file where they are too many for the memory."""

    def append(self, keypoints: PackedKeypoints, /) -> None:
        """Keep those of the next frame."""

    def __getitem__(self, number: int, /) -> PackedKeypoints:
        """Those of a frame."""


@dataclass(frozen=True, eq=False)
class Link:
    """A relation in the graph: frames, kind (``track``, ``bridge`` or ``loop``)."""

    first: int
    second: int
    relation: RelativePose
    kind: str


@dataclass(eq=False)
class VisualOdometry:
    """What is kept of all frames.

    Parameters
    ----------
    stamps_ns, geometries, depths : lists
        One a frame; depths the median in m.
    keypoints : KeypointShelf
        Of each frame, thinned out.
    links : list of Link
    ambiguous : list of int
        Frames whose relation was refused, because another fitted about as well.
    """

    stamps_ns: list[int] = field(default_factory=list)
    keypoints: KeypointShelf = field(default_factory=list[PackedKeypoints])
    geometries: list[StereoGeometry] = field(default_factory=list)
    depths: list[float] = field(default_factory=list)
    links: list[Link] = field(default_factory=list)
    ambiguous: list[int] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Seen:
    index: int
    keypoints: Keypoints
    relief: Relief
    pose: Matrix | None  # in its own stretch; None where it hangs on nothing


class Walker:
    """Joins frames one by one.

    Parameters
    ----------
    params : TrackParams
    shelf : KeypointShelf, optional
        Empty; None: a list.
    """

    def __init__(self, params: TrackParams, shelf: KeypointShelf | None = None) -> None:
        self.params = params
        self.walk = VisualOdometry() if shelf is None else VisualOdometry(keypoints=shelf)
        self._before: deque[_Seen] = deque(maxlen=_BEFORE)
        self._inliers: deque[int] = deque(maxlen=10)
        self._velocity: Matrix | None = None  # motion a frame, where it is known

    def add(self, frame: DisparityFrame, prior: Matrix | None = None) -> None:
        """Join the next frame; `prior` is its pose from outside relative to the one before, if known."""
        keypoints = find_keypoints(frame.left, frame.disparity, frame.sigma, self.params)
        relief = make_relief(frame.disparity, frame.sigma, frame.geometry)
        index = len(self.walk.stamps_ns)
        link = self._link(index, keypoints, relief, frame.geometry, prior)
        self._keep(frame, keypoints)
        pose = np.eye(4)
        if link is not None:
            self.walk.links.append(link)
            if link.kind == "track":
                self._inliers.append(link.relation.inliers)
            start = next(seen for seen in self._before if seen.index == link.first)
            pose = (np.eye(4) if start.pose is None else start.pose) @ link.relation.motion
        self._velocity = link.relation.motion if link is not None and link.first == index - 1 else None
        self._before.append(_Seen(index, keypoints, relief, pose))

    def _keep(self, frame: DisparityFrame, keypoints: Keypoints) -> None:
        depth = frame.geometry.depth_from_disparity(frame.disparity[::8, ::8])
        known = depth[np.isfinite(depth)]
        self.walk.stamps_ns.append(frame.stamp_ns)
        self.walk.geometries.append(frame.geometry)
        self.walk.depths.append(float(np.median(known)) if known.size else float("nan"))
        self.walk.keypoints.append(packed(keypoints, _LOOP_KEYPOINTS))

    def _link(
        self, index: int, keypoints: Keypoints, relief: Relief, geometry: StereoGeometry, prior: Matrix | None
    ) -> Link | None:
        guess = prior if prior is not None else self._velocity
        for seen in reversed(self._before):
            relation = self._relation(index, seen, keypoints, geometry, guess if seen.index == index - 1 else None)
            if relation is not None:
                return Link(seen.index, index, relation, "track")
            if seen.index == index - 1 and guess is not None:
                known = 0.02 * float(np.nanmedian(relief.points[..., 2])) if np.isfinite(relief.points).any() else 0.02
                crossed = bridge(seen.relief, relief, geometry, guess, known)
                if crossed is not None:
                    return Link(seen.index, index, crossed, "bridge")
        return None

    def _relation(
        self, index: int, seen: _Seen, keypoints: Keypoints, geometry: StereoGeometry, guess: Matrix | None
    ) -> RelativePose | None:
        depth = self.walk.depths[-1] if self.walk.depths else float("nan")
        for near in (guess, None) if guess is not None else (None,):
            found = relate(seen.keypoints, keypoints, geometry, self.params, near)
            if found is None:
                continue
            doubtful = contradicts(found, guess, depth, self._inliers) or is_ambiguous(
                seen.keypoints, keypoints, geometry, self.params, found, guess
            )
            if not doubtful and (seen.index == index - 1 or not repeats_itself(keypoints)):
                return found
            self.walk.ambiguous.append(index)
        return None


def walk_frames(
    frames: Iterable[DisparityFrame],
    params: TrackParams,
    priors: Iterator[Matrix | None] | None = None,
    shelf: KeypointShelf | None = None,
) -> VisualOdometry:
    """Join all frames."""
    walker = Walker(params, shelf)
    for frame in frames:
        walker.add(frame, next(priors) if priors is not None else None)
    return walker.walk


def stretches(count: int, links: list[Link]) -> NDArray[np.int64]:
    """(N,) number of the part each frame belongs to: parts are joined by links; numbered in the order of time."""
    parent = list(range(count))

    def top(k: int) -> int:
        while parent[k] != k:
            parent[k] = parent[parent[k]]
            k = parent[k]
        return k

    for link in links:
        a, b = top(link.first), top(link.second)
        parent[max(a, b)] = min(a, b)
    _, numbers = np.unique([top(k) for k in range(count)], return_inverse=True)
    return np.asarray(numbers, np.int64)


def first_poses(count: int, links: list[Link]) -> Matrix:
    """(N, 4, 4) poses along the links, each part from its first frame on. Links go to later frames, in order."""
    poses = np.tile(np.eye(4), (count, 1, 1))
    for link in links:
        poses[link.second] = poses[link.first] @ link.relation.motion
    return poses
