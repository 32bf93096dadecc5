"""What `inspect_recording` says of stills, videos and two bags whose faults are known."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.bag_makers import camera
from helpers.videos import texture, views, write_video

from uw_recon_ros.bags import BagReader, BagWriter, RawMessage, messages
from uw_recon_ros.cli import main
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.calibrations.write import write_calibration
from uw_recon_ros.files.images import read_image, write_image
from uw_recon_ros.recordings import clock_offset
from uw_recon_ros.recordings.info import inspect_recording
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.recording import Recording
from uw_recon_ros.types import CameraModel, StereoCalibration

PAIRS = [views(n) for n in range(6)]
MS = 1_000_000


def centred(width: int, height: int, tx: float = 0.0) -> CameraModel:
    made = camera(width, height, tx)
    for matrix in (made.k, made.p):
        matrix[0, 2], matrix[1, 2] = (width - 1) / 2, (height - 1) / 2
        matrix[0, 0] = matrix[1, 1] = 200.0
    made.p[0, 3] = 200.0 * tx
    return made


def stills(path: Path, suffix: str = ".png") -> Path:
    for side, name in enumerate(("left", "right")):
        (path / name).mkdir(parents=True)
        for n, pair in enumerate(PAIRS):
            write_image(path / name / f"{n}{suffix}", pair[side])
    return path


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tif"])
@pytest.mark.parametrize("how", ["cut", "empty", "text"])
def test_a_damaged_still_is_named_and_the_others_are_used(tmp_path: Path, suffix: str, how: str) -> None:
    path = stills(tmp_path / "dive", suffix)
    for name in (f"left/0{suffix}", f"right/3{suffix}"):
        content = (path / name).read_bytes()
        (path / name).write_bytes({"cut": content[: len(content) // 2], "empty": b"", "text": b"hello"}[how])
    (info,) = inspect_recording(path)
    assert (info.pairs, info.reconstructable, info.kind) == (4, True, "stills")
    assert [f"{n}{suffix}" in sentence for n, sentence in zip((0, 3), info.damage, strict=True)] == [True, True]
    assert "2 files cannot be read: their pairs are left out" in info.warnings
    with Recording(path) as recording:
        assert len(list(recording.pairs())) == 4
        assert sum("left out" in note for note in recording.listing.notes) == 2


def test_damaged_stills_with_both_views_spoil_nothing(tmp_path: Path) -> None:
    for n, pair in enumerate(PAIRS):
        write_image(tmp_path / f"{n}.png", np.concatenate(pair, axis=1))
    for n in (0, 2, 4):
        (tmp_path / f"{n}.png").write_bytes((tmp_path / f"{n}.png").read_bytes()[:300])
    with Recording(tmp_path) as recording:
        assert np.array_equal(recording[1].right, PAIRS[1][1])
    (info,) = inspect_recording(tmp_path)
    assert (info.pairs, len(info.damage), info.reconstructable) == (3, 3, True)
    for n in (1, 3, 5):
        (tmp_path / f"{n}.png").write_bytes(b"")
    (info,) = inspect_recording(tmp_path)
    assert not info.reconstructable
    assert "none that can be read" in info.reasons[0]


def test_stills_that_cannot_be_reconstructed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = stills(tmp_path / "dive")
    assert main(["info", str(path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert (told["pairs"], told["calibration"], told["left"]["width"]) == (6, "none", 240)
    for n in range(6):
        write_image(path / "right" / f"{n}.png", texture(n, (90, 120)))
    assert main(["info", str(path)]) == 1
    assert "differ in size: 240x180 and 120x90 px" in capsys.readouterr().out


def test_the_calibration_beside_stills_is_judged(tmp_path: Path) -> None:
    """Of another resolution: refused, with both sizes; a good one gives metres."""
    path = stills(tmp_path / "dive")
    model = centred(240, 180), centred(240, 180, tx=-0.1)
    write_calibration(StereoCalibration(*model), path / "calibration.yaml")
    (info,) = inspect_recording(path)
    assert (info.calibration, info.reconstructable) == ("metric", True)
    assert info.baseline_m == pytest.approx(0.1)
    (path / "calibration.yaml").unlink()
    write_calibration(StereoCalibration(centred(480, 360), centred(480, 360, tx=-0.1)), path / "calibration.yaml")
    (info,) = inspect_recording(path)
    assert not info.reconstructable
    assert "expected 240x180 px as the images, got 480x360" in info.reasons[0]


def test_of_several_recordings_a_damaged_one_hides_no_other(tmp_path: Path) -> None:
    write_video(tmp_path / "sound.mp4", [np.concatenate(pair, axis=1) for pair in PAIRS])
    (tmp_path / "empty.mp4").write_bytes(b"")
    (tmp_path / "empty.mcap").write_bytes(b"")
    paths = [tmp_path / "empty.mp4", tmp_path / "sound.mp4", tmp_path / "empty.mcap"]
    assert [info.reconstructable for info in inspect_recording(paths)] == [False, True, False]


def test_a_video_has_a_verdict(tmp_path: Path) -> None:
    write_video(tmp_path / "dive.mp4", [np.concatenate(pair, axis=1) for pair in PAIRS])
    (info,) = inspect_recording(tmp_path / "dive.mp4")
    assert (info.kind, info.pairs, info.reconstructable) == ("video", 6, True)
    assert info.rate_hz == pytest.approx(10.0, rel=0.02)
    write_video(tmp_path / "mono.mp4", [pair[0] for pair in PAIRS])
    (info,) = inspect_recording(tmp_path / "mono.mp4")
    assert "one camera's" in info.reasons[0]


# ---- two bags --------------------------------------------------------------------------------------------------------


def half(path: Path, side: int, topic: str, ahead_ns: int = 0) -> Path:
    with BagWriter(path) as bag:
        for n, pair in enumerate(PAIRS):
            stamp = 10**9 + n * 100 * MS + ahead_ns
            bag.message(topic, messages.image_message(pair[side], time_ns=stamp, frame_id="cam"), log_time_ns=stamp)
    return path


def right_pairs(recording: Recording) -> None:
    assert len(recording) == len(PAIRS)
    for pair, (left, right) in zip(recording.pairs(), PAIRS, strict=True):
        assert np.array_equal(pair.left, left)
        assert np.array_equal(pair.right, right)


@pytest.mark.parametrize(
    "topics",
    [("/camera/image_raw", "/camera/image_raw"), ("/left/image_raw", "/right/image_raw"), ("/zed/rgb", "/oak/color")],
)
@pytest.mark.parametrize("names", [("left_cam", "right_cam"), ("left.mcap", "right.mcap")])
def test_left_and_right_in_two_bags(tmp_path: Path, topics: tuple[str, str], names: tuple[str, str]) -> None:
    left, right = (half(tmp_path / name, side, topics[side]) for side, name in enumerate(names))
    for paths in ([left, right], [right, left], [tmp_path]):
        with Recording(paths) as recording:
            right_pairs(recording)
    (info,) = inspect_recording(tmp_path)
    assert (info.pairs, info.reconstructable) == (6, True)


def test_two_bags_become_one(tmp_path: Path) -> None:
    left, right = (str(half(tmp_path / name, side, "/camera/image_raw")) for side, name in enumerate("ab"))
    assert main(["pack", "--left", left, "--right", right, "-o", str(tmp_path / "both")]) == 0
    with Recording(tmp_path / "both") as recording:
        right_pairs(recording)
        assert recording.listing.frames[3].stamp_ns == 10**9 + 300 * MS


def test_two_bags_whose_clocks_differ_by_much(tmp_path: Path) -> None:
    paths = [half(tmp_path / "a", 0, "/camera/image_raw"), half(tmp_path / "b", 1, "/camera/image_raw", 3600 * 10**9)]
    with pytest.raises(BagError, match="clock-offset"):
        Recording(paths)
    with Recording(paths, Options(clock_offset="3600")) as recording:
        right_pairs(recording)


def test_two_dives_stay_two(tmp_path: Path) -> None:
    for name in ("left_wall", "right_wall"):
        with BagWriter(tmp_path / name) as bag:
            for side, image in zip(("left", "right"), PAIRS[0], strict=True):
                made = messages.image_message(image, time_ns=10**9, frame_id="cam")
                bag.message(f"/{side}/image_raw", made, log_time_ns=10**9)
    with Recording(tmp_path) as recording:
        assert [source.name for source in recording.sources] == ["left_wall", "right_wall"]
        assert len(recording) == 2
        assert any("1 pairs have the same stamps: copies" in note for note in recording.listing.notes)


# ---- TIFF ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("compression", [5, 8])
@pytest.mark.parametrize("kind", ["colour", "mono", "16 bits"])
def test_damaged_pixels_of_a_tiff_are_refused(tmp_path: Path, compression: int, kind: str) -> None:
    image = texture(3)[..., ::-1]
    shown = {"colour": image, "mono": image[..., 0], "16 bits": image.astype(np.uint16) * 257}[kind]
    _, encoded = cv2.imencode(".tif", shown, [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    (tmp_path / "a.tif").write_bytes(encoded.tobytes())
    assert read_image(tmp_path / "a.tif").shape == shown.shape
    content = bytearray(encoded.tobytes())
    middle = len(content) // 2
    content[middle : middle + 200] = bytes(value * 7 % 256 for value in content[middle : middle + 200])
    (tmp_path / "a.tif").write_bytes(content)
    with pytest.raises(ImageError, match="damaged"):
        read_image(tmp_path / "a.tif")


# ---- a look at one pair ----------------------------------------------------------------------------------------------


def scenes(*sides: int) -> list[list[np.ndarray]]:
    """Frames of cameras that look at one slanted scene; the second side is right of the first."""
    scene = [views(n, shape=(180, 240)) for n in range(6)]
    return [[pair[side] for pair in scene] for side in sides]


@pytest.mark.parametrize("kind", ["videos", "bags", "bag", "stills"])
def test_exchanged_cameras_are_named_and_nothing_is_read_twice(
    tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    paths = [tmp_path / "dive"]
    frames = scenes(1, 0)
    if kind == "videos":
        paths = [tmp_path / "left.mp4", tmp_path / "right.mp4"]
        for path, images in zip(paths, frames, strict=True):
            write_video(path, images)
    elif kind == "bags":
        paths = [half(tmp_path / name, 1 - side, "/camera/image_raw") for side, name in enumerate(("left", "right"))]
    elif kind == "stills":
        for name, images in zip(("left", "right"), frames, strict=True):
            (paths[0] / name).mkdir(parents=True)
            for n, image in enumerate(images):
                write_image(paths[0] / name / f"{n}.png", image)
    else:
        with BagWriter(paths[0]) as bag:
            for n in range(6):
                for side, name in enumerate(("left", "right")):
                    bag.image(f"/{name}/image_raw", frames[side][n], time_ns=10**9 + n * 100 * MS, frame_id="cam")
    passed: list[str] = []
    whole = BagReader.raw_messages

    def counted(self: BagReader, *arguments: object) -> Iterator[RawMessage]:
        for raw in whole(self, *arguments):  # type: ignore[arg-type]
            passed.append(raw.topic)
            yield raw

    clocks: list[int] = []
    found_clock = clock_offset.find_clock
    monkeypatch.setattr(BagReader, "raw_messages", counted)
    monkeypatch.setattr("uw_recon_ros.recordings.views.find_clock", lambda *a: clocks.append(1) or found_clock(*a))
    assert main(["info", *map(str, paths)]) == 1
    assert "exchange" in capsys.readouterr().out
    assert len(clocks) == (kind == "videos")
    if kind.startswith("bag"):
        assert 12 < len(passed) <= 12 + 6 + 2  # all, three of either for a first look, and one pair
