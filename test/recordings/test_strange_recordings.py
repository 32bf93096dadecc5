"""Recordings of kinds that nobody planned: read right, or refused with the way out."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.videos import packets, views, write_video

from uw_recon_ros.bags import BagWriter
from uw_recon_ros.bags.messages import IMAGE, MAKE
from uw_recon_ros.cli import main
from uw_recon_ros.errors import BagError
from uw_recon_ros.files.images import write_image
from uw_recon_ros.images import decode_image
from uw_recon_ros.messages.headers import header
from uw_recon_ros.recordings.info import inspect_recording
from uw_recon_ros.recordings.recording import Recording
from uw_recon_ros.recordings.sources import Source, told_of_calibrations

PAIRS = [views(n, shape=(96, 128)) for n in range(5)]


def stills(folder: Path, side: int, name: str = "{:04d}.png") -> None:
    folder.mkdir(parents=True)
    for n, pair in enumerate(PAIRS):
        write_image(folder / name.format(n), pair[side])


def right_pairs(recording: Recording, numbers: list[int]) -> None:
    assert len(recording) == len(numbers)
    for pair, n in zip(recording.pairs(), numbers, strict=True):
        assert np.array_equal(pair.left, PAIRS[n][0])
        assert np.array_equal(pair.right, PAIRS[n][1])


@pytest.mark.parametrize("name", ["frame_{n:06d}_cam{side}.png", "cam{side}_{n:06d}.png", "{n}-camera_{side}.png"])
def test_files_of_numbered_cameras_in_one_folder(tmp_path: Path, name: str) -> None:
    for n, pair in enumerate(PAIRS):
        for side, image in enumerate(pair):
            if (n, side) != (2, 1):
                write_image(tmp_path / name.format(n=n, side=side), image)
    with Recording(tmp_path) as recording:
        right_pairs(recording, [0, 1, 3, 4])
        assert not any("by order alone" in note for note in recording.listing.notes)


@pytest.mark.parametrize("name", ["cam_{}.png", "camera{}.png", "img_{}.png"])
def test_stills_that_are_counted_are_no_cameras(tmp_path: Path, name: str) -> None:
    for n, pair in enumerate(PAIRS):
        write_image(tmp_path / name.format(n), pair[0])
    with pytest.raises(BagError, match="one camera's"):
        Recording(tmp_path)


def test_folders_whose_names_tell_no_side_are_named(tmp_path: Path) -> None:
    for side, name in enumerate(("front", "back")):
        stills(tmp_path / "dive" / name, side)
    with pytest.raises(BagError, match="got back, front: call the two left and right"):
        Recording(tmp_path / "dive")


def test_a_calibration_by_another_name_is_pointed_out(tmp_path: Path) -> None:
    for side, name in enumerate(("image_2", "image_3")):
        stills(tmp_path / name, side, "{:06d}.png")
    (tmp_path / "calib.txt").write_text("P2: 1 0 1 0 0 1 1 0 0 0 1 0\n")
    (tmp_path / "times.txt").write_text("0.1\n")
    (info,) = inspect_recording(tmp_path)
    assert any("(calib.txt may be one: --calibration)" in warning for warning in info.warnings)


# ---- videos ----------------------------------------------------------------------------------------------------------


def test_bare_streams_are_refused_with_the_command(tmp_path: Path) -> None:
    for side, name in enumerate(("left", "right")):
        images = [pair[side] for pair in PAIRS]
        (tmp_path / f"{name}.h264").write_bytes(b"".join(packets(images, "h264")))
        (tmp_path / f"{name}.mjpeg").write_bytes(b"".join(bytes(cv2.imencode(".jpg", i)[1]) for i in images))
    for suffix in ("h264", "mjpeg"):
        with pytest.raises(BagError, match=rf"ffmpeg -framerate RATE -i left.{suffix} -c copy left.mp4"):
            Recording(tmp_path / f"left.{suffix}")
        assert main(["info", str(tmp_path / f"left.{suffix}")]) == 1


def test_two_streams_of_pictures_in_one_file(tmp_path: Path) -> None:
    av = pytest.importorskip("av", reason="videos need the extra 'video'")
    with av.open(str(tmp_path / "dive.mkv"), "w") as out:
        streams = [out.add_stream("libx264", rate=10) for _ in range(2)]
        for stream in streams:
            stream.width, stream.height, stream.pix_fmt = 128, 96, "yuv420p"
        for pair in PAIRS:
            for stream, image in zip(streams, pair, strict=True):
                out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        for stream in streams:
            out.mux(stream.encode())
    with pytest.raises(BagError, match=r"2 streams of pictures: ffmpeg .* -map 0:v:1"):
        Recording(tmp_path / "dive.mkv")


def test_chapters_of_either_camera_are_recordings_of_their_own(tmp_path: Path) -> None:
    for side, (name, number) in enumerate((("left", "0012"), ("right", "0031"))):
        (tmp_path / name / "DCIM" / "100GOPRO").mkdir(parents=True)
        for chapter in (1, 2):
            images = [pair[side] for pair in PAIRS[2 * chapter - 2 :]]
            write_video(tmp_path / name / "DCIM" / "100GOPRO" / f"GX0{chapter}{number}.MP4", images)
        (tmp_path / name / "DCIM" / "100GOPRO" / f"GL01{number}.LRV").write_bytes(b"small")
    with Recording(tmp_path) as recording:
        assert [source.name for source in recording.sources] == [
            f"GX0{chapter}0012.MP4 and GX0{chapter}0031.MP4" for chapter in (1, 2)
        ]
        for n, expected in enumerate([*PAIRS, *PAIRS[2:]]):
            assert np.abs(recording[n].right.astype(float) - expected[1]).mean() < 12


# ---- encodings -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bits", [10, 12, 14])
@pytest.mark.parametrize("name", ["mono", "bayer_rggb"])
def test_fewer_bits_than_sixteen(bits: int, name: str) -> None:
    """As bright as the same image of 16 bits."""
    wide = np.random.default_rng(bits).integers(0, 2**bits, (8, 12)).astype("<u2")
    size = {"height": 8, "width": 12, "step": 24}
    found = decode_image(wide.tobytes(), encoding=f"{name}{bits}", **size)  # type: ignore[arg-type]
    full = decode_image((wide << (16 - bits)).tobytes(), encoding=f"{name}16", **size)  # type: ignore[arg-type]
    assert found.dtype == np.uint16
    assert np.array_equal(found, full)


def test_yuv_in_capitals() -> None:
    data = np.random.default_rng(1).integers(0, 255, 8 * 24).astype(np.uint8).tobytes()
    for name in ("YUYV", "UYVY", "YUV422"):
        one, other = (decode_image(data, height=8, width=12, encoding=e, step=24) for e in (name, name.lower()))
        assert np.array_equal(one, other)


def test_an_encoding_that_is_unknown_is_said_once(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag") as bag:
        for n in range(4):
            for side in ("left", "right"):
                data = np.zeros(96 * 192, np.uint8)
                made = MAKE(IMAGE, header=header(MAKE, 10**9 * (n + 1), "c"), height=96, width=128, encoding="mono12p",
                            step=192, data=data)  # fmt: skip
                bag.message(f"/{side}/image_raw", made, log_time_ns=10**9 * (n + 1))
    (info,) = inspect_recording(tmp_path / "bag")
    assert [("mono12p" in reason) for reason in info.reasons] == [True, True]
    assert not any("differ from the first" in warning for warning in info.warnings)


def test_calibrations_beside_stills_are_named_used_or_not(tmp_path: Path) -> None:
    for name in ("calibration.yaml", "old_calibration.yaml", "notes.txt"):
        (tmp_path / name).write_text("a: 1\n")
    source = Source("stills", str(tmp_path), tmp_path.name)
    beside, unused = told_of_calibrations(source, ())
    assert "calibrated by calibration.yaml" in beside
    assert "old_calibration.yaml" in unused
    assert "notes.txt" not in unused
    given, others = told_of_calibrations(source, ["rig.npz"])
    assert "calibrated by rig.npz" in given
    assert "calibration.yaml, old_calibration.yaml" in others
    (tmp_path / "calibration.yaml").unlink()
    (only,) = told_of_calibrations(source, ())
    assert "--calibration" in only
