"""The inside of an MCAP chunk: decompressed, checked, cut into records, whatever its state.

The layout is that of the MCAP specification, version 0: a record is an opcode (uint8), a length (uint64), its content.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.exceptions import McapError

from uw_recon_ros.bounds import OverBudgetError, unpacked_limit

Buffer = bytes | memoryview

#: What a damaged record makes the libraries raise.
DAMAGE = (
    McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, OverflowError, EOFError, MemoryError,
    RuntimeError,
)  # fmt: skip

_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
_CHUNK = struct.Struct("<QQQI")  # first and last log time, uncompressed size and CRC

#: Bytes of a chunk, or of a message, compressed or not: what claims more must not fill the memory.
LARGEST = 2**28
RECORD_HEADER = _RECORD.size
MESSAGE_HEADER = _MESSAGE.size


def record_header(data: Buffer, offset: int = 0) -> tuple[int, int]:
    """Opcode and content length of the record at `offset`."""
    opcode, length = _RECORD.unpack_from(data, offset)
    return int(opcode), int(length)


def loss(offset: int, error: Exception) -> str:
    """Say that the chunk at byte `offset` is damaged."""
    return f"chunk at byte {offset} is damaged ({reason_of(error)}): messages lost"


def reason_of(error: Exception) -> str:
    """Why something cannot be read: our own words, never a library's."""
    if type(error) in (ValueError, OverBudgetError):
        return str(error)
    if isinstance(error, MemoryError):
        return "no memory is left"
    return "its compressed bytes" if isinstance(error, (zstandard.ZstdError, RuntimeError)) else "its fields"


def message_header(content: Buffer) -> tuple[int, int]:
    """Channel and log time (ns) of a Message record."""
    channel, _, log_time, _ = _MESSAGE.unpack_from(content)
    return int(channel), int(log_time)


def records(data: Buffer) -> Iterator[tuple[int, memoryview]]:
    """Opcode and content of record after record.

    Raises
    ------
    ValueError
        At a record that goes on beyond the end; those before it have been yielded.
    """
    view, offset = memoryview(data), 0
    while offset < len(view):
        if offset + RECORD_HEADER > len(view):
            raise ValueError(f"{len(view) - offset} bytes too many at its end")
        opcode, length = record_header(view, offset)
        if not opcode:
            raise ValueError("a record of kind 0")
        offset += RECORD_HEADER
        if offset + length > len(view):
            raise ValueError(f"a record of {length} bytes where {len(view) - offset} are left")
        yield opcode, view[offset : offset + length]
        offset += length


def _split(content: Buffer) -> tuple[int, int, str, memoryview]:
    """Uncompressed size, CRC, compression, data (as much as is there)."""
    view = memoryview(content)
    _, _, size, crc = _CHUNK.unpack_from(view)
    offset = _CHUNK.size
    (name_length,) = struct.unpack_from("<I", view, offset)
    if name_length > 16:
        raise ValueError(f"a compression name of {name_length} bytes")
    name = bytes(view[offset + 4 : offset + 4 + name_length]).decode()
    offset += 4 + name_length
    (length,) = struct.unpack_from("<Q", view, offset)
    return size, crc, name, view[offset + 8 : offset + 8 + length]


def claimed_size(content: Buffer) -> int:
    """Uncompressed bytes that a Chunk record claims; at most `LARGEST`.

    Raises
    ------
    one of `DAMAGE`
    """
    size, _, _, data = _split(content)
    return _allowed(size, len(data))


def _allowed(size: int, packed: int) -> int:
    """The claimed size, if that many packed bytes may become so much."""
    most = min(unpacked_limit(packed), LARGEST)
    if size > most:
        raise ValueError(f"{size} bytes claimed, by {packed} packed ones: at most {most} are read")
    return size


def inflate(content: Buffer) -> bytes:
    """Decompress the records of a whole Chunk record and check its CRC where it has one.

    Raises
    ------
    one of `DAMAGE`
    """
    size, crc, compression, data = _split(content)
    _allowed(size, len(data))
    records_bytes = _decompress(compression, data, size)
    if len(records_bytes) != size:
        raise ValueError(f"{size} bytes claimed, {len(records_bytes)} there")
    if crc and zlib.crc32(records_bytes) != crc:
        raise ValueError("checksum wrong")
    return records_bytes


def _decompress(compression: str, data: memoryview, size: int) -> bytes:
    if not compression or not size:
        return bytes(data)
    if compression == "zstd":
        if zstandard.frame_content_size(data) > size:
            raise ValueError(f"{zstandard.frame_content_size(data)} bytes inside, {size} claimed")
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
    raise ValueError(f"unknown compression {compression!r}")


def inflate_rest(content: Buffer) -> bytes:
    """Decompress as much as there is of a Chunk record that the file's end cut off."""
    size, _, compression, data = _split(content)
    if not compression:
        return bytes(data)
    most = min(size, unpacked_limit(len(data)), LARGEST)
    if compression == "zstd":
        return zstandard.ZstdDecompressor().stream_reader(bytes(data)).read(most)
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
