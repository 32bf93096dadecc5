"""Cameras that send video: packets kept as they come, decoded in the worker's thread as far as a pair needs."""

from __future__ import annotations

import threading
from collections import deque
from dataclasses import dataclass
from typing import Any, NamedTuple

from uw_recon_ros.errors import ImageError, ReconError
from uw_recon_ros.files.video_packets import PacketDecoder, is_key, video_codec
from uw_recon_ros.types import RawImage

_RECENT = 4  # images kept: a pair may be looked at again
_MOST_PACKETS, _MOST_BYTES = 3000, 1 << 27  # between two key frames


class _Head(NamedTuple):
    stamp: Any
    frame_id: str


class _Packet(NamedTuple):
    number: int
    codec: str
    key: bool
    stamp_ns: int
    data: bytes


@dataclass(frozen=True, eq=False)
class VideoImage:
    """One image of a stream, not yet decoded; in a group it stands for a message.

    Parameters
    ----------
    header : Header
        Or what has its fields.
    stream : VideoStream
    number : int
        Of its packet.
    data : bytes
        The packet.
    """

    header: Any
    stream: VideoStream
    number: int
    data: bytes

    def decode(self, most_pixels: int) -> RawImage:
        """The image, as `VideoStream.image` has it."""
        return self.stream.image(self.number, most_pixels)


class VideoStream:
    """The packets of one camera. They are taken by the executor's thread, and decoded by the worker's.

    Only what a wanted image needs is decoded: from the last key frame before it on, or from where the last one ended.
    What stands before the last two key frames is forgotten, and what has been decoded.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._packets: deque[_Packet] = deque()
        self._bytes = self._taken = self._decoded = self._most_pixels = 0
        self._recent: deque[tuple[int, RawImage | ImageError]] = deque(maxlen=_RECENT)
        self._decoder: PacketDecoder | None = None

    def take(self, message: Any, stamp_ns: int) -> VideoImage:
        """Keep a message's packet.

        Raises
        ------
        ImageError
            Its codec is not known.
        """
        codec, data = str(video_codec(message)), bytes(message.data)
        head = message.header if hasattr(message, "header") else _Head(message.timestamp, message.frame_id)
        with self._lock:
            self._taken += 1
            packet = _Packet(self._taken, codec, is_key(data, codec), stamp_ns, data)
            self._forget(packet)
            self._packets.append(packet)
            self._bytes += len(data)
            return VideoImage(head, self, self._taken, data)

    def _forget(self, coming: _Packet) -> None:
        """Make room: what stands before the last key frame goes when the next one comes, or when it is too much."""
        keys = [place for place, packet in enumerate(self._packets) if packet.key]
        if self._bytes > _MOST_BYTES or len(self._packets) >= _MOST_PACKETS:
            gone = len(self._packets)
        else:
            gone = keys[-1] if coming.key and keys else 0
        for _ in range(gone):
            self._bytes -= len(self._packets.popleft().data)

    def image(self, number: int, most_pixels: int) -> RawImage:
        """Decode the image of a packet.

        Raises
        ------
        ImageError
            It has none, see `PacketDecoder.decode`.
        BagError
            PyAV is not installed.
        """
        with self._lock:
            due = [packet for packet in self._packets if self._decoded < packet.number <= number]
        keys = [place for place, packet in enumerate(due) if packet.key]
        for packet in due[keys[-1] if keys else 0 :]:
            self._recent.append((packet.number, self._decode(packet, most_pixels)))
        with self._lock:
            self._decoded = max(self._decoded, number)
            while self._packets and self._packets[0].number <= self._decoded:
                self._bytes -= len(self._packets.popleft().data)
        found = next((image for known, image in self._recent if known == number), None)
        if isinstance(found, ReconError):
            raise found
        if found is None:
            raise ImageError("video: its packets were given up, too many came since the last key frame")
        return found

    def _decode(self, packet: _Packet, most_pixels: int) -> RawImage | ImageError:
        """In the worker's thread, which alone has the decoder; one packet left out is found out by it."""
        if self._decoder is None or (self._decoder.codec, self._most_pixels) != (packet.codec, most_pixels):
            self._decoder, self._most_pixels = PacketDecoder(packet.codec, most_pixels), most_pixels
        try:
            return self._decoder.decode(packet.data, packet.stamp_ns)
        except ImageError as error:
            return error
