"""A simulated dive: every frame as the cameras take it, and the truth about it."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from uw_recon_ros.simulate import lamp as lamps
from uw_recon_ros.simulate import snow as snows
from uw_recon_ros.simulate.backdrop import add_lamps, place_lamps, surface_from_below
from uw_recon_ros.simulate.disturb import port_pattern, recorded, through_port
from uw_recon_ros.simulate.fish import with_fish
from uw_recon_ros.simulate.image_sensor import expose, exposure_of, lens_blur
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.ray_casting import FAR_M, cast
from uw_recon_ros.simulate.render import render
from uw_recon_ros.simulate.rig import Pose, make_rig, pinhole_directions, pixel_directions, pose_at, project
from uw_recon_ros.simulate.scene import Scene, make_scene
from uw_recon_ros.simulate.water import attenuate, daylight_veil, forward_scatter, make_water
from uw_recon_ros.types import (
    ByteImage,
    CameraModel,
    FloatImage,
    Matrix,
    RawImage,
    Status,
    StereoCalibration,
    StereoGeometry,
)

_FIRST_NS = 1_700_000_000_000_000_000
_HIDDEN = 1e-4  # relative; less is the same surface
_BANDS, _MOMENTS = 24, 5  # of rows that a rolling shutter reads at once; of an exposure


@dataclass(frozen=True, eq=False)
class SimulatedFrame:
    """One pair and the truth about it.

    Parameters
    ----------
    left, right : (H, W, 3) or (H, W) uint8 or uint16
        Raw images: RGB or mono.
    depth : (H, W) float32
        Of the raw left image, along its optical axis, m; NaN where nothing is met.
    status : (H, W) uint8
        `Status` bits of the raw left image: OCCLUDED, OUTSIDE the right image, or 0.
    pose : Pose
        Of the left optical frame in the world.
    stamp_ns : int
    """

    left: RawImage
    right: RawImage
    depth: FloatImage
    status: ByteImage
    pose: Pose
    stamp_ns: int


@dataclass(frozen=True, eq=False)
class _View:
    """A camera in the rig's frame (the left optical frame)."""

    origin: Matrix
    rotation: Matrix  # rig from camera
    directions: Matrix  # rig frame
    glow: Matrix
    pixel: float
    gain: float
    number: int


class Dive:
    """All frames of a dive; each depends on the parameters and its number alone.

    Parameters
    ----------
    params : SimulateParams
    scene : Scene or None
        What is seen; None: what the parameters name.
    """

    def __init__(self, params: SimulateParams, scene: Scene | None = None) -> None:
        self.params = params
        self.scene = make_scene(params) if scene is None else scene
        self.rig = make_rig(params)
        self.water = make_water(
            params.water, turbidity=params.turbidity, water_depth_m=params.water_depth_m,
            blur_px_m=params.forward_scatter_px_m,
        )  # fmt: skip
        self._lamp = lamps.lamp_in_rig(params.lamp, self.water)
        self._snow = snows.make_snow(params.snow_per_m3, params.seed)
        self._cameras = self._camera(0), self._camera(1)

    @property
    def calibration(self) -> StereoCalibration:
        """The true one, whether the bag tells it or not."""
        return self.rig.calibration

    @property
    def geometry(self) -> StereoGeometry:
        """Of the rectified views that the calibration defines."""
        return self.rig.geometry

    def _camera(self, number: int) -> _View:
        camera = self.calibration.right if number else self.calibration.left
        rotation = self.rig.right_from_left.T if number else np.eye(3)
        origin = self.rig.right_center if number else np.zeros(3)
        directions = np.ascontiguousarray(pixel_directions(camera) @ rotation.T)
        glow = lamps.glow_table(self._lamp, self.water, origin, directions)
        gain = 1.0 + self.params.gain_difference if number else 1.0
        return _View(origin, rotation, directions, glow, float(1.0 / camera.k[0, 0]), gain, number)

    def seconds(self, index: int) -> float:
        """Time of a frame since the first, s."""
        return index / self.params.rate_hz

    def stamp_ns(self, index: int) -> int:
        """Header stamp of a frame."""
        return _FIRST_NS + round(index * 1e9 / self.params.rate_hz)

    def pose(self, index: int) -> Pose:
        """Of the left optical frame at a frame; with a rolling shutter, when its first row is read."""
        return self.pose_after(self.seconds(index))

    def pose_after(self, seconds: float) -> Pose:
        """Of the left optical frame, `seconds` after the first frame."""
        return pose_at(self.params, seconds)

    def scene_at(self, index: int) -> Scene:
        """What there is at a frame."""
        return self.scene_after(self.seconds(index))

    def scene_after(self, seconds: float) -> Scene:
        """What there is `seconds` after the first frame."""
        p = self.params
        return with_fish(self.still_scene(seconds), p.fish, p.seed, self.pose_after(0.0), p.distance_m, seconds)

    def still_scene(self, seconds: float) -> Scene:
        """The same without fish."""
        return self.scene

    def gain(self, index: int) -> float:
        """Exposure of a frame relative to the first."""
        return 1.0

    def smear(self, light: FloatImage, index: int) -> FloatImage:
        """What the motion during the exposure does to a picture."""
        return light

    @property
    def _daylight(self) -> Matrix:
        return self.params.daylight * self.water.daylight

    def _see(self, view: _View, index: int, step: int = 1) -> tuple[Matrix, FloatImage]:
        """Ranges and the light that arrives at one camera; every `step`-th pixel, without rows or moments then."""
        began, p = self.seconds(index), self.params
        directions = view.directions[::step, ::step]
        bands = _BANDS if p.readout_ms > 0 and step == 1 else 1
        moments = _MOMENTS if p.exposure_ms > 0 and step == 1 else 1
        parts = []
        for rows in np.array_split(np.arange(len(directions)), bands):
            read = began + 1e-3 * p.readout_ms * rows[0] / len(directions)
            times = read + 1e-3 * p.exposure_ms * (np.arange(moments) - (moments - 1) / 2) / moments
            looks = [self._look(view, float(time), directions[rows], step) for time in times]
            parts.append((looks[moments // 2][0], np.mean([radiance for _, radiance in looks], axis=0)))
        ranges, radiance = (np.concatenate(of_all) for of_all in zip(*parts, strict=True))
        return ranges, self._through_water(view, ranges, radiance.astype(np.float32), index, step)

    def _look(self, view: _View, seconds: float, directions: Matrix, step: int) -> tuple[Matrix, Matrix]:
        """Ranges and the light that leaves the surfaces, at one moment."""
        pose = self.pose_after(seconds)
        turned = np.ascontiguousarray(directions @ pose.rotation.T)
        origin = pose.rotation @ view.origin + pose.position
        lamp = lamps.lamp_in_world(self._lamp, pose)
        daylight = np.array([*self._daylight, self.params.caustics, seconds])
        return render(self.scene_after(seconds), lamp, daylight, origin, turned, view.pixel * step)

    def _through_water(self, view: _View, ranges: Matrix, radiance: FloatImage, index: int, step: int) -> FloatImage:
        reach = ranges.astype(np.float32)
        light = forward_scatter(attenuate(radiance, reach, self.water), reach, self.water)
        light += daylight_veil(reach, self.water, self.params.daylight)
        if self.params.surface_above:
            light += self._surface_behind(view, ranges, index, step)
        if step == 1:
            light += lamps.lamp_glow(view.glow, ranges)
            if self.params.other_lamps:
                add_lamps(light, self._other_lamps(view, index), self._model(view), ranges, self.water)
            self._snow_into(light, view, ranges, index)
            return lens_blur(light, self.params.lens_blur_px)
        return light

    def _surface_behind(self, view: _View, ranges: Matrix, index: int, step: int) -> FloatImage:
        """Of the waves above, where nothing is met."""
        pose, p = self.pose(index), self.params
        origin = pose.rotation @ view.origin + pose.position
        directions = view.directions[::step, ::step] @ pose.rotation.T
        sent = surface_from_below(directions, origin, self.seconds(index), p.water_depth_m, self.water)
        behind: FloatImage = np.where(np.isfinite(ranges)[..., None], np.float32(0), np.float32(p.daylight) * sent)
        return behind

    def _other_lamps(self, view: _View, index: int) -> Matrix:
        """Their places in a camera's frame."""
        p, pose = self.params, self.pose(index)
        places = place_lamps(p.other_lamps, p.seed, p.distance_m, self.pose(0))
        in_rig = (places - pose.position) @ pose.rotation
        in_camera: Matrix = (in_rig - view.origin) @ view.rotation
        return in_camera

    def _model(self, view: _View) -> CameraModel:
        return self.calibration.right if view.number else self.calibration.left

    def _snow_into(self, light: FloatImage, view: _View, ranges: Matrix, index: int) -> None:
        in_rig = snows.snow_before(self._snow, self.pose(index), self.seconds(index))
        in_camera = (in_rig - view.origin) @ view.rotation
        kept = snows.visible(in_camera)
        camera = self._model(view)
        u, v = project(in_camera[kept], camera)
        distances = np.linalg.norm(in_camera[kept], axis=1)
        sent = snows.snow_light(in_rig[kept], self._lamp, self._daylight)
        arriving = sent * np.exp(-distances[:, None] * self.water.attenuation)
        arriving += daylight_veil(distances.astype(np.float32), self.water, self.params.daylight)
        arriving += lamps.glow_at(view.glow, np.stack([u, v], axis=1), distances)
        radii_px = camera.k[0, 0] * self._snow.radii[kept] / in_camera[kept, 2]
        pixels = np.stack([u, v], axis=1)
        snows.add_spots(light, ranges, pixels, distances, radii_px, arriving, self.params.distance_m)

    @cached_property
    def _exposure(self) -> float:
        """One for all frames and both cameras, from a coarse look at the first."""
        return exposure_of(self._see(self._cameras[0], 0, step=8)[1])

    def _take(self, view: _View, index: int) -> tuple[Matrix, RawImage]:
        ranges, light = self._see(view, index)
        rng = np.random.default_rng([self.params.seed, 3, index, view.number])
        p = self.params
        exposure = self._exposure * view.gain * self.gain(index)
        if p.port_dirt > 0:
            light = through_port(light, port_pattern(ranges.shape, p.seed, view.number), p.port_dirt)
        image = expose(self.smear(light, index), exposure, rng, noise=p.noise, bits=p.bits, mono=p.mono)
        return ranges, recorded(image, p)

    def frame(self, index: int) -> SimulatedFrame:
        """Take the pair number `index`, from 0 on. Both cameras are worked on at the same time."""
        _ = self._exposure
        with ThreadPoolExecutor(1) as pool:
            other = pool.submit(self._take, self._cameras[1], index)
            ranges, left = self._take(self._cameras[0], index)
            status = self._status(ranges, index)
            right = other.result()[1]
        depth = np.where(np.isfinite(ranges), ranges * self._cameras[0].directions[..., 2], np.nan)
        return SimulatedFrame(left, right, depth.astype(np.float32), status, self.pose(index), self.stamp_ns(index))

    def _status(self, ranges: Matrix, index: int) -> ByteImage:
        """Which points of the raw left image the right camera cannot see, by looking from it."""
        status = np.zeros(ranges.shape, np.uint8)
        known = np.isfinite(ranges)
        points = ranges[known][:, None] * self._cameras[0].directions[known]
        in_right = (points - self.rig.right_center) @ self.rig.right_from_left.T
        u, v = project(in_right, self.calibration.right)
        p = self.params
        inside = (u > -0.5) & (u < p.width - 0.5) & (v > -0.5) & (v < p.height - 0.5)
        apart = points[inside] - self.rig.right_center
        expected = np.linalg.norm(apart, axis=1)
        met = self._cast(self.rig.right_center, apart / expected[:, None], index, expected * (1.0 - _HIDDEN))
        found = np.full(len(points), int(Status.OUTSIDE), np.uint8)
        found[inside] = np.where(np.isfinite(met), int(Status.OCCLUDED), 0)
        status[known] = found
        return status

    def _cast(self, origin: Matrix, directions: Matrix, index: int, limits: Matrix | None = None) -> Matrix:
        """Ranges along rays (N, 3) given in the rig's frame."""
        pose = self.pose(index)
        if limits is None:
            limits = np.full(len(directions), FAR_M)
        scene = self.scene_at(index)
        turned = np.ascontiguousarray(directions @ pose.rotation.T)
        start = pose.rotation @ origin + pose.position
        return cast(scene.heights, scene.grid, scene.blocks, scene.objects, start, turned, limits)

    def true_depth(self, index: int, geometry: StereoGeometry, width: int, height: int) -> FloatImage:
        """Exact depth of any rectified left view, by casting its own rays.

        Parameters
        ----------
        index : int
            Frame.
        geometry : StereoGeometry
            Of the view, e.g. what the rectify stage made; metric or not, its intrinsics and rotation count.
        width, height : int
            px.

        Returns
        -------
        (H, W) float32
            Along the view's optical axis, m; NaN where nothing is met.
        """
        rays = pinhole_directions(geometry.intrinsics_left, width, height)
        rect_from_raw = np.array(geometry.rect_from_raw_left)
        ranges = self._cast(np.zeros(3), (rays @ rect_from_raw).reshape(-1, 3), index).reshape(height, width)
        depth: FloatImage = np.where(np.isfinite(ranges), ranges * rays[..., 2], np.nan).astype(np.float32)
        return depth

    def true_disparity(self, index: int, geometry: StereoGeometry, width: int, height: int) -> FloatImage:
        """`true_depth` as disparity in px; NaN where nothing is met. The geometry's baseline must be known."""
        return geometry.disparity_from_depth(self.true_depth(index, geometry, width, height))
