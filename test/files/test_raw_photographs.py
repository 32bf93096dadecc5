"""Raw photographs: what is developed is what was photographed; what cannot be is named in one line."""

from __future__ import annotations

import struct
import sys
from pathlib import Path

import numpy as np
import pytest
from helpers.raw_photographs import write_dng
from helpers.videos import texture

from uw_recon_ros.cli import main
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.images import image_size, read_image, write_image
from uw_recon_ros.findings import Code
from uw_recon_ros.recordings.info import inspect_recording
from uw_recon_ros.recordings.recording import Recording

HEIGHT, WIDTH = 96, 128


def needs_rawpy() -> None:
    pytest.importorskip("rawpy", reason="raw photographs need the extra 'raw'")


def srgb(linear: np.ndarray) -> np.ndarray:
    """IEC 61966-2-1."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)


def smooth(brightest: float = 0.6) -> np.ndarray:
    """Linear light, of slow colours that a Bayer mosaic holds."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    return brightest * np.stack([0.2 + 0.8 * x / WIDTH, 0.3 + 0.5 * y / HEIGHT, 0.9 - 0.7 * x / WIDTH], axis=-1)


def test_it_is_developed_as_a_camera_would(tmp_path: Path) -> None:
    needs_rawpy()
    image = read_image(write_dng(tmp_path / "a.DNG", smooth()))
    assert (image.shape, image.dtype) == ((HEIGHT, WIDTH, 3), np.uint16)
    assert image_size(tmp_path / "a.DNG") == (WIDTH, HEIGHT)
    inner = np.s_[4:-4, 4:-4]
    ratio = image[inner] / 65535 / srgb(smooth())[inner]
    assert np.abs(ratio / np.median(ratio, axis=(0, 1)) - 1).max() < 0.03  # but for a white balance of the matrix
    assert np.abs(np.median(ratio, axis=(0, 1)) - 1).max() < 0.1


def test_brightness_follows_no_picture(tmp_path: Path) -> None:
    """A dark frame stays dark: or frames, and both cameras, would differ by what they show."""
    needs_rawpy()
    bright = read_image(write_dng(tmp_path / "a.dng", smooth(0.8)))
    dark = read_image(write_dng(tmp_path / "b.dng", smooth(0.1)))
    expected = np.median(srgb(smooth(0.1)) / srgb(smooth(0.8)))
    assert np.median(dark / bright) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("orientation", "turns"), [(1, 0), (3, 2), (6, 3), (8, 1)])
def test_it_stands_upright(tmp_path: Path, orientation: int, turns: int) -> None:
    needs_rawpy()
    path = write_dng(tmp_path / "a.dng", smooth(), orientation)
    image = read_image(path)
    upright = np.rot90(srgb(smooth()), turns)
    assert image.shape == upright.shape
    assert image_size(path) == (image.shape[1], image.shape[0])
    assert np.corrcoef(image[..., 0].ravel(), upright[..., 0].ravel())[0, 1] > 0.99


@pytest.mark.parametrize("suffix", [".dng", ".nef", ".cr2", ".arw", ".gpr", ".heic"])
@pytest.mark.parametrize("kept", [0, 9, 200, 3000, -400])
def test_damaged_ones_are_refused_in_one_line(tmp_path: Path, suffix: str, kept: int) -> None:
    needs_rawpy()
    pytest.importorskip("pi_heif", reason="HEIC needs the extra 'raw'")
    whole = write_dng(tmp_path / "whole.dng", smooth()).read_bytes()
    path = tmp_path / f"cut{suffix}"
    path.write_bytes(whole[:kept])
    for read in (read_image, image_size):
        if read is image_size and kept == -400 and suffix != ".heic":
            continue  # the header is whole
        with pytest.raises(ImageError, match=rf"cut{suffix}: expected an image file: ") as error:
            read(path)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("suffix", [".heic", ".cr3"])
def test_a_box_that_is_cut_is_seen_before_anything_is_decoded(tmp_path: Path, suffix: str) -> None:
    needs_rawpy()
    pytest.importorskip("pi_heif", reason="HEIC needs the extra 'raw'")
    path = tmp_path / f"a{suffix}"
    path.write_bytes(
        struct.pack(">I4s8s", 16, b"ftyp", b"heic\0\0\0\0") + struct.pack(">I4s", 5000, b"mdat") + bytes(900)
    )
    for read in (read_image, image_size):
        with pytest.raises(ImageError, match="damaged or cut short: a part of it is missing"):
            read(path)


def test_few_bytes_that_say_they_are_many_pixels_are_refused(tmp_path: Path) -> None:
    needs_rawpy()
    data = write_dng(tmp_path / "a.dng", smooth()).read_bytes()
    for side in (WIDTH, HEIGHT):  # both in the header, 32 times as many
        data = data.replace(struct.pack("<I", side), struct.pack("<I", 32 * side), 1)
    (tmp_path / "a.dng").write_bytes(data)
    for read in (read_image, image_size):
        with pytest.raises(ImageError, match=r"a\.dng: .*damaged or cut short"):
            read(tmp_path / "a.dng")


@pytest.mark.parametrize(("suffix", "module"), [(".nef", "rawpy"), (".heic", "pi_heif")])
def test_without_the_extra_the_way_out_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], suffix: str, module: str
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    rig(tmp_path, suffix)
    with pytest.raises(ImageError, match=r"pip install '\.\[raw\]'"):
        read_image(tmp_path / "left" / f"0{suffix}")
    with pytest.raises(BagError, match=r"pip install '\.\[raw\]' in the sources' folder, or develop it") as error:
        Recording(tmp_path)
    assert error.value.code == Code.RECORDING_EXTRA
    for words in (
        ["info", str(tmp_path)],
        ["survey", str(tmp_path), "-o", str(tmp_path / "out")],
        ["pack", "--left", str(tmp_path / "left"), "--right", str(tmp_path / "right"), "-o", str(tmp_path / "bag")],
        ["pair", *(str(tmp_path / side / f"0{suffix}") for side in ("left", "right")), "-o", str(tmp_path / "p")],
        ["calibrate", str(tmp_path), "-o", str(tmp_path / "c")],
    ):
        assert main(words) == 1
        told = capsys.readouterr()
        assert "pip install '.[raw]' in the sources' folder" in told.out + told.err, words


def test_a_jpeg_that_was_only_renamed_is_read(tmp_path: Path) -> None:
    image = texture(1, (HEIGHT, WIDTH), 3.0)
    write_image(tmp_path / "a.jpg", image)
    renamed = (tmp_path / "a.jpg").rename(tmp_path / "a.HEIC")
    assert image_size(renamed) == (WIDTH, HEIGHT)
    assert np.abs(read_image(renamed).astype(float) - image).mean() < 8


def rig(folder: Path, suffix: str = ".dng", count: int = 3) -> None:
    for number, side in enumerate(("left", "right")):
        (folder / side).mkdir()
        for n in range(count):
            linear = (texture(2 * n + number, (HEIGHT, WIDTH), 3.0) / 255.0) ** 2.2
            write_dng(folder / side / f"{n}{suffix}", linear)


def test_a_folder_of_them_is_a_recording(tmp_path: Path) -> None:
    needs_rawpy()
    rig(tmp_path)
    (info,) = inspect_recording(tmp_path)
    assert info.reconstructable, info.reasons
    assert info.left is not None
    assert (info.pairs, info.left.width, info.left.kind) == (3, WIDTH, "colour, 16 bits")
    with Recording(tmp_path) as recording:
        seen = recording[1].left
        expected = texture(2, (HEIGHT, WIDTH), 3.0)
        assert np.corrcoef(seen[8:-8, 8:-8, 1].ravel(), expected[8:-8, 8:-8, 1].ravel())[0, 1] > 0.98
    (tmp_path / "right" / "1.dng").write_bytes(b"II*\0")
    (info,) = inspect_recording(tmp_path)
    assert (info.pairs, info.reconstructable) == (2, True)


def test_where_cameras_wrote_both_the_others_are_taken(tmp_path: Path) -> None:
    needs_rawpy()
    rig(tmp_path)
    for number, side in enumerate(("left", "right")):
        for n in range(3):
            write_image(tmp_path / side / f"{n}.png", texture(2 * n + number, (HEIGHT, WIDTH)))
    with Recording(tmp_path) as recording:
        assert len(recording) == 3
        assert recording[0].left.dtype == np.uint8
        assert any("also there, not read: 6 .dng" in note for note in recording.listing.notes)
