"""The size that an encoded image declares, read before anything is decoded.

A few bytes may declare 65535 x 65535 px and make a decoder ask for gigabytes; so the header is read here, by the
formats' own specifications (PNG: ISO/IEC 15948; JPEG: ITU-T T.81; TIFF 6.0; BMP; WebP: RFC 9649; JPEG 2000: ITU-T
T.800; PNM), and what is too large is never handed to a decoder.
"""

from __future__ import annotations

import re
import struct
from collections.abc import Callable

from uw_recon_ros.errors import ImageError

#: Most pixels an encoded image may have: 8192 x 8192. A mono image then takes 64 MiB, 16-bit RGBA 512 MiB.
LARGEST_PIXELS = 2**26
_FORMATS = "JPEG or PNG data (or TIFF, BMP, WebP, JPEG 2000, PNM)"
_PNM = re.compile(rb"P[1-6](?:\s+(?:#[^\n]*\n\s*)*)(\d{1,10})(?:\s+(?:#[^\n]*\n\s*)*)(\d{1,10})\s")

Size = tuple[int, int]


def _png(data: memoryview) -> Size:
    if bytes(data[12:16]) != b"IHDR":
        raise ValueError("no IHDR chunk")
    width, height = struct.unpack_from(">II", data, 16)
    return width, height


def _jpeg(data: memoryview) -> Size:
    """Of the frame header (SOF0 to SOF15 but DHT, JPG, DAC), after any other segments."""
    place = 2
    while place + 4 <= len(data):
        if data[place] != 0xFF:
            raise ValueError(f"no marker at byte {place}")
        marker = data[place + 1]
        if marker == 0xFF:  # fill
            place += 1
        elif marker == 0x01 or 0xD0 <= marker <= 0xD7:  # stand alone
            place += 2
        elif 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", data, place + 5)
            _jpeg_end(data)
            return width, height
        else:
            place += 2 + max(struct.unpack_from(">H", data, place + 2)[0], 2)
    raise ValueError("no frame header")


def _jpeg_end(data: memoryview) -> None:
    """Decoders fill what is cut off with gray: it must not be matched."""
    if bytes(data).rfind(b"\xff\xd9") < 0:
        raise ValueError("cut short, no end-of-image marker")


def _tiff(data: memoryview) -> Size:
    order = "<" if data[0] == 0x49 else ">"
    big = struct.unpack_from(order + "H", data, 2)[0] == 43
    (place,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    (entries,) = struct.unpack_from(order + ("Q" if big else "H"), data, place)
    place, each = place + (8 if big else 2), 20 if big else 12
    found: dict[int, int] = {}
    for entry in range(min(entries, 4096)):
        tag, kind = struct.unpack_from(order + "HH", data, place + each * entry)
        if tag in (256, 257):
            form = {3: "H", 4: "I", 16: "Q"}.get(kind, "I")
            (found[tag],) = struct.unpack_from(order + form, data, place + each * entry + (12 if big else 8))
    return found[256], found[257]


def _bmp(data: memoryview) -> Size:
    (header,) = struct.unpack_from("<I", data, 14)
    width, height = struct.unpack_from("<HH" if header == 12 else "<ii", data, 18)
    return width, abs(height)


def _webp(data: memoryview) -> Size:
    kind = bytes(data[12:16])
    if kind == b"VP8X":
        return 1 + int.from_bytes(data[24:27], "little"), 1 + int.from_bytes(data[27:30], "little")
    if kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", data, 21)
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    width, height = struct.unpack_from("<HH", data, 26)
    return width & 0x3FFF, height & 0x3FFF


def _jpeg_2000(data: memoryview) -> Size:
    place = bytes(data[:4096]).find(b"\xff\x4f\xff\x51")
    if place < 0:
        raise ValueError("no codestream")
    right, bottom, left, top = struct.unpack_from(">IIII", data, place + 8)
    return right - left, bottom - top


def _pnm(data: memoryview) -> Size:
    found = _PNM.match(bytes(data[:4096]))
    if found is None:
        raise ValueError("no size")
    return int(found[1]), int(found[2])


_READERS: tuple[tuple[bytes, Callable[[memoryview], Size]], ...] = (
    (b"\xff\xd8\xff", _jpeg),
    (b"\x89PNG\r\n\x1a\n", _png),
    (b"II\x2a\0", _tiff), (b"MM\0\x2a", _tiff), (b"II\x2b\0", _tiff), (b"MM\0\x2b", _tiff),
    (b"BM", _bmp),
    (b"RIFF", _webp),
    (b"\0\0\0\x0cjP  ", _jpeg_2000), (b"\xff\x4f\xff\x51", _jpeg_2000),
    *((b"P%d" % kind, _pnm) for kind in range(1, 7)),
)  # fmt: skip


def declared_size(data: memoryview) -> Size:
    """Read width and height, px, of an encoded image.

    Parameters
    ----------
    data : memoryview of bytes

    Raises
    ------
    ImageError
        The format is none that is read here, the header makes no sense, or it declares more than `LARGEST_PIXELS`.
    """
    head = bytes(data[:12])
    read = next((reader for magic, reader in _READERS if head.startswith(magic)), None)
    if read is None:
        raise ImageError(f"compressed image: expected {_FORMATS}, got {len(data)} bytes of something else")
    try:
        width, height = read(data)
    except (struct.error, ValueError, KeyError, IndexError) as error:
        raise ImageError(f"compressed image: {len(data)} bytes with a damaged header ({error})") from error
    if not (width > 0 and height > 0 and width * height <= LARGEST_PIXELS):
        raise ImageError(f"compressed image: expected a size of 1 to {LARGEST_PIXELS} px, got {width}x{height}")
    return width, height
