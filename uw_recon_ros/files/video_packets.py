"""Packets of encoded video, one an image, as messages hold them: decoded by PyAV, an extra.

A packet that is lost spoils all images up to the next key frame. FFmpeg tells of H.265; of the others it shows wrong
images without a word. So the number that each slice of H.264 carries is read here; of VP9 and AV1 only the times tell,
once two packets have come one after the other.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import RawImage

_CODECS = {"h264": "h264", "avc": "h264", "x264": "h264", "h265": "hevc", "hevc": "hevc", "x265": "hevc", "vp9": "vp9",
           "av1": "libdav1d"}  # fmt: skip
_KEY_H264, _KEY_HEVC = {5}, set(range(16, 22))  # types of NAL units that begin anew
_AV1_SEQUENCE_HEADER = 1  # in every key frame of a stream that can be joined
_HIGH_PROFILES = {44, 83, 86, 100, 110, 118, 122, 128, 134, 135, 138, 139, 244}
_LONGEST_HEADER = 512  # bytes of a NAL unit that are looked at
_MOST_UNITS = 500  # of a packet
_GAP = 1.8  # times the usual interval: a packet of a codec without numbers is missing


def library() -> Any:
    """PyAV.

    Raises
    ------
    BagError
        It is not installed.
    """
    try:
        import av
    except ImportError as error:
        raise BagError(
            "a video: expected the extra 'video' to be installed: pip install '.[video]' in the sources' folder",
            Code.RECORDING_EXTRA,
        ) from error
    return av


def is_video(message: Any) -> bool:
    """Whether a message holds a packet of video: by its type, or, of a CompressedImage, by its format."""
    return hasattr(message, "pts") or hasattr(message, "timestamp") or codec_named(_told(message)) is not None


def video_codec(message: Any) -> str | None:
    """FFmpeg's name of the decoder for a message's data; None where it is no video.

    Raises
    ------
    ImageError
        It is a message of video in a codec that is not known here.
    """
    codec = codec_named(_told(message))
    if codec is None and is_video(message):
        raise ImageError(f"video: expected h264, h265, vp9 or av1, got {_told(message)[:40]!r}", Code.VIDEO_FORMAT)
    return codec


def _told(message: Any) -> str:
    if str(getattr(message, "__msgtype__", "")).startswith("h264_msgs/"):
        return "h264"
    return str(message.encoding if hasattr(message, "pts") else getattr(message, "format", ""))


def codec_named(text: str) -> str | None:
    """FFmpeg's name of the decoder that a message's ``format`` or ``encoding`` asks for; None: of no video."""
    return next((codec for word, codec in _CODECS.items() if word in text.lower()), None)


def is_key(data: bytes, codec: str) -> bool:
    """Whether a packet can be decoded without those before it."""
    if codec == "vp9":  # its frame header: marker 2 bits, profile 2, a frame shown again 1, no key frame 1
        return bool(data) and data[0] >> 6 == 2 and not data[0] & 0x0C
    if codec == "libdav1d":
        return _AV1_SEQUENCE_HEADER in _obu_kinds(data)
    kinds = {(unit[0] & 31 if codec == "h264" else unit[0] >> 1 & 63) for unit in _nal_units(data)}
    return bool(kinds & (_KEY_H264 if codec == "h264" else _KEY_HEVC))


def _nal_units(data: bytes) -> Iterator[bytes]:
    """Beginnings of the NAL units of Annex B, their headers included."""
    place = data.find(b"\0\0\1")
    for _ in range(_MOST_UNITS):
        if not 0 <= place < len(data) - 3:
            return
        yield data[place + 3 : place + 3 + _LONGEST_HEADER]
        place = data.find(b"\0\0\1", place + 3)


def _obu_kinds(data: bytes) -> Iterator[int]:
    """Types of the open bitstream units of AV1 (5.3.1), as long as these tell their sizes."""
    place = 0
    for _ in range(_MOST_UNITS):
        if place >= len(data):
            return
        head = data[place]
        yield head >> 3 & 15
        if not head & 2:
            return
        place += 2 if head & 4 else 1
        size = shift = 0
        for byte in data[place : place + 8]:
            place += 1
            size |= (byte & 127) << shift
            shift += 7
            if byte < 128:
                break
        place += size


class PacketDecoder:
    """Decodes packets in their order, each to its own image; after one that is missing or damaged, from a key frame on.

    Parameters
    ----------
    codec : str
        As `video_codec` has it.
    most_pixels : int
        That an image may have.

    Raises
    ------
    BagError
        PyAV is not installed, or has no such decoder.
    """

    def __init__(self, codec: str, most_pixels: int = LARGEST_PIXELS) -> None:
        self._av, self.codec, self._most_pixels = library(), codec, min(most_pixels, LARGEST_PIXELS)
        self._gone = "no key frame has come yet"
        self._numbers, self._times = _SliceNumbers(), _Times()
        self._context: Any = None

    def decode(self, data: bytes, time_ns: int) -> RawImage:
        """The image of a packet.

        Returns
        -------
        (H, W) or (H, W, 3) uint8
            Mono, or RGB.

        Raises
        ------
        ImageError
            It has none: it, or one before it since the last key frame, is damaged or missing.
        """
        key = is_key(data, self.codec)
        if key and self._gone:
            self._begin()
        self._gone = self._gone or self._why_not(data, time_ns, key)
        if self._gone:
            text = f"video ({_shown(self.codec)}): no image until the next key frame: {self._gone}"
            raise ImageError(text, Code.VIDEO_AWAITS_KEY_FRAME)
        packet = self._av.Packet(data)
        packet.pts = time_ns
        try:
            frames = self._context.decode(packet)
        except (self._av.FFmpegError, EOFError, ValueError) as error:
            raise self._failed() from error
        own = next((frame for frame in frames if frame.pts == time_ns), None)
        if own is None or own.is_corrupt:
            raise self._failed()
        return image_of_frame(own)

    def _begin(self) -> None:
        self._gone = ""
        self._numbers.forget()
        self._times.forget()
        if self._context is not None:  # it keeps the parameters that came with an earlier key frame
            self._context.flush_buffers()
            return
        try:
            self._context = self._av.CodecContext.create(self.codec, "r")
        except ValueError as error:
            text = f"video: expected a PyAV that decodes {_shown(self.codec)}, this one does not"
            raise BagError(text, Code.RECORDING_EXTRA) from error
        self._context.thread_count = 1  # threads would hold frames back
        self._context.options = {"err_detect": "explode", "max_pixels": str(self._most_pixels)}

    def _why_not(self, data: bytes, time_ns: int, key: bool) -> str:
        """Why a packet cannot be the next one; empty where it can."""
        if self.codec in ("h264", "hevc") and b"\0\0\1" not in data[:4]:
            return "expected start codes (Annex B), got none"
        if self.codec == "h264" and not self._numbers.goes_on(data):
            return "a packet is missing"
        if self.codec in ("vp9", "libdav1d") and not self._times.goes_on(time_ns) and not key:
            return "a packet is missing, by the time since the last one"
        return ""

    def _failed(self) -> ImageError:
        width, height = self._context.width, self._context.height
        if width * height > self._most_pixels:
            self._gone = f"expected at most {self._most_pixels} px, got {width}x{height}"
        else:
            self._gone = "a packet is damaged or missing, or frames come out of order (encode without B-frames)"
        return ImageError(f"video ({_shown(self.codec)}): {self._gone}", Code.VIDEO_DECODE)


def image_of_frame(frame: Any) -> RawImage:
    """PyAV's frame as mono or RGB, (H, W) or (H, W, 3) uint8, unturned."""
    return np.asarray(frame.to_ndarray(format="gray" if frame.format.name.startswith("gray") else "rgb24"))


def _shown(codec: str) -> str:
    return {"libdav1d": "av1", "hevc": "h265"}.get(codec, codec)


# ---- what is missing -------------------------------------------------------------------------------------------------


class _Times:
    """Whether packets come as regularly as before."""

    def __init__(self) -> None:
        self._last: int | None = None
        self._usual = 0

    def forget(self) -> None:
        """Take whatever comes next; the usual interval stays."""
        self._last = None

    def goes_on(self, time_ns: int) -> bool:
        """Take the next packet's time; whether it is near enough to the last one's."""
        apart = 0 if self._last is None else time_ns - self._last
        self._last = time_ns
        if self._usual and not 0 < apart <= _GAP * self._usual:
            return False
        self._usual = apart if not self._usual else min(self._usual, apart)
        return True


class _SliceNumbers:
    """Whether the pictures of H.264 follow each other, by `frame_num` (ITU-T H.264, 7.4.3)."""

    def __init__(self) -> None:
        self._bits, self._planes, self._last = 0, False, -1

    def forget(self) -> None:
        """Take whatever comes next; the parameters stay."""
        self._last = -1

    def goes_on(self, data: bytes) -> bool:
        """Take the next packet; whether no reference picture is missing before it. True where it cannot be told."""
        for unit in _nal_units(data):
            kind = unit[0] & 31
            try:
                if kind == 7:
                    self._bits, self._planes = _sequence_parameters(_Bits(unit[1:]))
                elif kind in (1, 5) and self._bits:
                    return self._follows(_frame_number(_Bits(unit[1:]), self._bits, self._planes), kind, unit[0] & 0x60)
            except IndexError:
                return True  # a cut header: the decoder will tell
        return True

    def _follows(self, number: int, kind: int, reference: int) -> bool:
        before, most = self._last, 1 << self._bits
        if reference or kind == 5:
            self._last = number
        return kind == 5 or before < 0 or number in (before, (before + 1) % most)


def _sequence_parameters(bits: _Bits) -> tuple[int, bool]:
    """Bits of `frame_num`, and whether the colour planes are coded apart (7.3.2.1.1)."""
    profile = bits.take(8)
    bits.take(16)
    bits.golomb()
    planes = False
    if profile in _HIGH_PROFILES:
        chroma = bits.golomb()
        planes = bool(chroma == 3 and bits.take(1))
        bits.golomb()
        bits.golomb()
        bits.take(1)
        if bits.take(1):
            for number in range(12 if chroma == 3 else 8):
                if bits.take(1):
                    _skip_scaling_list(bits, 16 if number < 6 else 64)
    width = bits.golomb() + 4
    if width > 16:
        raise IndexError("no stream has so many")
    return width, planes


def _skip_scaling_list(bits: _Bits, size: int) -> None:
    last = following = 8
    for _ in range(size):
        if following:
            code = bits.golomb()
            following = (last + ((code + 1) // 2 if code % 2 else -code // 2)) % 256
        last = following or last


def _frame_number(bits: _Bits, width: int, planes: bool) -> int:
    """Of a slice's header (7.3.3)."""
    for _ in range(3):
        bits.golomb()
    bits.take(2 * planes)
    return bits.take(width)


class _Bits:
    """Reads a NAL unit bit by bit, emulation prevention taken out. Raises `IndexError` at the end."""

    def __init__(self, unit: bytes) -> None:
        clean = unit.replace(b"\0\0\3", b"\0\0")
        self._value, self._left = int.from_bytes(clean, "big"), 8 * len(clean)

    def take(self, count: int) -> int:
        if count > self._left:
            raise IndexError("the unit has ended")
        self._left -= count
        return self._value >> self._left & ((1 << count) - 1)

    def golomb(self) -> int:
        zeros = 0
        while not self.take(1):
            zeros += 1
        return (1 << zeros) - 1 + self.take(zeros)
