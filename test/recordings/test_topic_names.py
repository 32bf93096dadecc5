"""Bags of others: any names, ROS 1, video in topics."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from helpers.videos import packets, texture, views
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from uw_recon_ros.bags import BagWriter, messages
from uw_recon_ros.bags.messages import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    FFMPEG_PACKET,
    FOXGLOVE_VIDEO,
    H264_PACKET,
    IMAGE,
    MAKE,
)
from uw_recon_ros.bags.model import RawMessage, TopicInfo
from uw_recon_ros.bags.stereo import find_stereo_topics
from uw_recon_ros.calibration.rectified import named_rectified
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.findings import Code
from uw_recon_ros.messages.headers import header
from uw_recon_ros.recordings.folders import camera_folders, flat_pairs
from uw_recon_ros.recordings.info import bag_info
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.recording import Recording

MS = 1_000_000
SCENES = [views(n, shape=(96, 128)) for n in range(10)]


def topics(*names: str, kind: str = IMAGE) -> list[TopicInfo]:
    return [TopicInfo(name, kind, 5) for name in names]


@pytest.mark.parametrize(
    ("left", "right"),
    [("/left/image_raw", "/right/image_raw"), ("/stereo/Left/image", "/stereo/Right/image"),
     ("/l_cam/image_raw", "/r_cam/image_raw"), ("/cam0/image_raw", "/cam1/image_raw"), ("/cam1/image", "/cam2/image"),
     ("/camera_0/image", "/camera_1/image"), ("/d435/infra1/image_rect_raw", "/d435/infra2/image_rect_raw"),
     ("/t265/fisheye1/image_raw", "/t265/fisheye2/image_raw"), ("/slave1/image_raw", "/slave2/image_raw"),
     ("/gige_2317/left/image", "/gige_2318/right/image"), ("/stereo/master/image_raw", "/stereo/slave/image_raw"),
     ("/primary_cam/image", "/secondary_cam/image"), ("/directdrive/left/image", "/directdrive/right/image"),
     ("/rov/cam0_front/image", "/rov/cam1_front/image"), ("/Upper_Cam/image", "/Lower_Cam/image"),
     ("/port/image", "/starboard/image"), ("/upper/image", "/lower/image"), ("/cam_top/image", "/cam_bottom/image"),
     ("/camera/image_left", "/camera/image_right"), ("/leftcam/image", "/rightcam/image"), ("/image_L", "/image_R"),
     ("/directdrive/left/image_raw", "/directdrive/right/image_raw"),
     ("/debug_rig/left/image", "/debug_rig/right/image"),
     ("/zed/zed_node/left/image_rect_color", "/zed/zed_node/right/image_rect_color"),
     ("/cam_a/image_raw", "/cam_b/image_raw"), ("/rig/cameraA/image", "/rig/cameraB/image"),
     ("/cam2/image_raw", "/cam3/image_raw"), ("/kamera_links/image", "/kamera_rechts/image"),
     ("/gauche/image", "/droite/image"), ("/camara_izquierda/image", "/camara_derecha/image"),
     ("/cam_izq/image", "/cam_der/image"), ("/Babord/image_raw", "/Tribord/image_raw"),
     ("/backbord/image", "/steuerbord/image"), ("/bakboord/image", "/stuurboord/image"),
     ("/babord/image", "/styrbord/image"), ("/sinistra/image", "/destra/image"), ("/babor/image", "/estribor/image"),
     ("/bombordo/image", "/estibordo/image"), ("/esquerda/image", "/direita/image")],
)  # fmt: skip
def test_names_of_cameras(left: str, right: str) -> None:
    others = topics("/depth/image_raw", "/front/image", "/map")
    for listed in ([left, right], [right, left]):
        found = find_stereo_topics(topics(*listed) + others)
        assert (found.left, found.right) == (left, right)
    assert find_stereo_topics(topics(left, right), left=left).right == right


def test_variants_of_one_rig_are_one_rig() -> None:
    names = [f"/rig/{side}/{name}" for side in ("left", "right") for name in ("image_raw", "image_rect", "image_color")]
    assert find_stereo_topics(topics(*names)).left == "/rig/left/image_raw"
    assert not named_rectified("/directdrive/left/image_raw")
    assert named_rectified("/rig/left/image_rect")


def test_kinds_of_images_in_the_last_part_of_a_name_are_one_rig() -> None:
    names = [f"/rig/{kind}_{side}" for kind in ("image_rect", "imageRaw") for side in ("left", "right")]
    assert find_stereo_topics(topics(*names)).left == "/rig/imageRaw_left"


def test_several_rigs_are_named() -> None:
    names = [f"/{rig}/{side}/image_raw" for rig in ("front", "down") for side in ("left", "right")]
    with pytest.raises(BagError, match="/down/left/image_raw and /down/right/image_raw") as error:
        find_stereo_topics(topics(*names))
    assert error.value.code == Code.RECORDING_SEVERAL_RIGS
    assert "/front/left/image_raw" in str(error.value)
    assert find_stereo_topics(topics(*names), left="/down/left/image_raw").right == "/down/right/image_raw"
    chain = topics(*(f"/cam{n}/image_raw" for n in range(4)))
    assert find_stereo_topics(chain).right == "/cam1/image_raw"


@pytest.mark.parametrize(
    "names",
    [("/front/image", "/back/image"), ("/cam_front/image", "/cam_back/image"), ("/recorder/image", "/reizqorder/image"),
     ("/cam0_front/image", "/cam1_back/image"), ("/camera/image", "/camesa/image"), ("/bow/image", "/stern/image")],
)  # fmt: skip
def test_names_that_tell_no_side(names: tuple[str, str]) -> None:
    for listed in (names, names[::-1]):
        with pytest.raises(BagError, match="no stereo pair") as error:
            find_stereo_topics(topics(*listed))
        assert all(name in str(error.value) for name in names)
        assert "--left-topic" in str(error.value)
    assert find_stereo_topics(topics(*names), *names).right == names[1]


@pytest.mark.parametrize(
    "names",
    [("/cam_a/image", "/cam_b/image", "/cam_c/image"), ("/cam2/image", "/cam3/image", "/cam4/image"),
     ("/front/links/image", "/front/rechts/image", "/back/links/image", "/back/rechts/image"),
     ("/front_babord", "/front_tribord", "/back_babord", "/back_tribord")],
)  # fmt: skip
def test_of_more_cameras_none_is_chosen(names: tuple[str, ...], tmp_path: Path) -> None:
    with pytest.raises(BagError, match="several rigs"):
        find_stereo_topics(topics(*names))
    for name in names:
        (tmp_path / name.strip("/").replace("/image", "").replace("/", "_")).mkdir()
    with pytest.raises(BagError, match="several"):
        camera_folders(tmp_path)


@pytest.mark.parametrize(
    ("left", "right"),
    [("links", "rechts"), ("Gauche", "Droite"), ("cam_a", "cam_b"), ("cam2", "cam3"), ("Backbord", "Steuerbord"),
     ("kamera_babord", "kamera_tribord"), ("izq", "der")],
)  # fmt: skip
def test_folders_and_files_have_the_same_names(left: str, right: str, tmp_path: Path) -> None:
    for name in (left, right, "front", "back", "recorder"):
        (tmp_path / "dive" / name).mkdir(parents=True)
    found, others = camera_folders(tmp_path / "dive")
    assert found == (tmp_path / "dive" / left, tmp_path / "dive" / right)
    assert not others
    if left not in ("cam_a", "cam2"):  # numbers and letters in one folder count stills, as often as cameras
        names = [[tmp_path / f"dive_{n}_{side}.jpg" for n in range(5)] for side in (left, right)]
        assert flat_pairs([*names[1], *names[0]]) == (names[0], names[1])


@pytest.mark.parametrize(
    ("left", "right"),
    [("/left/camera_info", "/right/camera_info"), ("/left/image_raw/camera_info", "/right/image_raw/camera_info"),
     ("/info/left", "/info/right")],
)  # fmt: skip
def test_calibrations_beside_them(left: str, right: str) -> None:
    found = find_stereo_topics(topics("/left/image_raw", "/right/image_raw") + topics(left, right, kind=CAMERA_INFO))
    assert (found.left_info, found.right_info) == (left, right)


# ---- ROS 1 -----------------------------------------------------------------------------------------------------------


def ros1_bag(path: Path) -> Path:
    """Written by rosbags' own writer, with a header's sequence number and K in capitals."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    with Writer(path) as out:
        for kind in (IMAGE, CAMERA_INFO):
            for side in ("left", "right"):
                name = "image_raw" if kind == IMAGE else "camera_info"
                out.add_connection(f"/{side}/{name}", kind, typestore=store)
        for n, pair in enumerate(SCENES[:4]):
            head = kinds["std_msgs/msg/Header"](
                seq=n, stamp=kinds["builtin_interfaces/msg/Time"](sec=100 + n, nanosec=7), frame_id="cam"
            )
            for side, image in zip((0, 1), pair, strict=True):
                made = kinds[IMAGE](header=head, height=96, width=128, encoding="rgb8", is_bigendian=0, step=384,
                                    data=np.ascontiguousarray(image).reshape(-1))  # fmt: skip
                k, p = np.array([90.0, 0, 64, 0, 90, 48, 0, 0, 1]), np.zeros(12)
                p[[0, 2, 5, 6, 10]], p[3] = [90, 64, 90, 48, 1], -9.0 * side
                info = kinds[CAMERA_INFO](
                    header=head, height=96, width=128, distortion_model="plumb_bob", D=np.zeros(5), K=k,
                    R=np.eye(3).ravel(), P=p, binning_x=0, binning_y=0,
                    roi=kinds["sensor_msgs/msg/RegionOfInterest"](
                        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
                )  # fmt: skip
                for connection, message in ((out.connections[side], made), (out.connections[2 + side], info)):
                    time = (100 + n) * 10**9
                    out.write(connection, time, store.serialize_ros1(message, connection.msgtype))
    return path


def test_a_ros1_bag(tmp_path: Path) -> None:
    path = ros1_bag(tmp_path / "dive.bag")
    with Recording(path) as recording:
        assert len(recording) == 4
        for n in (3, 0, 2):
            assert np.array_equal(recording[n].left, SCENES[n][0])
            assert np.array_equal(recording[n].right, SCENES[n][1])
            assert recording[n].stamp_ns == (100 + n) * 10**9 + 7
        rig = recording[0].calibration
        assert rig is not None
        assert rig.right.p[0, 3] == -9.0
    found = bag_info(path)
    assert found.calibration == "metric"
    assert found.reconstructable
    whole = path.read_bytes()
    for share in (0.2, 0.7, 0.95):
        (tmp_path / "cut.bag").write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(BagError, match="ROS 1 bag") as error:
            Recording(tmp_path / "cut.bag")
        assert "\n" not in str(error.value)


# ---- video topics ----------------------------------------------------------------------------------------------------


def video_message(kind: str, data: bytes, time_ns: int, codec: str) -> SimpleNamespace:
    head = header(MAKE, time_ns, "cam")
    content = np.frombuffer(data, np.uint8)
    if kind == FOXGLOVE_VIDEO:
        return MAKE(kind, timestamp=head.stamp, frame_id="cam", data=content, format=codec)
    if kind == FFMPEG_PACKET:
        return MAKE(kind, header=head, width=128, height=96, encoding=codec, pts=0, flags=0, data=content)
    return MAKE(kind, header=head, format=codec, data=content)


@pytest.mark.parametrize("kind", [FOXGLOVE_VIDEO, FFMPEG_PACKET, COMPRESSED_IMAGE])
@pytest.mark.parametrize("codec", ["h264", "h265"])
def test_video_topics(tmp_path: Path, kind: str, codec: str) -> None:
    name = {FOXGLOVE_VIDEO: "video", FFMPEG_PACKET: "image_raw/ffmpeg", COMPRESSED_IMAGE: "image_raw/compressed"}[kind]
    encoded = [packets([pair[side] for pair in SCENES], codec) for side in (0, 1)]
    assert [len(one) for one in encoded] == [len(SCENES)] * 2
    with BagWriter(tmp_path / "bag") as bag:
        for n in range(len(SCENES)):
            for side, which in enumerate(("left", "right")):
                bag_message = video_message(kind, encoded[side][n], (10 + n) * 100 * MS, codec)
                bag.message(f"/rig/{which}/{name}", bag_message)
    found = bag_info(tmp_path / "bag")
    assert found.reconstructable, found.reasons
    assert (found.left.width, found.left.height) == (128, 96)  # type: ignore[union-attr]
    with Recording(tmp_path / "bag") as recording:
        assert len(recording) == len(SCENES)
        for n in (0, 1, 2, 7, 3, 9, 6):  # forwards, backwards, across key frames
            pair = recording[n]
            for image, expected in zip((pair.left, pair.right), SCENES[n], strict=True):
                assert np.abs(image.astype(float) - expected).mean() < 12, n  # another's would differ by 40
            assert pair.stamp_ns == (10 + n) * 100 * MS


@pytest.mark.parametrize("kind", [H264_PACKET, f"{H264_PACKET}Short", f"{H264_PACKET}Plain"])
def test_h264_packets_of_any_age(tmp_path: Path, kind: str) -> None:
    """The type has had a number of 64 bits, of 32 bits and none, always under one name."""
    encoded = [packets([pair[side] for pair in SCENES], "h264") for side in (0, 1)]
    with BagWriter(tmp_path / "bag") as bag:
        for n in range(len(SCENES)):
            for side, which in enumerate(("links", "rechts")):
                number = {} if kind.endswith("Plain") else {"seq": len(encoded[side][n])}  # to be taken for a length
                time_ns = (10 + n) * 100 * MS
                content = np.frombuffer(encoded[side][n], np.uint8)
                made = MAKE(kind, header=header(MAKE, time_ns, "kamera"), data=content, **number)
                data = messages.encode(made)[1]
                bag.raw(RawMessage(f"/{which}/image_raw/h264", H264_PACKET, time_ns, data))
    assert bag_info(tmp_path / "bag").reconstructable
    with Recording(tmp_path / "bag") as recording:
        for n in (0, 5, 2):
            assert np.abs(recording[n].right.astype(float) - SCENES[n][1]).mean() < 12


def test_topics_that_may_be_video_and_are_not_read_are_named() -> None:
    listed = topics("/left/video", "/right/video", kind="tilk_msgs/msg/H264Frame") + topics("/x", kind="a/msg/Pose")
    with pytest.raises(BagError) as error:
        find_stereo_topics(listed)
    assert "not read: /left/video (tilk_msgs/msg/H264Frame), /right/video" in str(error.value)
    assert "Pose" not in str(error.value)


def test_a_recording_that_begins_between_key_frames(tmp_path: Path) -> None:
    encoded = [packets([pair[side] for pair in SCENES], "h264") for side in (0, 1)]
    with BagWriter(tmp_path / "bag") as bag:
        for n in range(2, len(SCENES)):  # key frames are 0, 4, 8
            for side, which in enumerate(("left", "right")):
                bag.message(
                    f"/{which}/video", video_message(FOXGLOVE_VIDEO, encoded[side][n], (10 + n) * 100 * MS, "h264")
                )
    found = bag_info(tmp_path / "bag")
    assert found.reconstructable, found.reasons
    assert (found.left.width, found.left.before_key) == (128, 2)  # type: ignore[union-attr]
    assert any("/left/video: 2 packets come before the first key frame" in text for text in found.warnings)
    with Recording(tmp_path / "bag") as recording:
        with pytest.raises(ImageError, match="key frame"):
            recording[1]
        assert np.abs(recording[2].left.astype(float) - SCENES[4][0]).mean() < 12


def test_video_without_its_key_frame_is_refused(tmp_path: Path) -> None:
    encoded = packets([texture(n, (96, 128)) for n in range(3)], "h264")
    with BagWriter(tmp_path / "bag") as bag:
        for n in (1, 2):
            for which in ("left", "right"):
                message = video_message(FOXGLOVE_VIDEO, encoded[n], (10 + n) * 100 * MS, "h264")
                bag.raw(_raw(f"/{which}/video", message))
    with Recording(tmp_path / "bag") as recording, pytest.raises(ImageError, match="key frame"):
        recording[0]


def _raw(topic: str, message: SimpleNamespace) -> object:
    kind, data = messages.encode(message)
    return RawMessage(topic, kind, messages.stamp_ns(message), data)


def stamped(path: Path, ahead_ns: int, stamps: bool = True) -> Path:
    with BagWriter(path) as bag:
        for n, pair in enumerate(SCENES[:5]):
            for side, image in zip(("left", "right"), pair, strict=True):
                log = 10**9 + n * 100 * MS + (ahead_ns if side == "right" else 0)
                made = messages.image_message(image, time_ns=log if stamps else 0, frame_id="cam")
                bag.message(f"/{side}/image_raw", made, log_time_ns=log if stamps else 10**9 + n * 100 * MS)
    return path


def test_a_constant_offset_of_stamps_is_told_and_mended(tmp_path: Path) -> None:
    path = stamped(tmp_path / "bag", 37 * MS)
    assert any("--clock-offset" in reason for reason in bag_info(path).reasons)
    with pytest.raises(BagError):
        Recording(path)
    with Recording(path, Options(clock_offset="0.037")) as recording:
        assert len(recording) == 5
        assert np.array_equal(recording[4].right, SCENES[4][1])


def test_images_without_stamps_are_paired_by_log_time(tmp_path: Path) -> None:
    with Recording(stamped(tmp_path / "bag", 0, stamps=False)) as recording:
        assert [frame.stamp_ns for frame in recording.listing.frames] == [10**9 + n * 100 * MS for n in range(5)]
        assert recording[3].stamp_ns == 10**9 + 300 * MS
        assert np.array_equal(recording[3].right, SCENES[3][1])
        assert any("without a stamp" in note for note in recording.listing.notes)


def test_a_camera_beside_the_rig_is_told(tmp_path: Path) -> None:
    for name in ("cam0", "cam1", "cam2"):
        (tmp_path / name).mkdir()
    found, others = camera_folders(tmp_path)
    assert found == (tmp_path / "cam0", tmp_path / "cam1")
    assert others == ["cam2"]
