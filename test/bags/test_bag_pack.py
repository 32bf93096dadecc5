"""Stills packed into a bag come out bit by bit; what cannot be packed says why and leaves nothing behind."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from helpers.bag_makers import camera, recording
from helpers.videos import texture, write_video
from rosbags.highlevel import AnyReader

from uw_recon_ros.bags import BagWriter, messages, open_bag, write_bag
from uw_recon_ros.cli import main
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.images import write_image
from uw_recon_ros.recordings.info import bag_info
from uw_recon_ros.recordings.pack import pack
from uw_recon_ros.types import RawImage, StereoCalibration

CALIBRATION = StereoCalibration(camera(), camera(tx=-0.1))


def still(seed: int, kind: str = "color8") -> RawImage:
    dtype = np.uint16 if kind.endswith("16") else np.uint8
    shape = (12, 16, 3) if kind.startswith("color") else (12, 16)
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype=dtype, endpoint=True)


def folders(root: Path, frames: int = 12, kind: str = "color8") -> tuple[str, str]:
    for number, side in enumerate(("left", "right")):
        (root / side).mkdir()
        for i in range(frames):
            write_image(root / side / f"{side}_{i}.png", still(2 * i + number, kind))
    return str(root / "left" / "*.png"), str(root / "right")


@pytest.mark.parametrize(
    ("kind", "encoding"), [("color8", "bgr8"), ("mono8", "mono8"), ("color16", "bgr16"), ("mono16", "mono16")]
)
def test_bits_order_stamps_and_encoding(tmp_path: Path, kind: str, encoding: str) -> None:
    assert pack(*folders(tmp_path, kind=kind), tmp_path / "bag", rate_hz=4.0) == (12, ())
    with open_bag(tmp_path / "bag") as bag:
        pairs = list(bag.stereo_pairs())
    for i, pair in enumerate(pairs):  # frame_10 after frame_9
        assert np.array_equal(pair.left, still(2 * i, kind))
        assert np.array_equal(pair.right, still(2 * i + 1, kind))
        assert pair.left.dtype == still(0, kind).dtype
    assert [pair.stamp_ns for pair in pairs] == [10**9 + 250_000_000 * i for i in range(12)]
    info = bag_info(tmp_path / "bag")
    assert info.left is not None
    assert info.right is not None
    assert (info.left.encoding, info.calibration) == (encoding, "none")
    assert info.left.frame_id == "stereo_left_optical_frame"
    assert info.right.frame_id == "stereo_right_optical_frame"


def test_colour_is_recorded_as_bgr(tmp_path: Path) -> None:
    pack(*folders(tmp_path, 1), tmp_path / "bag")
    with AnyReader([tmp_path / "bag"]) as reader:
        connection, _, data = next(reader.messages())
        message = reader.deserialize(data, connection.msgtype)
    assert message.step == 48  # type: ignore[attr-defined]
    assert bytes(message.data) == still(0)[..., ::-1].tobytes()  # type: ignore[attr-defined]


def test_calibration_goes_with_every_pair(tmp_path: Path) -> None:
    pack(*folders(tmp_path, 3), tmp_path / "bag", calibration=CALIBRATION)
    info = bag_info(tmp_path / "bag")
    assert info.calibration == "metric"
    assert {t.name: t.count for t in info.topics} == {
        "/left/image_raw": 3, "/right/image_raw": 3, "/left/camera_info": 3, "/right/camera_info": 3,
    }  # fmt: skip


def test_a_bare_file_by_its_suffix(tmp_path: Path) -> None:
    pack(*folders(tmp_path, 2), tmp_path / "dive.mcap")
    assert (tmp_path / "dive.mcap").is_file()
    assert bag_info(tmp_path / "dive.mcap").pairs == 2
    assert {path.name for path in tmp_path.iterdir()} == {"left", "right", "dive.mcap"}


def test_progress_sees_every_pair(tmp_path: Path) -> None:
    seen = []

    def follow(pairs):  # type: ignore[no-untyped-def]
        for pair in pairs:
            seen.append(Path(pair.left.name).name)
            yield pair

    pack(*folders(tmp_path, 3), tmp_path / "bag", progress=follow)
    assert seen == ["left_0.png", "left_1.png", "left_2.png"]


def refused(tmp_path: Path, *arguments: str, match: str, **options: object) -> None:
    before = sorted(tmp_path.iterdir())
    with pytest.raises((BagError, ImageError), match=match) as caught:
        pack(*arguments, tmp_path / "new", **options)  # type: ignore[arg-type]
    assert "\n" not in str(caught.value)
    assert sorted(tmp_path.iterdir()) == before


def test_what_cannot_be_packed(tmp_path: Path) -> None:
    left, right = folders(tmp_path, 4)
    refused(tmp_path, str(tmp_path / "nothing" / "*.png"), right, match="expected image files, found none")
    refused(tmp_path, left, left, match="expected two cameras' images, or both views in one")
    for path in (tmp_path / "right").iterdir():
        path.write_bytes(b"no image")
    refused(tmp_path, left, right, match=r"right_0\.png: expected an image file: expected JPEG or PNG")


def packed_numbers(bag_path: Path) -> list[int]:
    """Which stills a bag holds, by its first stamp of 1 s and two a second."""
    with open_bag(bag_path) as bag:
        pairs = list(bag.stereo_pairs())
    numbers = [round((pair.stamp_ns - 10**9) / 5e8) for pair in pairs]
    for number, pair in zip(numbers, pairs, strict=True):
        assert np.array_equal(pair.left, still(2 * number))
        assert np.array_equal(pair.right, still(2 * number + 1))
    return numbers


@pytest.mark.parametrize("bad", [0, 2])
def test_what_can_be_packed_is_and_the_rest_is_named(tmp_path: Path, bad: int) -> None:
    left, right = folders(tmp_path, 5)
    (tmp_path / "right" / f"right_{bad}.png").write_bytes(b"no image")
    write_image(tmp_path / "left" / "left_4.png", still(0)[:6])
    packed = pack(left, right, tmp_path / "bag")
    assert packed.pairs == 3
    assert f"right_{bad}.png: expected an image file" in packed.left_out[0]
    assert "left_4.png: expected 16x12 px colour 8 bit as left_" in packed.left_out[1]
    assert packed_numbers(tmp_path / "bag") == [n for n in range(4) if n != bad]


def test_a_first_image_of_another_size_does_not_decide_for_all(tmp_path: Path) -> None:
    left, right = folders(tmp_path, 4)
    write_image(tmp_path / "left" / "left_0.png", still(0)[:6])
    packed = pack(left, right, tmp_path / "bag")
    assert packed_numbers(tmp_path / "bag") == [1, 2, 3]
    assert len(packed.left_out) == 1


def test_a_still_without_a_partner_shifts_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left, right = folders(tmp_path, 5)
    (tmp_path / "right" / "right_1.png").unlink()
    assert pack(left, right, tmp_path / "bag") == (4, ())
    assert packed_numbers(tmp_path / "bag") == [0, 2, 3, 4]
    assert "1 left stills have no partner, first left_1.png" in capsys.readouterr().err


def test_the_command_says_what_was_left_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    left, right = folders(tmp_path, 3)
    (tmp_path / "left" / "left_1.png").write_bytes(b"")
    assert main(["pack", "--left", left, "--right", right, "-o", str(tmp_path / "bag")]) == 1
    told = capsys.readouterr().err
    assert "left_1.png" in told
    assert "bag: 2 pairs, 1 LEFT OUT" in told
    assert main(["pack", "--left", right, "--right", left, "-o", str(tmp_path / "other")]) == 1
    (tmp_path / "left" / "left_1.png").unlink()
    assert main(["pack", "--left", left, "--right", right, "-o", str(tmp_path / "third")]) == 0


def test_a_damaged_video_is_packed_as_far_as_it_goes(tmp_path: Path) -> None:
    for side, seed in (("left", 1), ("right", 2)):
        write_video(tmp_path / f"{side}.ts", [texture(seed * 100 + n, (96, 128)) for n in range(24)])
    data = bytearray((tmp_path / "right.ts").read_bytes())
    middle = len(data) // 2
    data[middle : middle + 3000] = bytes(3000)
    (tmp_path / "right.ts").write_bytes(data)
    packed = pack(str(tmp_path / "left.ts"), str(tmp_path / "right.ts"), tmp_path / "bag")
    assert packed.pairs >= 10
    assert packed.left_out
    assert all("right" in reason for reason in packed.left_out)


def test_a_damaged_image_in_a_bag_costs_its_pair(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "one") as bag:
        for number in range(4):
            for side in ("left", "right"):
                seed = number if side == "left" else number + 50
                message = messages.image_message(still(seed), time_ns=(1 + number) * 10**9, frame_id="cam")
                if (number, side) == (2, "right"):
                    message.step = 7
                bag.message(f"/{side}/image_raw", message)
    packed = pack(str(tmp_path / "one"), str(tmp_path / "one"), tmp_path / "bag")
    assert packed.pairs == 3
    assert len(packed.left_out) == 1


def test_a_calibration_for_another_size(tmp_path: Path) -> None:
    other = StereoCalibration(camera(32, 24), camera(32, 24, -0.1))
    refused(tmp_path, *folders(tmp_path, 2), match="expected 32x24 px as in the calibration", calibration=other)


def test_independently_numbered_files_are_paired_by_order(tmp_path: Path) -> None:
    for side, first in (("left", 100), ("right", 5000)):
        (tmp_path / side).mkdir()
        for i in range(3):
            write_image(tmp_path / side / f"{first + i}.png", still(i))
    assert pack(str(tmp_path / "left"), str(tmp_path / "right"), tmp_path / "bag") == (3, ())


def test_nothing_is_overwritten_unasked(tmp_path: Path) -> None:
    left, right = folders(tmp_path, 2)
    pack(left, right, tmp_path / "bag")
    with pytest.raises(BagError, match="already exists: choose another name"):
        pack(left, right, tmp_path / "bag")
    pack(left, right, tmp_path / "bag", overwrite=True, rate_hz=1.0)
    assert bag_info(tmp_path / "bag").rate_hz == pytest.approx(1.0)
    (tmp_path / "precious").mkdir()
    (tmp_path / "precious" / "thesis.txt").write_text("mine")
    with pytest.raises(BagError, match="expected a bag to replace, got something else"):
        pack(left, right, tmp_path / "precious", overwrite=True)
    assert (tmp_path / "precious" / "thesis.txt").read_text() == "mine"


def test_rate_must_be_positive(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="rate_hz: expected > 0 Hz, got 0"):
        pack("a", "b", tmp_path / "bag", rate_hz=0)


def test_a_writer_that_fails_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError), BagWriter(tmp_path / "bag") as writer:  # noqa: PT012
        writer.raw(recording(1)[0])
        raise RuntimeError("stop")
    with pytest.raises(BagError, match="expected messages to write, got none"):
        write_bag(tmp_path / "bag", [])
    assert list(tmp_path.iterdir()) == []


def test_write_bag_copies_messages(tmp_path: Path) -> None:
    recorded = recording(5)
    assert write_bag(tmp_path / "bag", recorded) == 10
    with open_bag(tmp_path / "bag") as bag:
        assert list(bag.raw_messages()) == recorded
