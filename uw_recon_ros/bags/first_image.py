"""The first image of a topic, of whatever type it is."""

from __future__ import annotations

from typing import Any

from uw_recon_ros.bags import messages
from uw_recon_ros.files.video_packets import PacketDecoder, video_codec
from uw_recon_ros.types import RawImage


def image_of(message: Any) -> RawImage:
    """The image of a message of any type that holds images; of video, where it is a key frame.

    Raises
    ------
    ImageError, BagError
    """
    codec = video_codec(message)
    if codec is None:
        return messages.image_from_message(message)
    return PacketDecoder(codec).decode(bytes(message.data), messages.stamp_ns(message))
