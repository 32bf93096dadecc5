"""What a bag knows of the vehicle's way beside its pictures: odometry, attitude, position fixes, pressure."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.bags import open_bag
from uw_recon_ros.bags.messages import decode, stamp_ns
from uw_recon_ros.bags.reader import BagReader
from uw_recon_ros.errors import BagError
from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.georeference.crs import LOCAL, Crs, utm_from_geographic, utm_zone
from uw_recon_ros.locate.priors import Priors
from uw_recon_ros.types import Matrix, optical_frame

_ODOMETRY, _IMU, _FIX = "nav_msgs/msg/Odometry", "sensor_msgs/msg/Imu", "sensor_msgs/msg/NavSatFix"
_PRESSURE, _TF = "sensor_msgs/msg/FluidPressure", "tf2_msgs/msg/TFMessage"
_ATMOSPHERE_PA, _ABSOLUTE_PA, _PA_A_METRE = 101_325.0, 80_000.0, 1025.0 * 9.80665
_ORIGIN = SimpleNamespace(x=0.0, y=0.0, z=0.0)
_SPACED_NS = 40_000_000  # messages of a topic are looked at no more often
_TF_SIGMAS = 0.5, 0.1  # m, rad: tf does not say how sure it is
_NO_HEADING = 1e-6  # information, 1/rad^2: a compass beside thrusters and steel is not believed


@dataclass(frozen=True, eq=False)
class Outside:
    """What bags know.

    Parameters
    ----------
    priors : list of Priors
        Positions less `origin`.
    crs : Crs
        Of the positions.
    origin : (3,) float64
        m.
    findings : list of Finding
        What was left out, and why.
    """

    priors: list[Priors]
    crs: Crs = LOCAL
    origin: Matrix = field(default_factory=lambda: np.zeros(3))
    findings: list[Finding] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class _Frames:
    """How frames of the vehicle lie to the rectified left view.

    Parameters
    ----------
    camera : str
        The left camera's optical frame.
    rect_from_raw : (3, 3) float64
    fixed : dict
        Child frame to its parent and (4, 4) parent <- child, of ``/tf_static``.
    """

    camera: str
    rect_from_raw: Matrix
    fixed: dict[str, tuple[str, Matrix]]

    def view_in(self, frame: str) -> Matrix | None:
        """(4, 4) `frame` <- rectified left view; None where nothing says."""
        ups = self._up(frame), self._up(self.camera)
        common = next((name for name in ups[0] if name in ups[1]), None)
        if common is None:
            return None
        raw = np.linalg.inv(ups[0][common]) @ ups[1][common]
        turn = np.eye(4)
        turn[:3, :3] = self.rect_from_raw.T
        view: Matrix = raw @ turn
        return view

    def _up(self, frame: str) -> dict[str, Matrix]:
        """Ancestors <- frame."""
        found, at = {frame: np.eye(4)}, frame
        while at in self.fixed and self.fixed[at][0] not in found:
            parent, motion = self.fixed[at]
            found[parent] = motion @ found[at]
            at = parent
        return found


def read_outside(paths: Sequence[str], rect_from_raw: Matrix) -> Outside:
    """Poses, attitudes, fixes and depths that bags hold beside pictures, each as sure as it says and no surer.

    Parameters
    ----------
    paths : sequence of str
        Bags of one dive, in the order of time.
    rect_from_raw : (3, 3) float64
        Rectified left view <- the left camera's optical frame.

    Raises
    ------
    BagError
        A bag cannot be read.
    """
    known: dict[str, list[Any]] = {}
    camera, fixed = "", dict[str, tuple[str, Matrix]]()
    for path in paths:
        with open_bag(path) as bag:
            camera = camera or _camera_frame(bag)
            for topic, message in _of_interest(bag):
                known.setdefault(topic, []).append(message)
    moving: dict[tuple[str, str], list[tuple[int, Matrix]]] = {}
    for topic in [name for name, messages in known.items() if _kind(messages[0]) == _TF]:
        for t in (t for message in known.pop(topic) for t in message.transforms if _is_turn(t.transform.rotation)):
            child, parent = _bare(t.child_frame_id), _bare(t.header.frame_id)
            motion = _pose(t.transform.translation, t.transform.rotation)
            if topic.endswith("tf_static"):
                fixed[child] = parent, motion
            else:
                moving.setdefault((parent, child), []).append((stamp_ns(t), motion))
    frames = _Frames(_bare(camera), rect_from_raw, fixed)
    outside = _gathered(known, frames)
    if not any(p.smooth for p in outside.priors):  # tf repeats what odometry says
        outside.priors.extend(_of_tf(moving, frames, beside=any(p.known[:2].all() for p in outside.priors)))
    return outside


def _of_tf(moving: dict[tuple[str, str], list[tuple[int, Matrix]]], frames: _Frames, *, beside: bool) -> list[Priors]:
    """The fullest transform that moves a frame to which the camera is fixed; only its differences beside positions."""
    seen = [(*pair, found, view) for pair, found in moving.items() if (view := frames.view_in(pair[1])) is not None]
    if not seen:
        return []
    parent, child, found, view = max(seen, key=lambda item: len(item[2]))
    information = np.diag([_TF_SIGMAS[0] ** -2] * 3 + [_TF_SIGMAS[1] ** -2] * 3)
    poses = [motion @ view for _, motion in found]
    made = _made(f"/tf {parent} to {child}", [stamp for stamp, _ in found], poses, information, smooth=True)
    return [] if made is None else [replace(made, absolute=not beside)]


def _bare(frame: str) -> str:
    return optical_frame(frame).lstrip("/")


def _kind(message: Any) -> str:
    return str(message.__msgtype__)


def _camera_frame(bag: BagReader) -> str:
    try:
        left = bag.stereo_topics().left
    except BagError:
        return ""
    return next((message.header.frame_id for _, message in bag.messages([left])), "")


def _of_interest(bag: BagReader) -> Iterator[tuple[str, Any]]:
    kinds = {_ODOMETRY, _IMU, _FIX, _PRESSURE}
    names = [
        t.name for t in bag.topics if t.type in kinds or (t.type == _TF and t.name.endswith(("/tf", "/tf_static")))
    ]
    last: dict[str, int] = {}
    for raw in bag.raw_messages(names) if names else ():
        if raw.type == _TF or raw.log_ns - last.get(raw.topic, -_SPACED_NS) >= _SPACED_NS:
            last[raw.topic] = raw.log_ns
            try:
                yield raw.topic, decode(raw)
            except BagError as error:
                bag.note(str(error))


def _pose(place: Any, turn: Any) -> Matrix:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    pose[:3, 3] = place.x, place.y, place.z
    return pose


def _gathered(known: dict[str, list[Any]], frames: _Frames) -> Outside:
    """The topic of each kind that says most, turned into what is known of the left view."""
    chosen = {kind: _fullest(known, kind) for kind in (_ODOMETRY, _IMU, _FIX, _PRESSURE)}
    crs, origin, findings, priors = LOCAL, np.zeros(3), [], []
    if (topic := chosen[_FIX]) is not None:
        crs, origin, fixes = _fixes(topic, known[topic])
        priors += [] if fixes is None else [fixes]
    makers: list[tuple[str, Callable[[str, list[Any], _Frames], Priors | None]]] = [
        (_IMU, _attitudes), (_ODOMETRY, _odometry), (_PRESSURE, _depths),
    ]  # fmt: skip
    for kind, make in makers:
        topic = chosen[kind]
        made = make(topic, known[topic], frames) if topic is not None else None
        if made is not None:
            priors.append(made)
        elif topic is not None:
            findings.append(_left_out(topic, known[topic][0], frames))
    fixed = any(p.known[:2].all() and not p.smooth for p in priors)
    return Outside([replace(p, absolute=False) if p.smooth and fixed else p for p in priors], crs, origin, findings)


def _fullest(known: dict[str, list[Any]], kind: str) -> str | None:
    topics = [name for name, messages in known.items() if _kind(messages[0]) == kind]
    return max(topics, key=lambda name: len(known[name])) if topics else None


def _left_out(topic: str, message: Any, frames: _Frames) -> Finding:
    frame = getattr(message, "child_frame_id", "") or message.header.frame_id
    text = (
        f"{topic}: left out: expected poses in a frame that /tf_static joins to {frames.camera or 'the camera'}, "
        f"got {frame!r}, which it does not join, or no valid pose"
    )
    return Finding(Code.TRACK_PRIORS_LEFT_OUT, text, advice="record /tf_static, or give poses by --poses")


def _made(name: str, stamps: list[int], poses: list[Matrix], information: Matrix, *, smooth: bool) -> Priors | None:
    """In the order of time, each stamp once."""
    order = np.unique(np.array(stamps, np.int64), return_index=True)[1]
    if len(order) < 2:
        return None
    return Priors(np.array(stamps, np.int64)[order], np.array(poses)[order], information, smooth, name)


def _sigma(variances: list[float], least: float, unknown: float) -> float:
    """What a topic says of itself, at least `least`; `unknown` where it says nothing."""
    told = [v for v in variances if np.isfinite(v) and v > 0]
    return max(float(np.sqrt(np.median(told))), least) if told else unknown


def _attitudes(topic: str, messages: list[Any], frames: _Frames) -> Priors | None:
    view = frames.view_in(_bare(messages[0].header.frame_id))
    good = [m for m in messages if m.orientation_covariance[0] >= 0 and _is_turn(m.orientation)]
    if view is None or not good:
        return None
    poses = [_pose(_ORIGIN, m.orientation) @ view for m in good]
    for pose in poses:
        pose[:3, 3] = 0.0
    tilt = _sigma([float(m.orientation_covariance[k]) for m in good for k in (0, 4)], 0.01, 0.03)
    information = np.diag([0.0, 0.0, 0.0, tilt**-2, tilt**-2, _NO_HEADING])
    return _made(topic, [stamp_ns(m) for m in good], poses, information, smooth=False)


def _is_turn(q: Any) -> bool:
    return bool(abs(np.linalg.norm([q.x, q.y, q.z, q.w]) - 1) < 0.1)


def _odometry(topic: str, messages: list[Any], frames: _Frames) -> Priors | None:
    view = frames.view_in(_bare(messages[0].child_frame_id))
    good = [m for m in messages if _is_turn(m.pose.pose.orientation)]
    if view is None or not good:
        return None
    poses = [_pose(m.pose.pose.position, m.pose.pose.orientation) @ view for m in good]
    place = _sigma([float(m.pose.covariance[k]) for m in good for k in (0, 7, 14)], 0.1, 0.5)
    turn = _sigma([float(m.pose.covariance[k]) for m in good for k in (21, 28, 35)], 0.03, 0.1)
    information = np.diag([place**-2] * 3 + [turn**-2] * 3)
    return _made(topic, [stamp_ns(m) for m in good], poses, information, smooth=True)


def _depths(topic: str, messages: list[Any], _: _Frames) -> Priors | None:
    """Heights below the surface, or below where a gauge reads zero; where on the vehicle is not asked."""
    good = [m for m in messages if np.isfinite(m.fluid_pressure) and m.fluid_pressure > 0]
    absolute = _ATMOSPHERE_PA if good and np.median([m.fluid_pressure for m in good]) > _ABSOLUTE_PA else 0.0
    poses = [np.eye(4) for _ in good]
    for pose, m in zip(poses, good, strict=True):
        pose[2, 3] = -(m.fluid_pressure - absolute) / _PA_A_METRE
    height = _sigma([m.variance / _PA_A_METRE**2 for m in good], 0.02, 0.05)
    information = np.diag([0.0, 0.0, height**-2, 0.0, 0.0, 0.0])
    return _made(topic, [stamp_ns(m) for m in good], poses, information, smooth=False)


def _fixes(topic: str, messages: list[Any]) -> tuple[Crs, Matrix, Priors | None]:
    good = [m for m in messages if m.status.status >= 0 and np.isfinite([m.latitude, m.longitude]).all()]
    if len(good) < 2:
        return LOCAL, np.zeros(3), None
    latitude, longitude = np.array([[m.latitude, m.longitude] for m in good]).T
    crs = utm_zone(float(np.median(latitude)), float(np.median(longitude)))
    height = np.nan_to_num([m.altitude for m in good])
    places = np.column_stack([utm_from_geographic(latitude, longitude, crs), height])
    origin = np.array([*np.round(np.median(places[:, :2], axis=0), -3), 0.0])
    poses = np.tile(np.eye(4), (len(good), 1, 1))
    poses[:, :3, 3] = places - origin
    told = [m for m in good if m.position_covariance_type > 0]
    level = _sigma([float(m.position_covariance[k]) for m in told for k in (0, 4)], 0.02, 3.0)
    up = _sigma([float(m.position_covariance[8]) for m in told], 0.02, 6.0)
    information = np.diag([level**-2, level**-2, up**-2, 0.0, 0.0, 0.0])
    return crs, origin, _made(topic, [stamp_ns(m) for m in good], list(poses), information, smooth=False)
