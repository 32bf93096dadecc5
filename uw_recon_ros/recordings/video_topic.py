"""Video in a bag's topics: packets of H.264 and its kin, decoded from the last key frame on."""

from __future__ import annotations

from collections import deque
from typing import Any

from uw_recon_ros.bags import BagReader, RawMessage, messages
from uw_recon_ros.bags.video_packets import decode_packet, is_key, library
from uw_recon_ros.errors import ImageError
from uw_recon_ros.recordings.pair_index import Place
from uw_recon_ros.types import RawImage

_BACK_NS = 12_000_000_000  # how far back a key frame is looked for
_KEPT = 4

Moment = tuple[int, int]


class TopicDecoder:
    """Decodes the packets of one topic, in any order of asking."""

    def __init__(self, bag: BagReader, topic: str, codec: str) -> None:
        self._av, self._bag, self._topic, self._codec_name = library(), bag, topic, codec
        self._recent: deque[tuple[Moment, RawImage]] = deque(maxlen=_KEPT)
        self._codec: Any = None
        self._last: Moment | None = None

    def image(self, place: Place) -> RawImage:
        """The frame of a message.

        Raises
        ------
        ImageError
            It cannot be decoded: damaged, or its key frame is not in the bag.
        """
        wanted = place.log_ns, place.nth
        for moment, image in self._recent:
            if moment == wanted:
                return image
        goes_on = self._last is not None and self._last < wanted and wanted[0] - self._last[0] < _BACK_NS
        begin = self._last[0] if goes_on and self._last else place.log_ns - _BACK_NS
        packets = self._packets(begin, place.log_ns, wanted)
        if goes_on:
            packets = [packet for packet in packets if self._last is None or packet[0] > self._last]
        else:
            self._codec = self._av.CodecContext.create(self._codec_name, "r")
            self._codec.thread_count = 1  # threads would hold frames back
            keys = [n for n, (_, data) in enumerate(packets) if is_key(data, self._codec_name)]
            packets = packets[keys[-1] :] if keys else packets
        for moment, data in packets:
            self._feed(moment, data)
        found = next((image for moment, image in self._recent if moment == wanted), None)
        if found is None:
            self._last = None
            told = f"a packet of {self._codec_name} cannot be decoded: damaged, or its key frame is not in the bag"
            raise ImageError(f"{self._topic}: {told}")
        return found

    def _packets(self, begin_ns: int, end_ns: int, last: Moment) -> list[tuple[Moment, bytes]]:
        found: list[tuple[Moment, bytes]] = []
        for raw in self._bag.raw_messages([self._topic], (begin_ns, end_ns)):
            nth = found[-1][0][1] + 1 if found and found[-1][0][0] == raw.log_ns else 0
            if (raw.log_ns, nth) <= last:
                found.append(((raw.log_ns, nth), _data(raw)))
        return found

    def _feed(self, moment: Moment, data: bytes) -> None:
        """Decode a packet; without frames out of order each gives its own."""
        self._last = moment
        image = decode_packet(self._codec, data)
        if image is not None:
            self._recent.append((moment, image))


def _data(raw: RawMessage) -> bytes:
    return bytes(messages.decode(raw).data)
