"""The way while the dive goes on: each frame joined to those just before it, or said to be lost."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, replace

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.track.bridge import bridge, make_relief
from uw_recon_ros.track.flow import Corners, find_corners, follow
from uw_recon_ros.track.keypoints import points_of
from uw_recon_ros.track.params import OdometryParams, TrackParams
from uw_recon_ros.track.relate import RelativePose, contradicts, relate, relation_of
from uw_recon_ros.track.repetition import period_px
from uw_recon_ros.trajectory import DisparityFrame, PoseStatus, VehicleState
from uw_recon_ros.types import Matrix

_BEFORE = 3  # frames back to which a motion is sought
_BRIDGED_KNOWN = 0.02  # share of the depth: how sure a bridge has to be
_LEAST_SPEED, _LEAST_TURN = 0.5, 0.5  # m/s and rad/s: what a vehicle may do that nobody sees, at least
_WIDEST_TURN = np.pi  # rad
_NEAR_SHARE = 0.05  # of the depth, from the motion before: no other motion is thought of
_UNKNOWN = 1e6  # variance of a velocity that is not known, (m/s)^2 and (rad/s)^2


@dataclass(frozen=True, eq=False)
class Step:
    """Where a frame is, and how it was found.

    Parameters
    ----------
    stamp_ns : int
    pose : (4, 4) float64
        Left rectified view at the first frame <- at this one, m. Where the way was lost, the last one known.
    covariance : (6, 6) float64
        Of the twist on the right (m, rad), grown since the first frame.
    status : PoseStatus
        ``PREDICTED``: the frame was not seen to hang together with any before it; its pose means nothing.
    velocity : (6,) float64 or None
        Twist a second of the left view in its own axes; None where no motion from the frame before is known.
    velocity_covariance : (6, 6) float64 or None
    inliers : int
        Corners that agree on the motion.
    resumed_after_s : float
        More than zero where the way goes on after it was lost: for so long nobody saw where the vehicle went, and the
        covariance holds what it may have done.
    """

    stamp_ns: int
    pose: Matrix
    covariance: Matrix
    status: PoseStatus
    velocity: Matrix | None = None
    velocity_covariance: Matrix | None = None
    inliers: int = 0
    resumed_after_s: float = 0.0

    @property
    def lost(self) -> bool:
        """Whether nothing is known of where the frame is."""
        return self.status is PoseStatus.PREDICTED


@dataclass(frozen=True, eq=False)
class _Seen:
    stamp_ns: int
    corners: Corners
    pose: Matrix
    covariance: Matrix


def vehicle_state(
    step: Step, frame_id: str, child_frame_id: str, world_from_first: Matrix, view_from_child: Matrix
) -> VehicleState:
    """A step as ROS tells it.

    Parameters
    ----------
    step : Step
        That is not lost.
    frame_id, child_frame_id : str
    world_from_first : (4, 4) float64
        `frame_id` <- the left rectified view at the first frame.
    view_from_child : (4, 4) float64
        Left rectified view <- `child_frame_id`.

    Notes
    -----
    Where no velocity is known it is zero with a variance of 1e6, as ROS's filters take for "do not use".
    """
    pose = world_from_first @ step.pose @ view_from_child
    change = rigid.adjoint(rigid.inverse(view_from_child))  # of twists on the right
    turn = np.kron(np.eye(2), pose[:3, :3])
    velocity, spread = np.zeros(6), _UNKNOWN * np.eye(6)
    if step.velocity is not None and step.velocity_covariance is not None:
        velocity, spread = change @ step.velocity, change @ step.velocity_covariance @ change.T
    covariance = turn @ change @ step.covariance @ change.T @ turn.T
    return VehicleState(step.stamp_ns, frame_id, child_frame_id, pose, covariance, velocity, spread)


class Odometer:
    """Joins frames one by one, in bounded memory.

    Parameters
    ----------
    params : OdometryParams
    track : TrackParams, optional
        How a motion is judged: as offline.

    Notes
    -----
    The way never jumps: what is lost for long goes on from where it was lost, with a covariance that holds how far the
    vehicle may have come meanwhile.
    """

    def __init__(self, params: OdometryParams, track: TrackParams | None = None) -> None:
        self.params, self._track = params, track or TrackParams()
        self._before: deque[_Seen] = deque(maxlen=_BEFORE)
        self._inliers: deque[int] = deque(maxlen=10)
        self._velocity: Matrix | None = None  # twist a second
        self._apart: _Seen | None = None  # the newest frame of what hangs on nothing known

    def add(self, frame: DisparityFrame) -> Step:
        """Join the next frame; stamps have to grow."""
        corners = find_corners(frame, self.params.odometry_corners, self.params.odometry_clahe_clip)
        now = _Seen(frame.stamp_ns, corners, np.eye(4), np.zeros((6, 6)))
        if self._before and corners.geometry != self._before[-1].corners.geometry:
            return self._resumed(now)  # another rig: what was seen by the one before joins nothing
        if not self._before:
            return self._begun(now)
        for seen in reversed(self._before):
            if (found := self._relation(seen, now)) is not None:
                return self._joined(seen, now, found, PoseStatus.TRACKED)
        last = self._before[-1]
        if (crossed := self._bridge(last, now)) is not None:
            return self._joined(last, now, crossed, PoseStatus.BRIDGED)
        return self._lost(now)

    def _begun(self, now: _Seen) -> Step:
        """The first frame that shows enough to go on from."""
        if len(now.corners.spread) < self.params.odometry_inliers:
            return _nowhere(now)
        self._before.append(now)
        return Step(now.stamp_ns, now.pose, now.covariance, PoseStatus.TRACKED)

    def _relation(self, seen: _Seen, now: _Seen) -> RelativePose | None:
        """The motion that enough corners agree on, sought near the guess, then anywhere, then by descriptors."""
        guess, geometry = self._guess(seen, now), now.corners.geometry
        for near in (guess, None) if guess is not None else (None,):
            matches = follow(seen.corners, now.corners, self.params.odometry_window_px, near)
            found = relation_of(matches, geometry, self._track, self.params.odometry_inliers)
            if found is not None and not self._doubtful(seen, now, found, near):
                return found
        first, second = seen.corners.keypoints, now.corners.keypoints
        found = relate(first, second, geometry, self._track, inliers=self.params.odometry_inliers)
        return found if found is not None and not self._doubtful(seen, now, found, guess) else None

    def _doubtful(self, seen: _Seen, now: _Seen, found: RelativePose, guess: Matrix | None) -> bool:
        """Whether another motion may be true: a period of the bottom off, with no guess near by that speaks for it."""
        depth = _depth(seen.corners)
        if guess is not None and np.linalg.norm((guess - found.motion)[:3, 3]) < _NEAR_SHARE * depth:
            return False
        if contradicts(found, guess, depth, self._inliers):
            return True
        period = period_px(seen.corners.gray)
        if period is None:
            return False
        focal = seen.corners.geometry.intrinsics_left[0, 0]
        other = period / focal * depth - float(np.linalg.norm(found.motion[:3, 3]))
        return bool(other < self.params.odometry_max_speed_m_s * _seconds(seen, now))

    def _guess(self, seen: _Seen, now: _Seen) -> Matrix | None:
        if self._velocity is None:
            return None
        guess: Matrix = rigid.exp(self._velocity * _seconds(seen, now))
        return guess

    def _bridge(self, seen: _Seen, now: _Seen) -> RelativePose | None:
        """By the bottom's shape, where the motion before tells where to begin."""
        guess = self._guess(seen, now)
        if guess is None:
            return None
        first, second = (make_relief(c.disparity, c.sigma, c.geometry) for c in (seen.corners, now.corners))
        return bridge(first, second, now.corners.geometry, guess, _BRIDGED_KNOWN * _depth(seen.corners))

    def _joined(self, seen: _Seen, now: _Seen, found: RelativePose, status: PoseStatus) -> Step:
        back, seconds = rigid.adjoint(rigid.inverse(found.motion)), _seconds(seen, now)
        covariance = back @ seen.covariance @ back.T + found.covariance
        joined = replace(now, pose=seen.pose @ found.motion, covariance=covariance)
        self._before.append(joined)
        self._apart = None
        self._velocity = rigid.log(found.motion) / seconds
        if status is PoseStatus.TRACKED:
            self._inliers.append(found.inliers)
        return Step(
            now.stamp_ns, joined.pose, covariance, status, self._velocity, found.covariance / seconds**2, found.inliers
        )

    def _lost(self, now: _Seen) -> Step:
        """Not joined: wait to see the last place again, and after a while go on from whatever hangs together."""
        last, apart = self._before[-1], self._apart
        if len(now.corners.spread) >= self.params.odometry_inliers:
            self._apart = now
        if apart is None or _seconds(last, now) < self.params.odometry_lost_s:
            return _nowhere(now)
        if (found := self._relation(apart, now)) is None:
            return _nowhere(now)
        self._resumed(apart)
        step = self._joined(self._before[-1], now, found, PoseStatus.TRACKED)
        return replace(step, resumed_after_s=_seconds(last, now))

    def _resumed(self, now: _Seen) -> Step:
        """Go on from the last pose, as unsure as the time since then makes it."""
        last = self._before[-1]
        seconds = _seconds(last, now)
        speed = np.abs(self._velocity) if self._velocity is not None else np.zeros(6)
        moved = max(float(np.linalg.norm(speed[:3])), _LEAST_SPEED) * seconds
        turned = min(max(float(np.linalg.norm(speed[3:])), _LEAST_TURN) * seconds, _WIDEST_TURN)
        covariance = last.covariance + np.diag(np.r_[np.full(3, moved), np.full(3, turned)] ** 2)
        self._before.clear()
        self._inliers.clear()
        self._velocity = self._apart = None
        self._before.append(replace(now, pose=last.pose, covariance=covariance))
        return Step(now.stamp_ns, last.pose, covariance, PoseStatus.TRACKED, resumed_after_s=seconds)


def _nowhere(now: _Seen) -> Step:
    return Step(now.stamp_ns, np.full((4, 4), np.nan), np.full((6, 6), np.nan), PoseStatus.PREDICTED)


def _seconds(first: _Seen, second: _Seen) -> float:
    return (second.stamp_ns - first.stamp_ns) * 1e-9


def _depth(corners: Corners) -> float:
    """Median, m."""
    return float(np.median(points_of(corners.measured, corners.geometry)[:, 2]))
