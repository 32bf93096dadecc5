"""Raw photographs (DNG, NEF, CR2, ARW, GPR ...) by LibRaw, and HEIC by libheif: an extra, ``raw``.

A raw photograph is developed the same way for every frame and both cameras: daylight's white balance, no brightness
that follows the picture, sRGB's curve, 16 bits. So it looks as a camera's own JPEG or PNG does (display-referred), as
all else here expects, and keeps what that would cut off.
"""

from __future__ import annotations

import io
import struct
from contextlib import suppress
from typing import Any

import numpy as np

from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.errors import ImageError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import RawImage

HEIF = frozenset((".heic", ".heif"))
#: By their suffixes, lower case.
SUFFIXES = HEIF | frozenset((".dng", ".nef", ".cr2", ".cr3", ".arw", ".gpr", ".orf", ".rw2", ".raf"))
_SRGB = (2.4, 12.92)
_MOST_DIRECTORIES = 64
_LEAST_BITS = 0.3  # a pixel; lossy DNG has one or more
_WAY_OUT = "pip install '.[raw]' in the sources' folder, or develop it to 16-bit TIFF or PNG first"


def expect_library(suffix: str) -> Any:
    """What reads files of a suffix: rawpy or pi_heif.

    Raises
    ------
    ImageError
        It is not installed.
    """
    try:
        if suffix in HEIF:
            import pi_heif

            return pi_heif
        import rawpy
    except ImportError as error:
        text = f"a raw photograph ({suffix}): expected the extra 'raw' to be installed: {_WAY_OUT}"
        raise ImageError(text, Code.RECORDING_EXTRA) from error
    return rawpy


def read_photograph(data: bytes, suffix: str, most_pixels: int = LARGEST_PIXELS) -> RawImage:
    """Develop a raw photograph, or decode a HEIC; upright, as it says.

    Returns
    -------
    (H, W, 3) uint16 of raw ones, (H, W) or (H, W, 3) uint8 or uint16 of HEIC
        Mono, or RGB.

    Raises
    ------
    ImageError
        The extra is not installed, the file is damaged, or it is of a kind that the library does not know.
    """
    library = expect_library(suffix)
    try:
        _expect_boxes(data)
        if suffix in HEIF:
            opened = library.open_heif(data, convert_hdr_to_8bit=False)
            _expect_size(opened.size[0], opened.size[1], most_pixels)
            image = np.array(opened)  # a copy: its memory goes with it
            return np.ascontiguousarray(image[..., :3] if image.ndim == 3 else image)
        with library.imread(io.BytesIO(data)) as opened:
            _expect_size(opened.sizes.raw_width, opened.sizes.raw_height, most_pixels)
            _expect_bytes(len(data), opened.sizes)
            developed: RawImage = opened.postprocess(
                output_bps=16, gamma=_SRGB, no_auto_bright=True, adjust_maximum_thr=0.0, use_camera_wb=False,
                use_auto_wb=False, output_color=library.ColorSpace.sRGB,
            )  # fmt: skip
            return developed
    except _errors_of(library) as error:
        raise _damaged(data, suffix, error) from error


def photograph_size(data: bytes, suffix: str) -> tuple[int, int]:
    """Width and height, px, upright; not developed. Raises as `read_photograph` does, as far as the header tells."""
    library = expect_library(suffix)
    try:
        _expect_boxes(data)
        if suffix in HEIF:
            width, height = library.open_heif(data, convert_hdr_to_8bit=False).size
        else:
            _expect_whole(data)
            with library.imread(io.BytesIO(data)) as opened:
                _expect_bytes(len(data), opened.sizes)
                turned = opened.sizes.flip in (5, 6)  # LibRaw's words for a quarter turn
                width, height = opened.sizes.iwidth, opened.sizes.iheight
                width, height = (height, width) if turned else (width, height)
    except _errors_of(library) as error:
        raise _damaged(data, suffix, error) from error
    _expect_size(width, height, LARGEST_PIXELS)
    return int(width), int(height)


def _expect_bytes(count: int, sizes: Any) -> None:
    """Raise ValueError where so few bytes cannot be so many pixels: LibRaw shows some of these black."""
    if 8 * count < _LEAST_BITS * sizes.raw_width * sizes.raw_height:
        raise ValueError(f"so few cannot be {sizes.raw_width}x{sizes.raw_height} px")


def _expect_boxes(data: bytes) -> None:
    """Raise ValueError where a box of a file built of boxes (HEIC, CR3) is cut: libheif shows what is left of it."""
    place = 0
    while data[4:8] == b"ftyp" and place < len(data):
        head = data[place : place + 16]
        size = int.from_bytes(head[:4], "big")
        size = int.from_bytes(head[8:16], "big") if size == 1 else size
        if size == 0:  # to the end
            return
        if size < 8 or place + size > len(data):
            raise ValueError("a part of it is missing")
        place += size


def _expect_whole(data: bytes) -> None:
    """Raise ValueError where strips or tiles of a file built as TIFF (DNG, NEF, CR2, ARW, GPR) reach beyond its end."""
    order = {b"II*\0": "<", b"MM\0*": ">"}.get(data[:4])
    if order is None:
        return
    with suppress(struct.error, IndexError):
        places, seen = [struct.unpack_from(order + "I", data, 4)[0]], set[int]()
        while places and len(seen) < _MOST_DIRECTORIES:
            place = places.pop()
            if not place or place in seen:
                continue
            seen.add(place)
            fields, following = _directory(data, place, order)
            places += [following, *fields.get(330, ())]
            for offsets, counts in ((273, 279), (324, 325)):
                ends = map(sum, zip(fields.get(offsets, ()), fields.get(counts, ()), strict=False))
                if max(ends, default=0) > len(data):
                    raise ValueError("its pixels reach beyond its end")


def _directory(data: bytes, place: int, order: str) -> tuple[dict[int, tuple[int, ...]], int]:
    """The whole numbers of a TIFF directory that say where things are, and where the next one is."""
    (entries,) = struct.unpack_from(order + "H", data, place)
    found = {}
    for entry in range(min(entries, 512)):
        at = place + 2 + 12 * entry
        tag, kind, count = struct.unpack_from(order + "HHI", data, at)
        if tag in (273, 279, 324, 325, 330) and kind in (3, 4, 13) and count <= len(data):
            form = f"{order}{count}{'H' if kind == 3 else 'I'}"
            where = at + 8
            if struct.calcsize(form) > 4:
                (where,) = struct.unpack_from(order + "I", data, at + 8)
            found[tag] = struct.unpack_from(form, data, where)
    return found, struct.unpack_from(order + "I", data, place + 2 + 12 * entries)[0]


def _errors_of(library: Any) -> tuple[type[Exception], ...]:
    own = (library.LibRawError,) if hasattr(library, "LibRawError") else ()
    return (ValueError, RuntimeError, OSError, MemoryError, *own)


def _expect_size(width: int, height: int, most_pixels: int) -> None:
    most = min(most_pixels, LARGEST_PIXELS)
    if not 0 < width * height <= most:
        raise ImageError(f"raw photograph: expected a size of 1 to {most} px, got {width}x{height}")


def _damaged(data: bytes, suffix: str, error: Exception) -> ImageError:
    if type(error).__name__ == "LibRawFileUnsupportedError":
        known = "GoPro's packing" if suffix == ".gpr" else "a kind"
        text = f"raw photograph ({suffix}): {len(data)} bytes, damaged or of {known} that this LibRaw does not know"
        return ImageError(f"{text}: convert it to DNG (Adobe DNG Converter) or 16-bit TIFF first")
    told = error.args[0].decode(errors="replace") if error.args and isinstance(error.args[0], bytes) else str(error)
    text = f"raw photograph ({suffix}): {len(data)} bytes, damaged or cut short"
    return ImageError(f"{text}: {' '.join(told.split())[:80]}")
