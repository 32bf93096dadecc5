"""From what was seen to the cause named: every fault, put into a healthy graph, is the one that is named."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest
from helpers.sights import (
    SECOND,
    STAMPS,
    change,
    healthy,
    images,
    node,
    numbers,
    published,
    spoil,
    topic,
    with_node,
    without_clouds,
)

from uw_recon_ros.doctor.cameras import offsets_ms
from uw_recon_ros.doctor.check import Level, fail, warn
from uw_recon_ros.doctor.diagnose import Diagnosis, diagnose
from uw_recon_ros.doctor.environment import check_transport
from uw_recon_ros.doctor.observation import (
    Arrivals,
    ClockSight,
    Endpoint,
    NodeStatus,
    Observation,
    ObservedTopic,
    Surroundings,
)
from uw_recon_ros.doctor.suggestions import actual_names, for_image, says_side
from uw_recon_ros.doctor.text import as_json, as_table
from uw_recon_ros.doctor.topic_graph import TYPES
from uw_recon_ros.topics import COMPRESSED_IMAGE, IMAGE, POINT_CLOUD


def cause(seen: Observation) -> str:
    """The words of the last line."""
    diagnosis = diagnose(seen)
    assert not diagnosis.healthy
    line = as_table(diagnosis).splitlines()[-1]
    assert line.startswith("most likely cause: ")
    return line


def warnings(seen: Observation) -> str:
    diagnosis = diagnose(seen)
    assert diagnosis.healthy, as_table(diagnosis)
    return "\n".join(f.text for f in diagnosis.findings if f.level == Level.WARN)


def test_a_healthy_graph() -> None:
    diagnosis = diagnose(healthy())
    assert diagnosis.healthy
    assert [f.text for f in diagnosis.findings if f.level != Level.OK] == []
    assert diagnosis.cause is None
    assert [f.stage for f in diagnosis.findings if f.stage in ("cameras", "rectify", "cloud")][-1] == "cloud"
    assert as_table(diagnosis).splitlines()[-1] == "healthy: clouds come"


def test_a_graph_with_warnings_is_not_called_healthy() -> None:
    twice = node("point_cloud_node", copies=2)
    seen = healthy()
    diagnosis = diagnose(replace(seen, nodes={**seen.nodes, "point_cloud_node": twice}))
    assert as_table(diagnosis).splitlines()[-1] == "with 1 warning above: clouds come"


def test_nothing_at_all_is_seen() -> None:
    around = Surroundings("7", "LOCALHOST", "rmw_fastrtps_cpp", nodes_seen=0)
    line = cause(Observation(surroundings=around))
    assert "no other node is seen (ROS_DOMAIN_ID 7" in line
    assert "LOCALHOST sees this machine only" in line
    elsewhere = replace(around, udp_ports=(53, 7400, 7410 + 250 * 7, 8660, 8661, 7400 + 250 * 60 + 200))
    line = cause(Observation(surroundings=elsewhere))
    assert "but DDS is at work in domain 5 on this machine -> ROS_DOMAIN_ID=5 uw_recon doctor" in line
    assert "multicast" in cause(Observation(surroundings=replace(around, discovery_range="")))


def no_camera(*others: ObservedTopic) -> Observation:
    seen = change(healthy(), left__image_raw=topic("left/image_raw"), right__image_raw=topic("right/image_raw"))
    return replace(without_clouds(seen), others=others)


@pytest.mark.parametrize(
    ("others", "words"),
    [
        ((), "no image topic is seen at all -> start the cameras"),
        ((published("/rov/left/image_raw"), published("/rov/right/image_raw")), "-r __ns:=/rov"),
        ((published("/stereo/left/image_color"),), "-r left/image_raw:=/stereo/left/image_color"),
        ((published("/left/image_color"), published("/left/image_mono")), "-r left/image_raw:=/left/image_color"),
        (
            (published("/cam/left/image/compressed", COMPRESSED_IMAGE),),
            "-r left/image_raw/compressed:=/cam/left/image/compr",
        ),
        ((published("/camera/infra1/image_rect_raw"),), "-r left/image_raw:=/camera/infra1/image_rect_raw"),
        ((published("/usb_cam/image_raw"),), "images seen: /usb_cam/image_raw"),
    ],
)
def test_no_publisher_and_what_was_meant(others: tuple[ObservedTopic, ...], words: str) -> None:
    line = cause(no_camera(*others))
    assert "/left/image_raw: no publisher" in line
    assert words in line


def test_only_compressed_images_but_raw_ones_are_asked_for() -> None:
    seen = no_camera()
    seen = change(seen, left__image_raw__compressed=published("/left/image_raw/compressed", COMPRESSED_IMAGE))
    seen = with_node(seen, "preprocess_node", parameters={"image_transport": "raw"})
    assert "set image_transport to compressed or auto" in cause(seen)


def test_compressed_images_do_as_well() -> None:
    seen = change(healthy(), left__image_raw=topic("left/image_raw"), right__image_raw=topic("right/image_raw"))
    for side in ("left", "right"):
        came = images(width=0, height=0, encoding="jpeg")
        compressed = replace(published(f"/{side}/image_raw/compressed", COMPRESSED_IMAGE), arrivals=came)
        seen = replace(seen, topics={**seen.topics, f"{side}/image_raw/compressed": compressed})
    assert warnings(seen) == ""


def test_types_that_differ() -> None:
    ends: dict[str, Any] = {
        "publishers": (Endpoint("/driver", COMPRESSED_IMAGE),),
        "subscribers": (Endpoint("/preprocess_node", IMAGE),),
        "arrivals": Arrivals(),
    }
    line = cause(without_clouds(spoil(healthy(), "left/image_raw", **ends)))
    assert "/driver publishes sensor_msgs/msg/CompressedImage, /preprocess_node expects sensor_msgs/msg/Image" in line


def ends(publisher: dict[str, Any], subscriber: dict[str, Any]) -> Observation:
    """A pair of ends that do not meet, though the doctor's own does."""
    return without_clouds(
        spoil(
            healthy(),
            "left/image_raw",
            publishers=(Endpoint("/driver", IMAGE, **publisher),),
            subscribers=(Endpoint("/preprocess_node", IMAGE, **subscriber),),
        )
    )


@pytest.mark.parametrize(
    ("publisher", "subscriber", "words"),
    [
        ({"type_hash": "a"}, {"type_hash": "b"}, "type hashes differ"),
        ({"reliable": False}, {}, "/driver offers best effort only, /preprocess_node demands reliable"),
        ({}, {"latched": True}, "/driver offers volatile durability, /preprocess_node demands transient local"),
    ],
)
def test_ends_that_never_meet(publisher: dict[str, Any], subscriber: dict[str, Any], words: str) -> None:
    assert words in cause(ends(publisher, subscriber))


@pytest.mark.parametrize(("publisher", "subscriber"), [({"latched": True}, {}), ({}, {"reliable": False})])
def test_ends_that_offer_more_than_is_asked_for(publisher: dict[str, Any], subscriber: dict[str, Any]) -> None:
    seen = spoil(ends(publisher, subscriber), "points2", arrivals=images(valid_share=0.5))
    assert not [f for f in diagnose(seen).findings if f.stage == "connections"]


def test_a_silent_camera() -> None:
    seen = without_clouds(spoil(healthy(), "left/image_raw", arrivals=Arrivals()))
    assert "/left/image_raw: a publisher (/driver), but no message in 5.0 s -> see whether the camera" in cause(seen)
    paused = replace(seen, clock=ClockSight(("/bag_player_node",), 9, SECOND, SECOND))
    assert "resume the bag or simulation: it is paused" in cause(paused)
    unreliable = spoil(seen, "left/image_raw", publishers=(Endpoint("/driver", IMAGE, reliable=False),))
    assert "images over 512 KiB are lost" in cause(unreliable)


def test_best_effort_is_warned_of_where_images_are_large() -> None:
    ends = (Endpoint("/driver", IMAGE, reliable=False),)
    assert "best effort with images of 0.9 MiB" in warnings(spoil(healthy(), "left/image_raw", publishers=ends))
    small = spoil(healthy(), "left/image_raw", publishers=ends, arrivals=images(size_bytes=400_000))
    assert warnings(small) == ""


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"width": 320}, "left images are 640x480, right ones 320x480"),
        ({"encoding": "mono8"}, "left images are bgr8, right ones mono8"),
        ({"encoding": "bgr16"}, "left images are bgr8, right ones bgr16"),
        ({"encoding": "nv61"}, "got 'nv61'"),
    ],
)
def test_cameras_that_differ(change: dict[str, Any], words: str) -> None:
    assert words in cause(without_clouds(spoil(healthy(), "right/image_raw", arrivals=images(**change))))


def test_encodings_that_decode_alike_are_one() -> None:
    assert warnings(spoil(healthy(), "right/image_raw", arrivals=images(encoding="rgb8"))) == ""


def later(ms: float) -> Arrivals:
    return images(tuple(stamp + round(ms * 1e6) for stamp in STAMPS))


def test_stamps_apart() -> None:
    line = cause(without_clouds(spoil(healthy(), "right/image_raw", arrivals=later(20))))
    assert "left and right 20.0 ms (median), pair_tolerance_ms is 1; 0% of the images find a partner" in line
    assert "pair_tolerance_ms to 24" in line
    assert warnings(spoil(healthy(), "right/image_raw", arrivals=later(0.8))) == ""
    tolerant = with_node(healthy(), "preprocess_node", parameters={"pair_tolerance_ms": 25.0})
    assert warnings(spoil(tolerant, "right/image_raw", arrivals=later(20))) == ""


def test_clocks_apart_are_no_matter_of_tolerance() -> None:
    line = cause(without_clouds(spoil(healthy(), "right/image_raw", arrivals=later(3_600_000))))
    assert "set both cameras' clocks to one time source" in line


def test_stamps_of_nought() -> None:
    seen = spoil(healthy(), "right/image_raw", arrivals=images((0,) * 50))
    assert "stamps are zero" in cause(without_clouds(seen))


def test_one_camera_at_half_rate_and_one_that_loses_images() -> None:
    half = images(STAMPS[::2], rate_hz=5.0)
    assert "rates differ: left 10.0 Hz, right 5.0 Hz" in warnings(spoil(healthy(), "right/image_raw", arrivals=half))
    ragged = tuple(stamp + (30_000_000 if place % 4 == 0 else 0) for place, stamp in enumerate(STAMPS))
    seen = spoil(healthy(), "right/image_raw", arrivals=images(ragged))
    assert "24% of the images find no partner" in warnings(seen)


def test_offsets_ignore_what_one_camera_saw_alone() -> None:
    assert offsets_ms([0, 10_000_000, 20_000_000], [10_000_000, 21_000_000]) == [0.0, 1.0]
    assert offsets_ms([0], [5_000_000]) == [5.0]
    assert offsets_ms([], [1]) == []


def test_clocks() -> None:
    simulated = with_node(healthy(), "rectify_node", parameters={"use_sim_time": True})
    assert "use_sim_time is set (/rectify_node), but nobody publishes /clock" in warnings(simulated)
    bag = replace(healthy(), clock=ClockSight(("/bag",), 9, 0, SECOND))
    assert "/bag publishes /clock, but our nodes do not use it" in warnings(bag)
    late = spoil(healthy(), "left/image_raw", arrivals=images(behind_ns=3600 * SECOND))
    assert "image stamps are 3600 s behind" in warnings(late)
    assert warnings(replace(late, clock=ClockSight(("/bag",), 9, 0, SECOND), nodes=simulated.nodes)) == ""


def unscaled(seen: Observation) -> Observation:
    """Clouds come, but without metres."""
    seen = spoil(seen, "points2", arrivals=Arrivals(), publishers=(Endpoint("/point_cloud_node", POINT_CLOUD),))
    return change(seen, points_unscaled=topic("points_unscaled", "/point_cloud_node", images(valid_share=0.7)))


def info(**sides: Any) -> Observation:
    return replace(healthy(), infos={**healthy().infos, **sides})


ZERO = numbers(k=(0.0,) * 9)


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        (info(left=ZERO), "/left/camera_info: K is zero (not calibrated): the scale is unknown"),
        (info(right=numbers()), "right P has no baseline"),
        (change(healthy(), left__camera_info=topic("left/camera_info")), "/left/camera_info: no publisher"),
        (with_node(healthy(), "rectify_node", parameters={"calibration_use": "ignore"}), "calibration_use is ignore"),
    ],
)
def test_no_scale(seen: Observation, words: str) -> None:
    line = cause(unscaled(seen))
    assert words in line
    table = as_table(diagnose(unscaled(seen)))
    assert "no /points2: the scale is unknown; /points_unscaled comes instead" in table
    assert words.split(":")[0] not in warnings(seen)  # parameters may give the scale as well


@pytest.mark.parametrize(
    ("seen", "words"),
    [
        (info(left=numbers(width=320)), "expected 640x480 px as the images, got 320x480"),
        (info(right=numbers(40.0)), "expected P[3] = -fx B < 0"),
        (info(left=numbers(-40.0), right=numbers()), "are left and right swapped"),
        (info(left=numbers(d=(1.0, 2.0))), "left D: expected 4 or 5 finite numbers"),
    ],
)
def test_a_calibration_that_makes_no_sense(seen: Observation, words: str) -> None:
    assert words in cause(without_clouds(seen, since=1))


def test_a_calibration_announced_and_not_sent() -> None:
    seen = replace(without_clouds(healthy(), since=1), infos={"right": numbers(-40.0)})
    assert "/left/camera_info: a publisher, but no message: rectification waits" in cause(seen)


def test_a_calibration_elsewhere() -> None:
    seen = unscaled(change(healthy(), left__camera_info=topic("left/camera_info")))
    seen = replace(seen, others=(published("/rov/left/camera_info", TYPES["left/camera_info"]),))
    assert "-r left/camera_info:=/rov/left/camera_info" in cause(seen)


def test_a_node_that_is_missing() -> None:
    seen = without_clouds(change(healthy(), disparity=topic("disparity")), since=2)
    seen = replace(seen, nodes={name: n for name, n in seen.nodes.items() if name != "disparity_node"})
    assert "no disparity_node (nor pipeline_node), and nobody publishes /disparity -> ros2 run" in cause(seen)
    assert "uw_recon doctor --namespace /rov" in cause(replace(seen, elsewhere=("/rov/disparity_node",)))


def test_anothers_node_in_place_of_ours() -> None:
    """image_pipeline rectifies and matches: neither cameras nor our first nodes matter."""
    seen = spoil(healthy(), "disparity", publishers=(Endpoint("/stereo_image_proc", TYPES["disparity"]),))
    topics = {n: t for n, t in seen.topics.items() if n in ("disparity", "points2")}
    alone = replace(seen, topics=topics, nodes={"point_cloud_node": node("point_cloud_node")}, infos={})
    assert warnings(alone) == ""
    assert "/stereo_image_proc" in as_table(diagnose(alone))


@pytest.mark.parametrize(
    ("state", "words"),
    [
        ("unconfigured", "ros2 lifecycle set /rectify_node configure; ros2 lifecycle set /rectify_node activate"),
        ("inactive", "/rectify_node is inactive: a managed node works only when active -> ros2 lifecycle set"),
        ("finalized", "/rectify_node is finalized"),
        ("", "/rectify_node does not say in which state it is"),
    ],
)
def test_a_node_that_is_not_active(state: str, words: str) -> None:
    seen = without_clouds(healthy(), since=1)
    assert words in cause(with_node(seen, "rectify_node", lifecycle=state))
    assert warnings(with_node(healthy(), "rectify_node", lifecycle="active")) == ""


def test_a_refused_rectification() -> None:
    drops = {"dropped: EstimationError": "12", "dropped: superseded by newer": "3"}
    drops["last drop code"] = "rectify.exchanged"
    refused = NodeStatus(2, "left and right images are swapped: expected positive disparities, got 99 %", drops)
    seen = with_node(without_clouds(healthy(), since=1), "rectify_node", statuses=(refused, NodeStatus(0, "idle")))
    line = cause(seen)
    assert "/rectify_node refuses every frame: left and right images are swapped" in line
    assert "EstimationError x12" in line
    assert "superseded" not in line
    assert "-> swap the topics of left and right" in line


def test_frames_given_up_so_far_are_told() -> None:
    drops = {"dropped: lost on the way: left/image_raw": "7", "dropped: superseded by newer": "30"}
    seen = with_node(healthy(), "preprocess_node", statuses=(NodeStatus(0, "working", drops),))
    (line,) = [f.text for f in diagnose(seen).findings if f.stage == "preprocess"]
    assert line.endswith("given up so far: lost on the way: left/image_raw x7")


def test_what_a_working_node_warns_of() -> None:
    slow = NodeStatus(1, "target_rate_hz missed: 2.1 of 5", {"rate": "target_rate_hz missed: 2.1 of 5"})
    assert "/disparity_node: target_rate_hz missed" in warnings(
        with_node(healthy(), "disparity_node", statuses=(slow,))
    )


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"in groups [Hz]": "2.00", "warm_up": "done"}, "has taken pairs, but sent nothing in 5.0 s"),
        ({"in groups [Hz]": "2.00", "warm_up": "running"}, "/disparity_node is still compiling its kernels"),
    ],
)
def test_a_node_that_is_busy(values: dict[str, str], words: str) -> None:
    seen = without_clouds(healthy(), since=2)
    assert words in cause(with_node(seen, "disparity_node", statuses=(NodeStatus(0, "idle", values),)))


def test_a_transition_that_failed() -> None:
    failed = NodeStatus(2, "x", {"transition": "configure failed: no room"})
    seen = with_node(without_clouds(healthy(), since=1), "rectify_node", lifecycle="unconfigured", statuses=(failed,))
    assert "/rectify_node is unconfigured: configure failed: no room" in cause(seen)


def test_a_node_that_hangs() -> None:
    seen = with_node(without_clouds(healthy(), since=2), "disparity_node", answers=False, statuses=())
    assert "/disparity_node does not answer" in cause(seen)


def test_two_of_everything() -> None:
    assert "2 nodes are called /rectify_node" in warnings(with_node(healthy(), "rectify_node", copies=2))
    both = (Endpoint("/disparity_node", TYPES["disparity"]), Endpoint("/pipeline_node", TYPES["disparity"]))
    assert "/disparity has 2 publishers" in warnings(spoil(healthy(), "disparity", publishers=both))
    sides = (Endpoint("/driver", IMAGE), Endpoint("/bag", IMAGE))
    assert "/left/image_raw: 2 publishers (/driver, /bag)" in warnings(
        spoil(healthy(), "left/image_raw", publishers=sides)
    )


def test_what_a_pipeline_says_is_said_once() -> None:
    seen = healthy()
    for name in ("left/image_matching", "rectified/left/image_rect", "disparity", "points2"):
        seen = spoil(seen, name, publishers=(Endpoint("/pipeline_node", TYPES[name]),))
    refused = node("pipeline_node", statuses=(NodeStatus(2, "no parallax: expected"),))
    seen = without_clouds(replace(seen, nodes={}), since=1)
    found = diagnose(replace(seen, nodes={"pipeline_node": refused})).findings
    assert sum("no parallax" in f.text for f in found) == 1
    assert [f.stage for f in found if "no parallax" in f.text] == ["pipeline"]


def test_clouds_with_little_or_nothing_in_them() -> None:
    empty = spoil(healthy(), "points2", arrivals=images(valid_share=0.0))
    assert "clouds without a point -> look at disparity/status" in cause(empty)
    behind = NodeStatus(0, "working", {"disparities": "-77 to -25 px"})
    exchanged = cause(with_node(empty, "disparity_node", statuses=(behind,)))
    assert "left and right images seem swapped; disparities are -77 to -25 px -> swap the topics" in exchanged
    ahead = NodeStatus(0, "working", {"disparities": "-7 to 25 px"})
    assert "exchanged" not in cause(with_node(empty, "disparity_node", statuses=(ahead,)))
    assert "3% of the pixels have a point" in warnings(spoil(healthy(), "points2", arrivals=images(valid_share=0.03)))
    nowhere = spoil(healthy(), "points2", arrivals=images(valid_share=0.9, frame_id=""))
    assert "RViz shows no cloud without a frame" in warnings(nowhere)


def test_nobody_listens_or_elsewhere() -> None:
    assert "nobody but this doctor listens" in warnings(spoil(healthy(), "points2", subscribers=()))
    astray = ObservedTopic("/points2", subscribers=(Endpoint("/rviz2", POINT_CLOUD),))
    seen = replace(spoil(healthy(), "points2", name="/rov/points2"), others=(astray,))
    assert "waiting where nobody publishes: /rviz2 on /points2 (ours is /rov/points2)" in warnings(seen)


def test_that_nobody_listens_is_no_cause_of_a_missing_cloud() -> None:
    """It is the doctor that listens then; another doubt is."""
    nobody, doubt = warn("listeners", "nobody but this doctor listens"), warn("cameras", "2 publishers")
    missing = fail("cloud", "no cloud", symptom=True)
    assert Diagnosis(healthy(), (nobody, missing)).cause is missing
    assert Diagnosis(healthy(), (nobody, doubt, missing)).cause is doubt


def test_little_shared_memory() -> None:
    around = replace(healthy().surroundings, shm_free_bytes=20 << 20)
    assert "20 MiB free in /dev/shm" in warnings(replace(healthy(), surroundings=around))
    assert warnings(replace(healthy(), surroundings=replace(around, profile="/etc/dds.xml"))) == ""
    assert warnings(replace(healthy(), surroundings=replace(around, rmw="rmw_cyclonedds_cpp"))) == ""


def test_symptoms_alone_name_the_doubt_before_them() -> None:
    seen = without_clouds(healthy(), since=2)
    assert "/disparity_node sends no /disparity" in cause(with_node(seen, "disparity_node", statuses=()))
    late = spoil(seen, "left/image_raw", arrivals=images(behind_ns=60 * SECOND))
    assert "image stamps are 60 s behind" in cause(with_node(late, "disparity_node", statuses=()))


def test_json_says_the_same() -> None:
    seen = without_clouds(spoil(healthy(), "left/image_raw", arrivals=Arrivals()))
    said = json.loads(as_json(diagnose(seen)))
    assert said["healthy"] is False
    assert said["cause"]["stage"] == "cameras"
    assert said["cause"]["text"] in as_table(diagnose(seen))
    assert [f["level"] for f in said["findings"]] == [f.level.name for f in diagnose(seen).findings]
    assert json.loads(as_json(diagnose(healthy())))["cause"] is None


def test_names_of_cameras() -> None:
    assert says_side("/stereo/left/image_raw", "left")
    assert says_side("/cam_left_front/image", "left")
    assert not says_side("/stereo/right/image_raw", "left")
    assert not says_side("/leftover/image", "left")
    assert not says_side("/left_right_stitched/image", "left")
    assert for_image("left", [published("/left/image_rect"), published("/left/image_raw")])[0] == "/left/image_raw"


def test_remaps_are_read_off_the_nodes() -> None:
    resolved = {name: f"/{name}" for name in TYPES}
    heard = {"/zed/left/image": IMAGE, "/right/image_raw": IMAGE, "/zed/left/info": TYPES["left/camera_info"]}
    assert actual_names(heard, resolved) == {"left/image_raw": "/zed/left/image", "left/camera_info": "/zed/left/info"}
    assert actual_names({"/left/image_enhanced": IMAGE}, resolved) == {}


def test_without_ros_it_says_what_to_do() -> None:
    code = "import sys; sys.modules['rclpy'] = None; from uw_recon_ros.cli import main; sys.exit(main(['doctor']))"
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert told.returncode == 1
    (line,) = told.stderr.strip().splitlines()
    assert line.startswith("uw_recon: doctor: expected ROS 2, no module rclpy: source its setup.bash")


def with_odometry(status: NodeStatus, came: Arrivals) -> Observation:
    """A healthy graph in which odometry_node runs too."""
    seen = healthy()
    nodes = {**seen.nodes, "odometry_node": node("odometry_node", statuses=(status,))}
    return change(replace(seen, nodes=nodes), odometry=topic("odometry", "/odometry_node", came))


def test_odometry_is_looked_at_where_it_runs() -> None:
    found = diagnose(with_odometry(NodeStatus(0, "working", {}), images()))
    assert found.healthy
    assert any(f.stage == "odometry" and f.level == Level.OK and "10.0 Hz" in f.text for f in found.findings)
    assert not any(f.stage == "odometry" for f in diagnose(healthy()).findings)


def test_lost_odometry_is_told_and_no_reason_for_missing_clouds() -> None:
    values = {"odometry": "lost for 3.0 s", "codes": "odometry.lost", "odometry.lost": "lost for 3.0 s"}
    seen = with_odometry(NodeStatus(1, "lost for 3.0 s: too little in common", values), Arrivals())
    assert "lost for 3.0 s" in warnings(seen)
    (finding,) = [f for f in diagnose(seen).findings if f.stage == "odometry" and "lost" in f.text]
    assert "slower" in finding.advice
    hanging = with_odometry(NodeStatus(2, "every frame dropped", {}), Arrivals())
    assert diagnose(hanging).healthy


@pytest.mark.parametrize(
    ("said", "level"),
    [
        ("7 of 18 sectors told, the others unknown", Level.OK),
        ("all sectors unknown: low confidence", Level.WARN),
        ("not published: expected base_frame, got none", Level.WARN),
    ],
)
def test_an_autopilot_that_listens_hears_why_it_is_told_nothing(said: str, level: Level) -> None:
    seen = with_node(healthy(), "point_cloud_node", statuses=(NodeStatus(0, "working", {"obstacles": said}),))
    assert not any(f.stage == "autopilot" for f in diagnose(seen).findings)
    seen = spoil(seen, "obstacles", subscribers=(Endpoint("/mavros", TYPES["obstacles"]),))
    (finding,) = [f for f in diagnose(seen).findings if f.stage == "autopilot"]
    assert (finding.level, finding.text) == (level, f"/obstacles: {said}")
    assert diagnose(seen).healthy


@pytest.mark.parametrize(
    ("rmw", "around", "level", "words"),
    [
        ("rmw_fastrtps_cpp", {}, Level.OK, "camera drivers send through 512 KiB"),
        ("rmw_zenoh_cpp", {"nodes_seen": 0}, Level.FAIL, "without a router"),
        ("rmw_zenoh_cpp", {}, Level.OK, "yet other nodes are seen"),
        ("rmw_zenoh_cpp", {"tcp_ports": (22, 7447)}, Level.OK, "a router listens on port 7447"),
        ("rmw_zenoh_cpp", {"nodes_seen": 0, "zenoh": {"ZENOH_SESSION_CONFIG_URI": "/a"}}, Level.OK, "may name another"),
        ("rmw_cyclonedds_cpp", {"receive_bytes": 212_992}, Level.WARN, "sockets receive 208 KiB"),
        ("rmw_cyclonedds_cpp", {"receive_bytes": 1 << 25}, Level.OK, "Cyclone DDS"),
        ("rmw_connextdds", {}, Level.OK, "rmw_connextdds: nothing is known of it"),
    ],
)
def test_the_middleware_and_its_traps_are_named(rmw: str, around: dict[str, Any], level: Level, words: str) -> None:
    found = check_transport(Observation(surroundings=replace(healthy().surroundings, rmw=rmw, **around)))
    assert [(f.level, words in f.text) for f in found[:1]] == [(level, True)], found


@pytest.mark.parametrize(("told", "level"), [("", Level.WARN), ("nonsense", Level.WARN), (str(64 << 20), Level.OK)])
def test_a_small_pool_of_zenoh_is_told(told: str, level: Level) -> None:
    settings = {"ZENOH_CONFIG_OVERRIDE": "transport/shared_memory/enabled=true", "ZENOH_SHM_ALLOC_SIZE": told}
    around = replace(healthy().surroundings, rmw="rmw_zenoh_cpp", tcp_ports=(7447,), zenoh=settings)
    assert [f.level for f in check_transport(Observation(surroundings=around))] == [Level.OK, level]
