"""Navigation's readers on what the pipeline publishes of a simulated dive, against the dive's truth.

The readers (`consumers`) are written after the sources of nav2_costmap_2d, octomap_server, rtabmap_ros, MoveIt,
depth_image_proc and stereo_image_proc; none of these runs here.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache
from typing import Any

import numpy as np
import pytest
from helpers import consumers
from helpers.consumers import COSTMAP, LATCHED, RELIABLE, SENSOR_DATA, Costmap, Frames, OctomapServer, xyz
from helpers.ros_bench import Bench, color, own_domain
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from stereo_msgs.msg import DisparityImage
from visualization_msgs.msg import Marker

from uw_recon_ros.nodes.pipeline_node import PipelineNode
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.rectified_frame import rectifying_transform
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import CameraModel, StereoGeometry

pytestmark = pytest.mark.timeout(3600)
LIMIT_S = 600.0  # on hanging
SIZE = {"width": 320, "height": 240}
FRAME = "simulated_left_optical_frame"
METRIC = {
    "depth/image_rect": Image,
    "depth/sigma": Image,
    "depth/camera_info": CameraInfo,
    "points2": PointCloud2,
    "points2_filtered": PointCloud2,
}
RECTIFIED = {
    "rectified/left/image_rect": Image,
    "rectified/right/image_rect": Image,
    "rectified/left/image_rect_color": Image,
    "rectified/left/camera_info": CameraInfo,
    "rectified/right/camera_info": CameraInfo,
}


@cache
def dive(axis: str) -> tuple[Dive, Any]:
    """A pipe on the seabed, cameras mounted crookedly; the first pair of it."""
    simulated = Dive(SimulateParams(scene="pipe", water="3C", axis=axis, seed=4, misalignment_deg=2.0, **SIZE))
    return simulated, simulated.frame(0)


def camera_info(camera: CameraModel, stamp_ns: int) -> CameraInfo:
    info = CameraInfo(header=messages.header(stamp_ns, camera.frame_id), width=camera.width, height=camera.height)
    info.distortion_model, info.d = camera.distortion_model, camera.d.tolist()
    info.k, info.r, info.p = camera.k.ravel(), camera.r.ravel(), camera.p.ravel()
    return info


class Heard:
    """One frame of a dive through the pipeline: messages by topic, as best-effort and as reliable readers got them."""

    def __init__(self, axis: str, *, calibrated: bool = True, **parameters: Any) -> None:
        self.dive, frame = dive(axis)
        self.stamp_ns = frame.stamp_ns
        self.bench = Bench(own_domain())  # several live at once
        node = self.bench.start(PipelineNode, **parameters)
        everything = {**METRIC, **RECTIFIED, "disparity": DisparityImage, "points_unscaled": PointCloud2}
        self.got: dict[tuple[str, str], list[Any]] = {}
        for topic, kind in everything.items():
            for name, qos in (("best effort", SENSOR_DATA), ("reliable", RELIABLE)):
                heard = self.got[topic, name] = []
                self.bench.outsider.create_subscription(kind, topic, heard.append, qos)
        self.costmap: list[PointCloud2] = []
        self.bench.outsider.create_subscription(PointCloud2, "points2_filtered", self.costmap.append, COSTMAP)
        self.surface = self.bench.listen(Marker, "surface")
        readers = {**dict.fromkeys(everything, 2), "points2_filtered": 3, "surface": 1}
        self.bench.spin_until(  # one frame is sent, to those who listen by then
            lambda: all(
                p.get_subscription_count() >= readers.get(p.topic_name.removeprefix("/"), 0) for p in node.publishers
            ),
            "readers",
        )
        self._send(frame, calibrated)
        expected = [*RECTIFIED, *(METRIC if calibrated else ("points_unscaled",))]
        end = time.monotonic() + LIMIT_S
        while not self.surface or not all(self.got[t, q] for t in expected for q in ("best effort", "reliable")):
            assert time.monotonic() < end, f"missing: {[key for key, got in self.got.items() if not got]}"
            self.bench.executor.spin_once(timeout_sec=0.05)

    def _send(self, frame: Any, calibrated: bool) -> None:
        rig, talk = self.dive.calibration, self.bench.talk
        images = {side: talk(Image, f"{side}/image_raw") for side in ("left", "right")}
        infos = {side: talk(CameraInfo, f"{side}/camera_info") for side in ("left", "right")} if calibrated else {}
        self.bench.connected(*images.values(), *infos.values())
        for side in images:
            camera = getattr(rig, side)
            if calibrated:
                infos[side].publish(camera_info(camera, self.stamp_ns))
            images[side].publish(color(getattr(frame, side), self.stamp_ns, camera.frame_id))

    def __getitem__(self, topic: str) -> Any:
        return self.got[topic, "best effort"][0]

    @property
    def geometry(self) -> StereoGeometry:
        """Of the rectified view, read out of the left camera_info: P, and the rotation R."""
        left = self["rectified/left/camera_info"]
        rotation = tuple(map(tuple, np.array(left.r).reshape(3, 3).tolist()))
        return StereoGeometry(left.p[0], left.p[2], left.p[2], left.p[6], focal_across_px=left.p[5],
                              rect_from_raw_left=rotation)  # fmt: skip

    @property
    def frames(self) -> Frames:
        """What tf knows: the left camera's own frame in the world, and the rectified one by our transform."""
        pose = self.dive.pose(0)
        message = rectifying_transform(self.geometry, self.stamp_ns, FRAME)
        q = message.transform.rotation
        x, y, z, w = q.x, q.y, q.z, q.w
        turn = np.array([
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ])  # fmt: skip
        return {
            message.header.frame_id: (pose.rotation, pose.position),
            message.child_frame_id: (pose.rotation @ turn, pose.position),
        }

    def true_points(self) -> np.ndarray:
        """(H, W, 3) in the rectified frame, m."""
        info = self["depth/camera_info"]
        depth = self.dive.true_depth(0, self.geometry, info.width, info.height)
        return consumers.back_project(depth, info.k[0], info.k[4], info.k[2], info.k[5])

    def true_world(self) -> np.ndarray:
        """(N, 3), m: whatever of the scene the rectified left view shows."""
        points = self.true_points().reshape(-1, 3)
        return consumers.to_world(points[np.isfinite(points).all(axis=1)], f"{FRAME}_rectified", self.frames)


@pytest.fixture(scope="module", params=["horizontal", "vertical"])
def heard(request: pytest.FixtureRequest) -> Iterator[Heard]:
    heard = Heard(request.param)
    yield heard
    heard.bench.close()


def check_points(got: np.ndarray, truth: np.ndarray) -> None:
    """Organised clouds in one frame: nine points in ten within 3 % of the distance, half of them within 0.6 %."""
    error = np.linalg.norm(got - truth, axis=-1) / np.linalg.norm(truth, axis=-1)
    known = np.isfinite(error)
    assert known.mean() > 0.6
    assert np.quantile(error[known], 0.5) < 0.006
    assert np.quantile(error[known], 0.9) < 0.03


def distance_to(points: np.ndarray, surface: np.ndarray, voxel: float) -> float:
    """Share of points that have a point of the surface in their voxel or a neighbouring one."""
    there = set(map(tuple, np.floor(surface / voxel).astype(int).tolist()))
    near = {(x + i, y + j, z + k) for x, y, z in there for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)}
    cells = np.floor(points / voxel).astype(int).tolist()
    return float(np.mean([tuple(cell) in near for cell in cells]))


def test_every_output_has_the_left_images_stamp_and_frame(heard: Heard) -> None:
    for topic in (*METRIC, *RECTIFIED, "disparity"):
        head = heard[topic].header
        assert head.stamp.sec * 1_000_000_000 + head.stamp.nanosec == heard.stamp_ns
        assert head.frame_id == FRAME


def test_reliable_and_best_effort_readers_get_the_same(heard: Heard) -> None:
    for topic in (*METRIC, *RECTIFIED):
        first, second = heard.got[topic, "best effort"], heard.got[topic, "reliable"]
        assert len(first) == len(second) == 1
        if hasattr(first[0], "data"):
            assert first[0].data == second[0].data


def test_a_costmap_marks_the_seabed_and_the_pipe(heard: Heard) -> None:
    (cloud,) = heard.costmap
    reader = Costmap(min_obstacle_height=-2.0, obstacle_max_range=10.0)
    marked = reader.obstacles(cloud, heard.frames)
    truth = heard.true_world()
    assert distance_to(marked, truth, reader.resolution) > 0.95
    assert distance_to(truth, marked, reader.resolution) > 0.8


def test_a_costmap_with_its_default_heights_sees_nothing_under_water(heard: Heard) -> None:
    """In a world whose zero is the water's surface: the trap of the integration page."""
    under = {name: (r, p - [0.0, 0.0, 5.0]) for name, (r, p) in heard.frames.items()}
    assert len(Costmap(obstacle_max_range=10.0).obstacles(heard.costmap[0], under)) == 0
    told = Costmap(min_obstacle_height=-100.0, obstacle_max_range=10.0)
    assert len(told.obstacles(heard.costmap[0], under)) == heard.costmap[0].width


def test_the_filtered_cloud_is_what_costmaps_want(heard: Heard) -> None:
    cloud = heard["points2_filtered"]
    points = xyz(cloud)
    assert cloud.is_dense
    assert cloud.height == 1
    assert np.isfinite(points).all()
    distance = np.linalg.norm(points, axis=1)
    assert ((distance >= 0.1) & (distance <= 20.0)).all()
    assert 200 < len(points) <= 50_000


@pytest.mark.parametrize("topic", ["points2", "points2_filtered"])
def test_an_octomap_is_filled_with_what_is_there(heard: Heard, topic: str) -> None:
    server = OctomapServer()
    ends, colors = server.ends(heard[topic], heard.frames)
    assert distance_to(ends, heard.true_world(), server.resolution) > 0.9
    assert colors.std() > 5  # not black, not one colour
    assert heard[topic].is_dense == (topic == "points2_filtered")


def test_the_clouds_colours_are_the_rectified_images(heard: Heard) -> None:
    _, colors = OctomapServer().from_ros_msg(heard["points2"])
    image = heard["rectified/left/image_rect_color"]
    bgr = np.frombuffer(image.data, np.uint8).reshape(image.height, image.width, 3)
    np.testing.assert_array_equal(colors.reshape(bgr.shape), bgr[..., ::-1])


def test_depth_image_proc_makes_the_true_cloud(heard: Heard) -> None:
    depth, info = heard["depth/image_rect"], heard["depth/camera_info"]
    points, _ = consumers.depth_image_proc(depth, info)
    check_points(points, heard.true_points())
    _, colors = consumers.depth_image_proc(depth, info, heard["rectified/left/image_rect_color"])
    expected = OctomapServer().from_ros_msg(heard["points2"])[1].reshape(colors.shape)
    np.testing.assert_array_equal(colors, expected)


def test_its_cloud_turned_by_tf_is_ours(heard: Heard) -> None:
    """Depth is seen in the rectified frame, clouds are in the camera's own: the static transform lies between."""
    depth = consumers.depth_image_proc(heard["depth/image_rect"], heard["depth/camera_info"])[0].reshape(-1, 3)
    by_tf = consumers.to_world(depth, f"{FRAME}_rectified", heard.frames)
    ours = consumers.to_world(xyz(heard["points2"]), FRAME, heard.frames)
    np.testing.assert_allclose(by_tf, ours, atol=2e-4)
    as_labelled = consumers.to_world(depth, heard["depth/image_rect"].header.frame_id, heard.frames)
    assert np.nanmedian(np.linalg.norm(as_labelled - ours, axis=1)) > 0.005  # the rig is crooked: it matters


def test_k_and_p_agree_and_nothing_is_distorted(heard: Heard) -> None:
    info = heard["depth/camera_info"]
    np.testing.assert_array_equal(np.array(info.k).reshape(3, 3), np.array(info.p).reshape(3, 4)[:, :3])
    np.testing.assert_array_equal(np.array(info.r), np.eye(3).ravel())
    assert not any(info.d)
    assert (info.width, info.height) == (heard["depth/image_rect"].width, heard["depth/image_rect"].height)


def test_moveit_gets_points_within_its_clipping_planes(heard: Heard) -> None:
    points = consumers.moveit_depth_updater(heard["depth/image_rect"], heard["depth/camera_info"])
    world = consumers.to_world(points, f"{FRAME}_rectified", heard.frames)
    assert len(points) > 0.6 * heard["depth/image_rect"].height * heard["depth/image_rect"].width
    assert distance_to(world, heard.true_world(), 0.05) > 0.95


def test_rtabmap_takes_colour_and_depth(heard: Heard) -> None:
    for info in ("depth/camera_info", "rectified/left/camera_info"):
        points = consumers.rtabmap_rgbd(
            heard["rectified/left/image_rect_color"], heard["depth/image_rect"], heard[info]
        )
        world = consumers.to_world(points, f"{FRAME}_rectified", heard.frames)
        assert distance_to(world, heard.true_world(), 0.05) > 0.95


def test_stereo_readers_get_the_baseline_of_a_horizontal_rig(heard: Heard) -> None:
    """They know no other: from a vertical rig they read no baseline at all, and must be given depth instead."""
    baseline = consumers.rtabmap_stereo(
        heard["rectified/left/image_rect"], heard["rectified/right/image_rect"],
        heard["rectified/left/camera_info"], heard["rectified/right/camera_info"],
    )  # fmt: skip
    true = float(np.linalg.norm(heard.dive.rig.right_center))
    assert baseline == pytest.approx(true if heard.dive.params.axis == "horizontal" else 0.0, abs=1e-6)
    along = {"horizontal": 3, "vertical": 7}[heard.dive.params.axis]
    right = heard["rectified/right/camera_info"]
    assert -right.p[along] / right.p[0] == pytest.approx(true, rel=1e-3)


def test_disparity_is_f_t_over_z(heard: Heard) -> None:
    message = heard["disparity"]
    disparity = consumers.depth_pixels(message.image)
    with np.errstate(divide="ignore"):
        z = message.f * message.t / disparity
    truth = heard.true_points()[..., 2]
    known = np.isfinite(z) & np.isfinite(truth)
    assert known.mean() > 0.6
    assert np.quantile(np.abs(z - truth)[known] / truth[known], 0.9) < 0.03
    assert (disparity[np.isfinite(disparity)] >= message.min_disparity).all()
    assert (disparity[np.isfinite(disparity)] <= message.max_disparity).all()
    if heard.dive.params.axis == "horizontal":  # image_geometry knows no other
        infos = heard["rectified/left/camera_info"], heard["rectified/right/camera_info"]
        check_points(consumers.stereo_image_proc(message, *infos), heard.true_points())


def test_sigma_says_how_far_to_trust_a_depth(heard: Heard) -> None:
    depth, sigma = (consumers.depth_pixels(heard[f"depth/{name}"]) for name in ("image_rect", "sigma"))
    np.testing.assert_array_equal(np.isfinite(depth), np.isfinite(sigma))
    within = np.abs(depth - heard.true_points()[..., 2]) <= sigma
    assert 0.55 < within[np.isfinite(depth)].mean() < 0.85


def test_a_late_joiner_gets_the_surface(heard: Heard) -> None:
    late: list[Marker] = []
    heard.bench.outsider.create_subscription(Marker, "surface", late.append, LATCHED)
    heard.bench.spin_until(lambda: late)
    assert late[0].points == heard.surface[0].points
    corners = np.array([(p.x, p.y, p.z) for p in late[0].points])
    world = consumers.to_world(corners, late[0].header.frame_id, heard.frames)
    assert distance_to(world, heard.true_world(), 0.05) > 0.95


@pytest.mark.parametrize(("images", "clouds"), [("rectified", "optical"), ("optical", "rectified")])
def test_frames_by_their_own_names(images: str, clouds: str) -> None:
    """`image_frame`, `cloud_frame`: what is said to be in the rectified frame is, and tf does the rest."""
    names = {"optical": FRAME, "rectified": f"{FRAME}_rectified"}
    heard = Heard("horizontal", image_frame=images, cloud_frame=clouds)
    try:
        for topic in (*METRIC, *RECTIFIED):
            expected = names[clouds if topic.startswith("points2") else images]
            assert heard[topic].header.frame_id == expected, topic
        assert heard.surface[0].header.frame_id == names[clouds]
        depth = consumers.depth_image_proc(heard["depth/image_rect"], heard["depth/camera_info"])[0].reshape(-1, 3)
        cloud = heard["points2"]
        by_depth = consumers.to_world(depth, names["rectified"], heard.frames)
        by_cloud = consumers.to_world(xyz(cloud), cloud.header.frame_id, heard.frames)
        np.testing.assert_allclose(by_cloud, by_depth, atol=2e-4)
        reader = Costmap(min_obstacle_height=-2.0, obstacle_max_range=10.0)
        marked = reader.obstacles(heard.costmap[0], heard.frames)
        assert distance_to(marked, heard.true_world(), reader.resolution) > 0.95
    finally:
        heard.bench.close()


def test_without_a_scale_no_consumer_of_metres_gets_anything() -> None:
    heard = Heard("horizontal", calibrated=False)
    try:
        heard.bench.spin_for(0.3)
        assert [topic for topic in METRIC for q in ("best effort", "reliable") if heard.got[topic, q]] == []
        assert heard.costmap == []
        assert np.isnan(heard["rectified/right/camera_info"].p[3])
        points = xyz(heard["points_unscaled"])
        assert np.isfinite(points).any()
    finally:
        heard.bench.close()
