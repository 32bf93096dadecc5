"""Recordings in the forms people have: the pairs that come out are those that were put in."""

from __future__ import annotations

import io
import shutil
import struct
from pathlib import Path

import cv2
import numpy as np
import pytest
from helpers.videos import swaying, texture, views, write_video
from PIL import Image as Picture

from uw_recon_ros.cli import main
from uw_recon_ros.errors import BagError, ImageError, ReconError
from uw_recon_ros.files.images import write_image
from uw_recon_ros.files.video_packets import library
from uw_recon_ros.findings import Code
from uw_recon_ros.recordings.clock_offset import find_clock
from uw_recon_ros.recordings.info import inspect_recording
from uw_recon_ros.recordings.layout import cut, find_layout
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.recording import Recording
from uw_recon_ros.recordings.video import Video

COUNT = 14
PAIRS = [views(n) for n in range(COUNT)]


def alike(image: np.ndarray, expected: np.ndarray, most: float = 6.0) -> bool:
    return image.shape == expected.shape and float(np.abs(image.astype(float) - expected).mean()) < most


def right_pairs(recording: Recording, count: int = COUNT, most: float = 6.0) -> None:
    """Read in an order of its own, as workers do."""
    assert len(recording) == count
    for n in np.random.default_rng(3).permutation(count):
        pair = recording[int(n)]
        assert alike(pair.left, PAIRS[n][0], most), n
        assert alike(pair.right, PAIRS[n][1], most), n


def joined(layout: str, pair: tuple[np.ndarray, np.ndarray]) -> np.ndarray:
    if layout == "row-interleaved":
        image = np.empty_like(pair[0])
        image[0::2], image[1::2] = pair[0][0::2], pair[1][1::2]
        return image
    return np.concatenate(pair, axis=1 if layout == "side-by-side" else 0)


# ---- videos ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("suffix", "codec"),
    [(".mp4", "libx264"), (".mov", "libx264"), (".mkv", "libx265"), (".avi", "mjpeg"), (".ts", "libx264")],
)
def test_two_videos(tmp_path: Path, suffix: str, codec: str) -> None:
    for side, name in enumerate(("dive_left", "dive_right")):
        write_video(tmp_path / f"{name}{suffix}", [pair[side] for pair in PAIRS], codec=codec)
    for paths in ([tmp_path / f"dive_left{suffix}"], [tmp_path / f"dive_right{suffix}"], [tmp_path],
                  [tmp_path / f"dive_left{suffix}", tmp_path / f"dive_right{suffix}"]):  # fmt: skip
        with Recording(paths) as recording:
            stamps = [frame.stamp_ns for frame in recording.listing.frames]
            assert np.diff(stamps) / 1e9 == pytest.approx(0.1, abs=0.002)
    with Recording(tmp_path) as recording:
        right_pairs(recording, most=18.0 if codec == "mjpeg" else 9.0)  # other frames differ by 40
        assert set(recording.fingerprint().popitem()[1]) == {f"dive_left{suffix}", f"dive_right{suffix}"}


@pytest.mark.parametrize("layout", ["side-by-side", "top-bottom"])
def test_one_video_with_both_views(tmp_path: Path, layout: str) -> None:
    write_video(tmp_path / "dive.mp4", [joined(layout, pair) for pair in PAIRS])
    for options in (Options(), Options(layout=layout)):
        with Recording(tmp_path / "dive.mp4", options) as recording:
            right_pairs(recording)
    assert main(["info", str(tmp_path / "dive.mp4")]) == 0


def test_one_camera_is_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "dive.mp4", [pair[0] for pair in PAIRS])
    with pytest.raises(BagError, match="one camera's") as error:
        Recording(tmp_path / "dive.mp4")
    assert "--layout" in str(error.value)


def test_a_variable_rate_keeps_its_times(tmp_path: Path) -> None:
    times = [0.0, 0.1, 0.15, 0.4, 0.45, 0.9, 1.0, 1.4, 1.45, 1.5, 1.9, 2.0, 2.2, 2.6]
    write_video(tmp_path / "dive.mkv", [joined("side-by-side", pair) for pair in PAIRS], times=times)
    with Recording(tmp_path / "dive.mkv") as recording:
        stamps = [frame.stamp_ns / 1e9 - 1 for frame in recording.listing.frames]
        assert stamps == pytest.approx(times, abs=0.002)
        right_pairs(recording)


def test_a_rotation_flag_is_obeyed(tmp_path: Path) -> None:
    """The matrix of the track's header is turned by half; OpenCV's own reader is the oracle."""
    plain, turned = tmp_path / "p.mp4", tmp_path / "t.mp4"
    write_video(plain, [pair[0] for pair in PAIRS])
    content = bytearray(plain.read_bytes())
    place = content.index(b"tkhd") + 4 + 4 + 20 + 8 + 8  # version and flags, times and duration, layer and volume
    assert struct.unpack_from(">i", content, place) == (0x10000,)
    struct.pack_into(">9i", content, place, -0x10000, 0, 0, 0, -0x10000, 0, 240 << 16, 180 << 16, 0x40000000)
    turned.write_bytes(content)
    with Video(plain) as a, Video(turned) as b:
        mark = a.times()[3][1]
        assert alike(b.frame(mark), a.frame(mark)[::-1, ::-1], 0.5)
        theirs = cv2.VideoCapture(str(turned))
        for _ in range(4):
            read, image = theirs.read()
        if read:
            assert alike(b.frame(mark), image[..., ::-1], 3.0)


def test_videos_that_are_damaged(tmp_path: Path) -> None:
    write_video(tmp_path / "dive.ts", [joined("side-by-side", pair) for pair in PAIRS])
    whole = (tmp_path / "dive.ts").read_bytes()
    for name, content in {"empty.mp4": b"", "noise.mp4": bytes(range(256)) * 40, "head.mkv": whole[:200]}.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(BagError) as error:
            Recording(tmp_path / name)
        assert "\n" not in str(error.value)
    (tmp_path / "cut.ts").write_bytes(whole[: len(whole) * 2 // 3])
    with Recording(tmp_path / "cut.ts", Options(layout="side-by-side")) as recording:
        read = list(recording.pairs())
        assert 4 <= len(read) < COUNT
        assert alike(read[2].left, PAIRS[2][0])


def test_the_extra_is_named_where_it_is_absent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_video(tmp_path / "dive.mp4", [joined("side-by-side", PAIRS[0])])
    monkeypatch.setitem(__import__("sys").modules, "av", None)
    with pytest.raises(BagError, match=r"\.\[video\]"):
        Recording(tmp_path / "dive.mp4")
    with pytest.raises(BagError) as error:
        library()
    assert error.value.code == Code.RECORDING_EXTRA


def test_a_video_is_packed_and_reconstructed_alike(tmp_path: Path) -> None:
    """What goes into a bag from a video is what is read from it."""
    write_video(tmp_path / "dive.mp4", [joined("side-by-side", pair) for pair in PAIRS])
    file = str(tmp_path / "dive.mp4")
    assert main(["pack", "--left", file, "--right", file, "-o", str(tmp_path / "bag")]) == 0
    with Recording(tmp_path / "bag") as bag, Recording(tmp_path / "dive.mp4") as dive:
        assert len(bag) == len(dive) == COUNT
        for n in (0, 5, 13):
            assert np.array_equal(bag[n].left, dive[n].left)
            assert np.array_equal(bag[n].right, dive[n].right)
            assert bag[n].stamp_ns == dive[n].stamp_ns


@pytest.mark.parametrize("side", [0, 1])
def test_of_more_frames_the_nearest_is_the_partner(tmp_path: Path, side: int) -> None:
    """One camera three times as fast: partners are of one moment, not the first that is near enough."""
    for which, name in enumerate(("left", "right")):
        every = 3 if which == side else 1
        write_video(tmp_path / f"{name}.mkv", [pair[which] for pair in PAIRS[1::every]], 30 / every)
    with Recording(tmp_path, Options(clock_offset="0")) as recording:
        assert [frame.lag_ns // 1_000_000 for frame in recording.listing.frames] == [0] * 5
        for n, pair in enumerate(recording):
            assert alike(pair.left, PAIRS[1 + 3 * n][0], 9.0)
            assert alike(pair.right, PAIRS[1 + 3 * n][1], 9.0)


@pytest.mark.parametrize("side", [0, 1])
def test_frames_of_the_longer_video_are_told(tmp_path: Path, side: int) -> None:
    for which, name in enumerate(("left", "right")):
        write_video(tmp_path / f"{name}.mkv", [pair[which] for pair in (PAIRS[:9] if which == side else PAIRS)])
    with Recording(tmp_path, Options(clock_offset="0")) as recording:
        assert len(recording) == 9
        said = " ".join(recording.listing.notes)
    expected = (
        "right frames lie before or after" if side == 0 else f"{COUNT - 9} of {COUNT} left frames have no partner"
    )
    assert expected in said


def test_a_frame_of_a_video_is_held_against_one_well_before(tmp_path: Path) -> None:
    """Encoders repeat blocks of the last frame where little moves: taken for frozen, a third of a dive was lost."""
    write_video(tmp_path / "dive.mkv", [joined("side-by-side", pair) for pair in PAIRS])
    (tmp_path / "stills").mkdir()
    for n, pair in enumerate(PAIRS[:3]):
        write_image(tmp_path / "stills" / f"{n}.png", joined("side-by-side", pair))
    with Recording([tmp_path / "stills", tmp_path / "dive.mkv"]) as recording:
        frames = recording.listing.frames
        assert [frame.number for frame in frames] == list(range(3 + COUNT))
        stills, video = frames[:3], frames[3:]
        assert [frame.before for frame in stills] == [None, *((f.left, f.right) for f in stills[:2])]
        assert [frame.before for frame in video[:5]] == [None] * 5
        assert [frame.before for frame in video[5:]] == [(f.left, f.right) for f in video[:-5]]


# ---- clocks ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("offset", "rates", "seconds", "clock"),
    [(0.01, (30, 30), 20, 1.0), (5.37, (30, 29.97), 26, 1.0), (-2.2, (25, 30), 20, 1.0), (1.234, (30, 30), 30, 1.001)],
)
def test_clocks_of_cameras_without_sync(
    tmp_path: Path, offset: float, rates: tuple[float, float], seconds: float, clock: float
) -> None:
    """Two simulated action cameras: the offset is found to a fraction of a frame, and what is said of it is true."""
    begin = 50.0
    write_video(tmp_path / "l.mp4", swaying(begin, rates[0], seconds), rates[0], quality=28)
    write_video(tmp_path / "r.mp4", swaying(begin - offset, rates[1], seconds, 9.0, clock), rates[1], quality=28)
    with Video(tmp_path / "l.mp4") as left, Video(tmp_path / "r.mp4") as right:
        found = find_clock(left, right, left.times(), right.times(), None)
    middle = seconds / 2  # the right camera's time t' shows begin - offset + clock t'
    expected = (middle + offset) / clock
    assert found.right_of(round(middle * 1e9)) / 1e9 == pytest.approx(expected, abs=0.012)
    assert found.sigma_s < 0.02
    assert "sigma" in found.told[0]


def test_clocks_that_nothing_tells_are_refused(tmp_path: Path) -> None:
    for name, seed in (("left.mp4", 1), ("right.mp4", 2)):
        dice = np.random.default_rng(seed)
        still = texture(seed)
        images = (np.clip(still + dice.normal(0, 3, still.shape), 0, 255).astype(np.uint8) for _ in range(80))
        write_video(tmp_path / name, images)
    with pytest.raises(BagError, match="--clock-offset") as error:
        Recording(tmp_path)
    with Recording(tmp_path, Options(clock_offset="0.3")) as recording:
        assert len(recording) == 77
    assert "clock" in str(error.value)


# ---- stills ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("left", "right"),
    [("left/{:04}.png", "right/{:04}.png"), ("LEFT/a{}.png", "Right/b{}.png"),
     ("cam0/data/{:04}.png", "cam1/data/{:04}.png"), ("port/{}.png", "starboard/{}.png"),
     ("top_cam/{}.png", "bottom_cam/{}.png"), ("camera_1/{}.png", "camera_2/{}.png"), ("d_{}_L.png", "d_{}_R.png"),
     ("left_{}.png", "right_{}.png"), ("image_00/data/{:010}.png", "image_01/data/{:010}.png"),
     ("left/100GOPRO/G{}.png", "right/DCIM/100GOPRO/G{}.png"), ("infra1/{}.png", "infra2/{}.png")],
)  # fmt: skip
def test_folders_however_they_are_named(tmp_path: Path, left: str, right: str) -> None:
    for n, pair in enumerate(PAIRS):
        for name, image in zip((left, right), pair, strict=True):
            path = tmp_path / name.format(n)
            path.parent.mkdir(parents=True, exist_ok=True)
            write_image(path, image)
    with Recording(tmp_path) as recording:
        right_pairs(recording, most=0.1)


@pytest.mark.parametrize("order", [1, -1])
def test_the_two_folders_of_a_rig_are_one_recording(tmp_path: Path, order: int) -> None:
    folders = [tmp_path / "links", tmp_path / "rechts"]
    for folder, number in zip(folders, (0, 1), strict=True):
        folder.mkdir()
        for n, pair in enumerate(PAIRS):
            write_image(folder / f"{n}.png", pair[number])
    with Recording(folders[::order]) as recording:
        right_pairs(recording, most=0.1)
    (info,) = inspect_recording(folders[::order])
    assert info.left
    assert info.left.topic == str(Path(tmp_path.name, "links"))
    assert info.right
    assert info.right.topic == str(Path(tmp_path.name, "rechts"))


def test_several_rigs_are_named_and_none_is_chosen(tmp_path: Path) -> None:
    for folder in ("front_left", "front_right", "rear_left", "rear_right"):
        (tmp_path / folder).mkdir()
        write_image(tmp_path / folder / "0.png", PAIRS[0][0])
    with pytest.raises(BagError, match="front_left and front_right; rear_left and rear_right") as error:
        Recording(tmp_path)
    assert error.value.code == Code.RECORDING_SEVERAL_RIGS


@pytest.mark.parametrize("layout", ["side-by-side", "top-bottom", "row-interleaved"])
def test_stills_with_both_views(tmp_path: Path, layout: str) -> None:
    for n, pair in enumerate(PAIRS):
        write_image(tmp_path / f"{n}.png", joined(layout, pair))
    with Recording(tmp_path) as recording:
        right_pairs(recording, most=12.0 if layout == "row-interleaved" else 0.1)


@pytest.mark.parametrize("seed", range(6))
def test_ordinary_images_hold_one_view(seed: int) -> None:
    for image in (texture(seed), cv2.resize(texture(seed, (40, 60)), (640, 480)), np.full((100, 200), 90, np.uint8),
                  np.tile(texture(seed, (30, 30)), (6, 7, 1))[:-7]):  # fmt: skip
        assert (
            find_layout(image) in ("separate", "side-by-side")
            if image.shape[0] == 173
            else find_layout(image) == "separate"
        )


def test_a_row_interleaved_view_keeps_its_rows() -> None:
    ramp = np.repeat(np.arange(40, dtype=np.uint8)[:, None] * 5, 8, axis=1)
    for side in (0, 1):
        assert np.abs(cut(ramp, "row-interleaved", side)[2:-2].astype(int) - ramp[2:-2]).max() <= 1


def test_mpo(tmp_path: Path) -> None:
    for n, pair in enumerate(PAIRS[:3]):
        first, second = (Picture.fromarray(image) for image in pair)
        first.save(tmp_path / f"{n}.mpo", save_all=True, append_images=[second], quality=95)
    with Recording(tmp_path) as recording:
        right_pairs(recording, 3)
    content = (tmp_path / "0.mpo").read_bytes()
    (tmp_path / "0.mpo").write_bytes(content[: len(content) // 2 - 2000])
    with Recording(tmp_path) as recording, pytest.raises(ImageError):
        recording[0]


def exif_jpeg(path: Path, image: np.ndarray, time: str, fraction: str = "") -> None:
    picture, exif = Picture.fromarray(image), Picture.Exif()
    exif.get_ifd(0x8769).update({36867: time} | ({37521: fraction} if fraction else {}))
    out = io.BytesIO()
    picture.save(out, "JPEG", quality=95, exif=exif)
    path.write_bytes(out.getvalue())


def card(tmp_path: Path, lost: tuple[int, int], fraction: bool = False, ahead_s: int = 0) -> None:
    """Two cards with numbers of their own; each lost one still."""
    for side, first in ((0, 100), (1, 730)):
        folder = tmp_path / ("left", "right")[side]
        folder.mkdir()
        kept = [n for n in range(6) if n != lost[side]]
        for rank, n in enumerate(kept):
            second = 10 + n // 2 if fraction else 10 + 2 * n
            time = f"2024:05:11 10:22:{second + (ahead_s if side else 0):02}"
            exif_jpeg(folder / f"G{first + rank:07}.JPG", PAIRS[n][side], time, ("0", "5")[n % 2] if fraction else "")


@pytest.mark.parametrize("fraction", [False, True])
@pytest.mark.parametrize("lost", [(5, 0), (2, 3), (0, 9)])
def test_cards_that_lost_a_still_are_paired_by_exif(tmp_path: Path, lost: tuple[int, int], fraction: bool) -> None:
    card(tmp_path, lost, fraction)
    with Recording(tmp_path) as recording:
        kept = [n for n in range(6) if n not in lost]
        assert len(recording) == len(kept)
        for pair, n in zip(recording.pairs(), kept, strict=True):
            assert alike(pair.left, PAIRS[n][0])
            assert alike(pair.right, PAIRS[n][1])
        assert any("no partner" in note for note in recording.listing.notes)


def test_clocks_of_cards_that_differ(tmp_path: Path) -> None:
    card(tmp_path, (5, 0), ahead_s=31)
    with pytest.raises(BagError, match="--clock-offset") as error:
        Recording(tmp_path)
    assert error.value.code == Code.RECORDING_CLOCKS
    with Recording(tmp_path, Options(clock_offset="31")) as recording:
        assert len(recording) == 4
        assert alike(recording[0].right, PAIRS[1][1])


def test_times_in_names(tmp_path: Path) -> None:
    for side, late in (("cam0", 0), ("cam1", 1)):
        (tmp_path / "mav0" / side / "data").mkdir(parents=True)
        for n in range(5):
            if (side, n) != ("cam1", 2):
                name = f"{1403636579763555584 + 50_000_000 * n + late}.png"
                write_image(tmp_path / "mav0" / side / "data" / name, PAIRS[n][late])
    with Recording(tmp_path) as recording:
        assert recording.listing.frames[0].stamp_ns == 1403636579763555584
        assert len(recording) == 4
        assert alike(recording[2].right, PAIRS[3][1], 0.1)


def test_what_cannot_be_read_is_named(tmp_path: Path) -> None:
    for side in ("left", "right"):
        (tmp_path / side).mkdir()
        for suffix in (".NEF", ".DNG", ".heic"):
            (tmp_path / side / f"DSC_1{suffix}").write_bytes(b"x" * 64)
    pytest.importorskip("rawpy", reason="raw photographs need the extra 'raw'")
    with Recording(tmp_path) as recording, pytest.raises(ReconError, match=r"DSC_1.* 64 bytes, damaged") as error:
        recording[0]
    assert "\n" not in str(error.value)
    for side, image in zip(("left", "right"), PAIRS[0], strict=True):
        write_image(tmp_path / side / "1.png", image)
    with Recording(tmp_path) as recording:
        assert any("not read: 2 .nef" in note for note in recording.listing.notes)
    shutil.rmtree(tmp_path / "right")
    with pytest.raises(ReconError, match="one camera's"):
        Recording(tmp_path)


def _without_first_packets(path: Path, images: list[np.ndarray], count: int, first: int = 1) -> Path:
    """A video with a key frame each twelve, of which `count` packets from `first` on are left."""
    whole = write_video(path.with_name(f"whole{path.suffix}"), images)
    with library().open(str(whole)) as source, library().open(str(path), "w") as out:
        stream = out.add_stream_from_template(source.streams.video[0])
        for packet in [p for p in source.demux(video=0) if p.size][first : first + count]:
            packet.stream = stream
            out.mux(packet)
    whole.unlink()
    return path


@pytest.mark.parametrize("container", ["mp4", "mkv"])
def test_what_comes_before_the_first_key_frame_is_told_and_the_rest_is_read(tmp_path: Path, container: str) -> None:
    for side, name in enumerate(("left", "right")):
        _without_first_packets(tmp_path / f"{name}.{container}", [pair[side] for pair in PAIRS], COUNT, 9)
    with Recording(tmp_path, Options(clock_offset="0")) as dive:
        assert len(dive) == COUNT - 9
        for early in range(3):
            with pytest.raises(ImageError, match="before the first key frame"):
                dive[early]
        assert alike(dive[3].left, PAIRS[12][0])


@pytest.mark.parametrize("container", ["mkv", "mp4", "ts"])
def test_a_video_without_a_key_frame_is_one_clear_line(tmp_path: Path, container: str) -> None:
    path = _without_first_packets(tmp_path / f"cut.{container}", [pair[0] for pair in PAIRS], 11)
    with pytest.raises(BagError, match="key frame"), Video(path) as video:
        video.times()
