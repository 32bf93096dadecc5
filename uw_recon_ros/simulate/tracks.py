"""The course of a longer dive: tracks over a bottom, and what goes wrong on them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from uw_recon_ros.simulate.params import CourseParams, SimulateParams
from uw_recon_ros.simulate.rig import Pose, looking_up, rotation_about
from uw_recon_ros.types import Matrix

_WOBBLE_M = 6.0  # of track for one swing of heading and altitude


@dataclass(frozen=True)
class Waypoint:
    """Where the vehicle is: m, and the direction of the top of its pictures, rad from the world's x axis."""

    x: float
    y: float
    direction: float


def _lawnmower(s: float, leg: float, spacing: float) -> Waypoint:
    """Legs along y, joined by half circles, always towards larger x."""
    radius = spacing / 2
    number, rest = divmod(s, leg + math.pi * radius)
    x, up = number * spacing, number % 2 == 0
    if rest <= leg:
        return Waypoint(x, rest if up else leg - rest, math.pi / 2 if up else -math.pi / 2)
    turned = (rest - leg) / radius
    angle = math.pi - turned if up else math.pi + turned
    middle = leg if up else 0.0
    direction = angle - math.pi / 2 if up else angle + math.pi / 2
    return Waypoint(x + radius + radius * math.cos(angle), middle + radius * math.sin(angle), direction)


def _racetrack(s: float, leg: float, spacing: float) -> Waypoint:
    """Out on one leg, back on another, over the start and on."""
    radius = spacing / 2
    rest = s % (2 * (leg + math.pi * radius))
    if rest <= leg + math.pi * radius:
        return _lawnmower(rest, leg, spacing)
    rest -= leg + math.pi * radius
    if rest <= leg:
        return Waypoint(spacing, leg - rest, -math.pi / 2)
    angle = -(rest - leg) / radius
    return Waypoint(radius + radius * math.cos(angle), radius * math.sin(angle), angle - math.pi / 2)


def _orbit(s: float, radius: float) -> Waypoint:
    angle = s / radius
    return Waypoint(radius * math.cos(angle), radius * math.sin(angle), angle + math.pi)


class Course:
    """Poses along a track, at any time.

    Parameters
    ----------
    params : SimulateParams
        Speed, altitude (``distance_m``), pitch, number of pairs, rate.
    course : CourseParams

    Raises
    ------
    ValueError
        An orbit that looks straight down.
    """

    def __init__(self, params: SimulateParams, course: CourseParams) -> None:
        self.params, self.course = params, course
        if course.track == "orbit" and params.pitch_deg > 75.0:
            raise ValueError(f"pitch_deg: expected at most 75 on an orbit, got {params.pitch_deg}")

    def waypoint(self, s: float) -> Waypoint:
        """Where the vehicle is after `s` m of track."""
        c, p = self.course, self.params
        if c.track == "line":
            return Waypoint(0.0, s, math.pi / 2)
        if c.track == "lawnmower":
            return _lawnmower(s, c.leg_m, c.spacing_m)
        if c.track == "return":
            return _racetrack(s, c.leg_m, c.spacing_m)
        return _orbit(s, p.distance_m * math.cos(math.radians(p.pitch_deg)))

    def pose(self, seconds: float) -> Pose:
        """Of the left optical frame, `seconds` after the first pair."""
        c, p = self.course, self.params
        s = max(p.speed_m_s * seconds, 0.0)
        at, pitch = self.waypoint(s), math.radians(p.pitch_deg)
        swing = math.sin(2 * math.pi * s / _WOBBLE_M)
        heading = at.direction - math.pi / 2 + math.radians(c.heading_swing_deg) * swing
        rotation = rotation_about(np.array([0.0, 0.0, heading])) @ _looking_down(pitch) @ looking_up(p) @ _sway(seconds)
        altitude = p.distance_m * math.sin(pitch) + c.altitude_swing_m * swing
        bob = 0.02 * math.sin(2 * math.pi * seconds / 7.0 + 0.5)
        return Pose(rotation, np.array([at.x, at.y, altitude + bob]))

    def taken(self) -> list[int]:
        """Numbers of the pairs that arrive."""
        c, p = self.course, self.params
        drawn = np.random.default_rng([p.seed, 6]).uniform(size=p.frames) >= c.dropped_share
        drawn[[0, -1]] = True
        track = p.speed_m_s * np.arange(p.frames) / p.rate_hz
        seen = np.abs(track - track[-1] / 2) > c.blackout_m / 2 if c.blackout_m else np.ones(p.frames, np.bool_)
        return [int(k) for k in np.flatnonzero(drawn & seen)]

    def blur_px(self, index: int) -> float:
        """Length of the smear of a pair, px."""
        drawn = np.random.default_rng([self.params.seed, 7, index]).uniform()
        return self.course.blur_px if drawn < self.course.blurred_share else 0.0

    def gain(self, index: int) -> float:
        """Exposure of a pair relative to the first ones."""
        return 1.0 + self.course.exposure_step * (index // 10 % 2)


def _looking_down(pitch: float) -> Matrix:
    s, c = math.sin(pitch), math.cos(pitch)
    return np.array([[1.0, 0.0, 0.0], [0.0, -s, c], [0.0, -c, -s]])


def _sway(seconds: float) -> Matrix:
    """Swell: a few degrees about all axes."""
    phase = 2 * math.pi * seconds / 7.0
    degrees = 1.2 * math.sin(phase), 1.6 * math.sin(0.7 * phase + 1.0), 0.8 * math.sin(1.3 * phase)
    return rotation_about(np.deg2rad(degrees))
