"""What decoding an image may cost: measured in a process of its own, on images spoiled byte by byte and on purpose."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from uw_recon_ros.bounds import BYTES_PER_PIXEL, SPARE_BYTES
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.disparities import read_disparity
from uw_recon_ros.files.images import decode_compressed

CHILD = """
import json, os, resource, sys
import cv2, numpy as np
cv2.setNumThreads(1)
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.images import decode_any
decode, starved = cv2.imdecode, []
def watched(*given):
    try:
        return decode(*given)
    except cv2.error as error:
        if error.code == -4:  # no memory
            starved.append(str(error))
        raise
cv2.imdecode = watched
watched(np.frombuffer(open(sys.argv[1], "rb").read(), np.uint8), -1)
def mapped():
    return int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
told = []
for name in sys.argv[3:]:
    data = open(name, "rb").read()
    room = mapped() + int(sys.argv[2])
    resource.setrlimit(resource.RLIMIT_AS, (room, resource.RLIM_INFINITY))
    try:
        told.append(list(decode_any(data).shape))
    except ImageError as error:
        told.append(str(error))
    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
grown = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
print(json.dumps(dict(told=told, starved=starved, grown=1024 * grown)))
"""


def decoded_in_child(folder: Path, images: list[bytes], room: int) -> tuple[list[object], int]:
    """What became of each, and by how many bytes the process grew, its address space having `room` bytes left."""
    sound = folder / "sound.png"
    sound.write_bytes(encoded(".png"))
    names = [folder / f"{i}" for i in range(len(images))]
    for name, data in zip(names, images, strict=True):
        name.write_bytes(data)
    done = subprocess.run(
        [sys.executable, "-c", CHILD, str(sound), str(room), *map(str, names)],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    result = json.loads(done.stdout.splitlines()[-1])
    assert not result["starved"]
    return result["told"], result["grown"]


def picture(height: int = 48, width: int = 64, kind: type = np.uint8, channels: int = 3) -> np.ndarray:
    return np.random.default_rng(3).integers(0, 256, (height, width, channels)).astype(kind).squeeze()


def encoded(suffix: str, **form: int) -> bytes:
    return bytes(cv2.imencode(suffix, picture(**form))[1])


def chunk(kind: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))


def png(*chunks: bytes, size: tuple[int, int] = (64, 48)) -> bytes:
    head = chunk(b"IHDR", struct.pack(">IIBBBBB", *size, 8, 0, 0, 0, 0))
    rows = chunk(b"IDAT", zlib.compress(bytes(65 * 48)))
    return b"\x89PNG\r\n\x1a\n" + head + b"".join(chunks) + rows + chunk(b"IEND", b"")


def flipped_length() -> bytes:
    data = bytearray(encoded(".png"))
    data[data.index(b"IDAT") - 4] = 0xF4
    return bytes(data)


def tiff(**tags: int) -> bytes:
    """A TIFF of 64 x 48 px, with entries as given by the tag's number (``t322=...``)."""
    fields = {256: 64, 257: 48, 258: 8, 259: 1, 262: 1, 273: 8, 277: 1, 278: 48, 279: 3072}
    fields |= {int(name[1:]): value for name, value in tags.items()}
    entries = b"".join(struct.pack("<HHII", tag, 4, 1, value) for tag, value in sorted(fields.items()))
    return b"II\x2a\0" + struct.pack("<I", 8 + 3072) + bytes(3072) + struct.pack("<H", len(fields)) + entries + bytes(4)


def jpeg_2000(at: int, form: str, value: int) -> bytes:
    """A JPEG 2000 image with a field of its SIZ (`at` < 40) or COD segment overwritten."""
    data = bytearray(encoded(".jp2"))
    place = data.index(b"\xff\x4f\xff\x51") + 2 if at < 40 else data.index(b"\xff\x52") - 40
    struct.pack_into(form, data, place + at, value)
    return bytes(data)


def counts(data: bytes, count: int) -> bytes:
    """The same TIFF, its strips counted otherwise."""
    return data.replace(struct.pack("<HHI", 279, 4, 1), struct.pack("<HHI", 279, 4, count))


def jpeg_2000_tiles() -> bytes:
    data = bytearray(encoded(".jp2"))
    place = data.index(b"\xff\x4f\xff\x51") + 2
    struct.pack_into(">II", data, place + 22, 1, 1)
    return bytes(data)


ATTACKS: dict[str, tuple[Callable[[], bytes], str]] = {
    "PNG, length flipped": (flipped_length, "bytes where"),
    "PNG, declared large": (lambda: png(size=(8192, 8192)), "cannot be 8192x8192 px"),
    "PNG, checksum": (lambda: encoded(".png").replace(b"IDAT", b"IDAT\1", 1), "wrong checksum"),
    "PNG, too large": (lambda: png(size=(2**31, 2**31)), "expected a size of 1 to"),
    "TIFF, huge tiles": (lambda: tiff(t322=32768, t323=32768, t324=8, t325=3072), "tiles of 1073741824 px"),
    "TIFF, wide strips": (lambda: tiff(t256=2**22, t257=2**22), "expected a size"),
    "TIFF, float64": (lambda: tiff(t258=64, t339=3), "64 bits a channel"),
    "TIFF, LZMA": (lambda: tiff(t259=34925), "compression 34925"),
    "TIFF, channels": (lambda: tiff(t277=60000), "60000 channels"),
    "TIFF, counts": (lambda: counts(tiff(), 2**31), "reaches beyond the end"),
    "JPEG 2000, tiles of 1 px": (jpeg_2000_tiles, "tiles"),
    "JPEG 2000, components": (lambda: jpeg_2000(38, ">H", 16384), "16384 channels"),
    "JPEG 2000, layers": (lambda: jpeg_2000(40 + 6, ">H", 65535), "finer parts or more layers"),
    "PFM": (lambda: b"Pf\n8000 8000\n-1.0\n" + bytes(100), "8000x8000 px declared, 100 bytes"),
    "PFM, too large": (lambda: b"Pf\n99999999 99999999\n-1.0\n" + bytes(100), "px declared"),
    "JPEG, scans": (lambda: encoded(".jpg")[:-2] + 300 * b"\xff\xda\0\2" + b"\xff\xd9", "too many scans"),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_attacks_are_refused_for_what_they_are(name: str) -> None:
    make, told = ATTACKS[name]
    with pytest.raises(ImageError) as error:
        decode_compressed(make())
    assert told in str(error.value)


def test_attacks_cost_nothing(tmp_path: Path) -> None:
    """Before, the first alone took 4.1 GB, and a float64 TIFF of 522 kB 1.1 GB."""
    told, grown = decoded_in_child(tmp_path, [make() for make, _ in ATTACKS.values()], SPARE_BYTES)
    assert all(isinstance(each, str) for each in told)
    assert grown < 16 * 2**20


@pytest.mark.parametrize("suffix", [".png", ".jpg", ".tiff", ".bmp", ".webp", ".jp2", ".ppm", ".pfm"])
def test_flipped_bytes_stay_within_the_bound(tmp_path: Path, suffix: str) -> None:
    """Each header byte set to extremes, and random ones: nothing allocates more than the bound for its small image."""
    kind = {"kind": np.float32, "channels": 1} if suffix == ".pfm" else {}
    data = encoded(suffix, **kind)
    dice = np.random.default_rng(len(suffix))
    spoiled = []
    for place in [*range(8, min(len(data), 130)), *dice.integers(0, len(data), 40)]:
        for value in (0, 0xFF, int(dice.integers(256))):
            changed = bytearray(data)
            changed[place] = value
            spoiled.append(bytes(changed))
    told, grown = decoded_in_child(tmp_path, spoiled, SPARE_BYTES + BYTES_PER_PIXEL * 2**26)
    largest = max([each[0] * each[1] for each in told if isinstance(each, list)], default=0)
    declared = [int(w) * int(h) for each in told if isinstance(each, str) for w, h in _sizes(each)]
    assert grown < SPARE_BYTES + BYTES_PER_PIXEL * max(largest, *declared, 0)


def _sizes(text: str) -> list[tuple[str, str]]:
    if " px declared" not in text:
        return []
    width, height = text.split(" px declared")[0].split()[-1].split("x")
    return [(width, height)]


def test_only_what_makes_pixels_meets_the_decoder() -> None:
    """Colour profiles, texts and animation control are left behind; the image is the same."""
    profile = chunk(b"iCCP", b"x\0\0" + zlib.compress(bytes(10_000_000)))
    plain = decode_compressed(png())
    frames = chunk(b"acTL", struct.pack(">II", 2**30, 0))
    for extra in (profile, frames, chunk(b"tEXt", b"a\0" + bytes(1000))):
        assert np.array_equal(decode_compressed(png(extra)), plain)


def test_evaluate_refuses_maps_of_impossible_size(tmp_path: Path) -> None:
    for name, data, told in (
        ("a.pfm", b"Pf\n60000 60000\n-1.0\n" + bytes(64), "60000x60000 px declared, 64 bytes of them there"),
        ("b.tiff", tiff(t258=64, t339=3), "64 bits a channel: expected 8 or 16, or 32 for a map of float"),
        ("c.png", encoded(".png"), "expected a one-channel float32 PFM or TIFF, got uint8"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(ImageError) as error:
            read_disparity(tmp_path / name)
        assert told in str(error.value)
        assert name in str(error.value)
    for suffix in (".pfm", ".tiff"):
        whole = picture(kind=np.float32, channels=1)
        (tmp_path / f"d{suffix}").write_bytes(bytes(cv2.imencode(suffix, whole)[1]))
        assert np.array_equal(read_disparity(tmp_path / f"d{suffix}"), whole)
