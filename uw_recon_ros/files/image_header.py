"""What an encoded image declares, read before anything is decoded; what would cost too much never meets a decoder.

A few bytes may declare 65535 x 65535 px, a chunk of 4 GB or a tile of one, and make a decoder ask for gigabytes; so the
headers are read here, by the formats' own specifications (PNG: ISO/IEC 15948; JPEG: ITU-T T.81; TIFF 6.0; BMP; WebP:
RFC 9649; JPEG 2000: ITU-T T.800; PNM; PFM), and held to `bounds`. Of a PNG, only what makes its pixels goes on.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Callable, Iterator

from uw_recon_ros.bounds import LARGEST_PIXELS, MOST_CHANNELS
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.kinds import HEAD, describe

_FORMATS = "JPEG or PNG data (or TIFF, BMP, WebP, JPEG 2000, PNM)"
_PNM = re.compile(rb"P[1-6](?:\s+(?:#[^\n]*\n\s*)*)(\d{1,10})(?:\s+(?:#[^\n]*\n\s*)*)(\d{1,10})\s")

_PFM = re.compile(rb"(P[Ff])\s+(\d{1,10})\s+(\d{1,10})\s+[-+.0-9eE]{1,32}\s")
_MOST_SCANS = 200  # of a progressive JPEG; ten are usual
_TIFF_TYPES = {1: ("B", 1), 2: ("", 1), 3: ("H", 2), 4: ("I", 4), 6: ("", 1), 7: ("", 1), 8: ("", 2), 9: ("", 4),
               11: ("", 4), 13: ("I", 4), 16: ("Q", 8), 18: ("Q", 8)}  # fmt: skip
_TIFF_COMPRESSIONS = (1, 5, 8, 32773, 32946)
_CODESTREAM_MARKERS = (0xFF51, 0xFF52, 0xFF5C, 0xFF5D, 0xFF64, 0xFF55)  # SIZ, COD, QCD, QCC, COM, TLM

Size = tuple[int, int]


_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
_PNG_PIXELS = (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")  # all that pixels are made of
_PNG_CHANNELS = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
_DEFLATE_MOST = 1032  # times that deflate can compress


def _png_chunks(data: memoryview) -> Iterator[tuple[bytes, memoryview]]:
    """Kind and bytes (length, kind and checksum included) of each chunk up to IEND, lengths and checksums verified."""
    place, kind = len(_PNG_MAGIC), b""
    while kind != b"IEND":
        length, kind = struct.unpack_from(">I4s", data, place)
        whole = data[place : place + length + 12]
        if len(whole) < length + 12:
            raise ValueError(f"a chunk of {length} bytes where {max(len(data) - place - 12, 0)} are left")
        if zlib.crc32(whole[4:-4]) != int.from_bytes(whole[-4:], "big"):
            raise ValueError(f"wrong checksum of chunk {kind!a}")
        yield kind, whole
        place += len(whole)


def _png(data: memoryview) -> Size:
    chunks = list(_png_chunks(data))
    if chunks[0][0] != b"IHDR" or len(chunks[0][1]) != 25:
        raise ValueError("no IHDR chunk")
    width, height, bits, color = struct.unpack_from(">IIBB", chunks[0][1], 8)
    packed = sum(len(whole) - 12 for kind, whole in chunks if kind == b"IDAT")
    raw = width * height * bits * _PNG_CHANNELS[color] // 8
    if raw > _DEFLATE_MOST * packed + 2**16 and width * height <= LARGEST_PIXELS:
        raise ValueError(f"{packed} bytes of pixels cannot be {width}x{height} px")
    return width, height


def pixels_only(data: memoryview) -> memoryview:
    """What a decoder needs: of a PNG, no colour profiles, texts or animation; of anything else, all.

    Raises
    ------
    ValueError, struct.error
        A damaged PNG.
    """
    if data[:8] != _PNG_MAGIC:
        return data
    kept = [whole for kind, whole in _png_chunks(data) if kind in _PNG_PIXELS]
    return memoryview(b"".join([_PNG_MAGIC, *kept]))


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
            height, width, channels = struct.unpack_from(">HHB", data, place + 5)
            _expect(channels <= MOST_CHANNELS, f"{channels} channels")
            _jpeg_end(data)
            return width, height
        else:
            place += 2 + max(struct.unpack_from(">H", data, place + 2)[0], 2)
    raise ValueError("no frame header")


def _jpeg_end(data: memoryview) -> None:
    """Decoders fill what is cut off with gray: it must not be matched. Each scan costs a pass over all pixels."""
    whole = bytes(data)
    if whole.rfind(b"\xff\xd9") < 0:
        raise ValueError("no end-of-image marker")
    _expect(whole.count(b"\xff\xda") <= _MOST_SCANS, "too many scans")


def _expect(fits: bool, got: str) -> None:
    if not fits:
        raise ValueError(f"{got}: more than any camera's image has")


def _tiff(data: memoryview) -> Size:
    """Of the first directory; its fields must lie within the file, and its tiles be no larger than the image."""
    order = "<" if data[0] == 0x49 else ">"
    big = struct.unpack_from(order + "H", data, 2)[0] == 43
    (place,) = struct.unpack_from(order + ("Q" if big else "I"), data, 8 if big else 4)
    (entries,) = struct.unpack_from(order + ("Q" if big else "H"), data, place)
    _expect(entries <= 512, f"{entries} fields")
    start, each = place + (8 if big else 2), 20 if big else 12
    found = dict(_tiff_field(data, start + each * entry, order, big) for entry in range(entries))
    width, height = found[256], found[257]
    _check_tiff(found, width * height)
    return width, height


def _tiff_field(data: memoryview, place: int, order: str, big: bool) -> tuple[int, int]:
    """Tag, and first value of an entry of whole numbers, as far as it is needed; 0 for others."""
    tag, kind, count = struct.unpack_from(order + ("HHQ" if big else "HHI"), data, place)
    form, size = _TIFF_TYPES.get(kind, ("", 8))
    value, inline = place + (12 if big else 8), 8 if big else 4
    if count * size > inline:
        (value,) = struct.unpack_from(order + ("Q" if big else "I"), data, value)
    if value + count * size > len(data):
        raise ValueError(f"field {tag} of {count} values reaches beyond the end")
    return tag, struct.unpack_from(order + form, data, value)[0] if form and count else 0


def _check_tiff(found: dict[int, int], pixels: int) -> None:
    compression, channels = found.get(259, 1), found.get(277, 1)
    if compression not in _TIFF_COMPRESSIONS:
        raise ValueError(f"compression {compression}: expected none, LZW, Deflate or PackBits; save it anew")
    _expect(channels <= MOST_CHANNELS, f"{channels} channels")
    if found.get(258, 1) > 32:
        raise ValueError(f"{found[258]} bits a channel: expected 8 or 16, or 32 for a map of float; save it anew")
    for unit, shape in (("tile", (322, 323)), ("strip", (256, 278))):
        if all(tag in found for tag in shape) and found[shape[1]] != 2**32 - 1:
            area = found[shape[0]] * (found[shape[1]] if unit == "tile" else min(found[278], found[257]))
            _expect(area <= pixels + 2**20, f"{unit}s of {area} px in an image of {pixels}")


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
    right, bottom, left, top, tile_width, tile_height, _, _, channels = struct.unpack_from(">8IH", data, place + 8)
    width, height = right - left, bottom - top
    _expect(channels <= MOST_CHANNELS, f"{channels} channels")
    if not (width > 0 and height > 0 and tile_width and tile_height):
        raise ValueError("no size")
    tiles = -(-width // tile_width) * -(-height // tile_height)
    _expect(tiles <= 1 + width * height // 4096, f"{tiles} tiles")
    _check_codestream(data, place + 2)
    return width, height


def _check_codestream(data: memoryview, place: int) -> None:
    """Walk through the main header: what is split finer than usual costs a decoder much for each pixel."""
    marker, length = struct.unpack_from(">HH", data, place)
    while marker != 0xFF90:  # start of the first tile
        if marker not in _CODESTREAM_MARKERS:
            raise ValueError(f"marker {marker:#x} in a JPEG 2000 header: expected a plain one; save it anew")
        if marker == 0xFF52:
            style, layers, levels, x, y = struct.unpack_from(">BxHxBBB", data, place + 4)
            precincts = bytes(data[place + 14 : place + 2 + length]) if style & 1 else b""
            coarse = all(min(exponents & 15, exponents >> 4) >= 5 for exponents in precincts[1:])
            _expect(layers <= 64 and levels <= 32 and x + y >= 4 and coarse, "finer parts or more layers")
        place += 2 + max(length, 2)
        marker, length = struct.unpack_from(">HH", data, place)


def _pfm(data: memoryview) -> Size:
    found = _PFM.match(bytes(data[:128]))
    if found is None:
        raise ValueError("no size")
    width, height = int(found[2]), int(found[3])
    channels = 3 if found[1] == b"PF" else 1
    if 4 * channels * width * height > len(data) - found.end():
        raise ValueError(f"{width}x{height} px declared, {len(data) - found.end()} bytes of them there")
    return width, height


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
    *((b"P%d" % kind, _pnm) for kind in range(1, 7)), (b"PF", _pfm), (b"Pf", _pfm),
)  # fmt: skip


def declared_size(data: memoryview, most_pixels: int = LARGEST_PIXELS) -> Size:
    """Read width and height, px, of an encoded image, and look whether it can be decoded within `bounds`.

    Parameters
    ----------
    data : memoryview of bytes
    most_pixels : int
        That it may have; at most `bounds.LARGEST_PIXELS`.

    Raises
    ------
    ImageError
        The format is none that is read here, the header makes no sense, or it declares more than is allowed.
    """
    head = bytes(data[:HEAD])
    read = next((reader for magic, reader in _READERS if head.startswith(magic)), None)
    if read is None:
        raise ImageError(f"compressed image: expected {_FORMATS}, got {len(data)} bytes: {describe(head)}")
    try:
        width, height = read(data)
    except (struct.error, ValueError, LookupError) as error:
        told = str(error) if type(error) is ValueError else "a field of its header is missing"
        raise ImageError(f"compressed image: {len(data)} bytes, damaged or cut short: {told}") from error
    most = min(most_pixels, LARGEST_PIXELS)
    if not (width > 0 and height > 0 and width * height <= most):
        raise ImageError(f"compressed image: expected a size of 1 to {most} px, got {width}x{height}")
    return width, height
