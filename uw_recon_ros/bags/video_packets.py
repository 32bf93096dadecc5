"""Packets of video in messages: which codec, and decoded by PyAV, an extra."""

from __future__ import annotations

from typing import Any

import numpy as np

from uw_recon_ros.bags import messages
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import RawImage

_CODECS = {"h264": "h264", "avc": "h264", "x264": "h264", "h265": "hevc", "hevc": "hevc", "x265": "hevc", "vp9": "vp9",
           "av1": "av1"}  # fmt: skip
_KEY_H264, _KEY_HEVC = {5}, set(range(16, 22))  # types of NAL units that begin anew


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
            "a video: expected the extra 'video' to be installed: pip install 'uw_recon_ros[video]'",
            Code.RECORDING_EXTRA,
        ) from error
    return av


def video_codec(message: Any) -> str | None:
    """FFmpeg's name of what a message's data are encoded with; None where it is no video."""
    told = str(message.encoding if hasattr(message, "pts") else getattr(message, "format", "")).lower()
    return next((codec for word, codec in _CODECS.items() if word in told), None)


def is_key(data: bytes, codec: str) -> bool:
    """Whether a packet can be decoded without those before it (Annex B; other codecs: as far as it is not known)."""
    if codec not in ("h264", "hevc"):
        return True
    kinds = set()
    place = data.find(b"\0\0\1")
    while 0 <= place < len(data) - 3:
        kinds.add(data[place + 3] & 31 if codec == "h264" else data[place + 3] >> 1 & 63)
        place = data.find(b"\0\0\1", place + 3)
    return bool(kinds & (_KEY_H264 if codec == "h264" else _KEY_HEVC))


def decode_packet(codec: Any, data: bytes) -> RawImage | None:
    """The image of one packet, RGB, without frames out of order; None where it gives none."""
    av = library()
    try:
        frames = codec.decode(av.Packet(data))
        if not frames:  # a decoder that waits for the next packet is told that this one is whole
            frames = codec.decode(None)
            codec.flush_buffers()
    except (av.FFmpegError, EOFError, ValueError):
        return None
    return np.asarray(frames[-1].to_ndarray(format="rgb24")) if frames else None


def image_of(message: Any) -> RawImage:
    """The image of a message of any type that holds images; of video, where it is a key frame.

    Raises
    ------
    ImageError, BagError
    """
    name = video_codec(message)
    if name is None:
        return messages.image_from_message(message)
    codec = library().CodecContext.create(name, "r")
    codec.thread_count = 1
    image = decode_packet(codec, bytes(message.data))
    if image is None:
        raise ImageError(f"video ({name}): the first packet cannot be decoded: damaged, or it is no key frame")
    return image
