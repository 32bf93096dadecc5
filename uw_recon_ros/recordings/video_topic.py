"""Video in a bag's topics: packets of H.264 and its kin, decoded from the last key frame on."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

from uw_recon_ros.bags import BagReader, messages
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.video_packets import PacketDecoder, is_key
from uw_recon_ros.recordings.pair_index import Place
from uw_recon_ros.types import RawImage

_BACK_NS = 12_000_000_000  # how far back a key frame is looked for
_KEPT = 4

Moment = tuple[int, int]


class _Packet(NamedTuple):
    moment: Moment
    stamp_ns: int
    data: bytes


class TopicDecoder:
    """Decodes the packets of one topic, in any order of asking."""

    def __init__(self, bag: BagReader, topic: str, codec: str) -> None:
        self._bag, self._topic, self._codec = bag, topic, codec
        self._recent: deque[tuple[Moment, RawImage | ImageError]] = deque(maxlen=_KEPT)
        self._decoder = PacketDecoder(codec)
        self._last: Moment | None = None

    def image(self, place: Place) -> RawImage:
        """The frame of a message.

        Raises
        ------
        ImageError
            It cannot be decoded: damaged, or its key frame is not in the bag.
        """
        wanted = place.log_ns, place.nth
        found = self._kept(wanted)
        if found is None:
            self._decode_up_to(place, wanted)
            found = self._kept(wanted)
        if isinstance(found, ImageError):
            raise ImageError(f"{self._topic}: {found}", found.code) from found
        if found is None:
            raise ImageError(f"{self._topic}: the packet recorded at {place.log_ns} ns cannot be read any more")
        return found

    def _kept(self, wanted: Moment) -> RawImage | ImageError | None:
        return next((found for moment, found in self._recent if moment == wanted), None)

    def _decode_up_to(self, place: Place, wanted: Moment) -> None:
        goes_on = self._last is not None and self._last < wanted and wanted[0] - self._last[0] < _BACK_NS
        begin = self._last[0] if goes_on and self._last else place.log_ns - _BACK_NS
        packets = self._packets(begin, place.log_ns, wanted)
        if goes_on:
            packets = [packet for packet in packets if self._last is None or packet.moment > self._last]
        else:
            self._decoder = PacketDecoder(self._codec)
            keys = [n for n, packet in enumerate(packets) if is_key(packet.data, self._codec)]
            packets = packets[keys[-1] :] if keys else packets[-1:]
        for moment, stamp_ns, data in packets:
            self._last = moment
            try:
                self._recent.append((moment, self._decoder.decode(data, stamp_ns)))
            except ImageError as error:
                self._recent.append((moment, error))

    def _packets(self, begin_ns: int, end_ns: int, last: Moment) -> list[_Packet]:
        found: list[_Packet] = []
        for raw in self._bag.raw_messages([self._topic], (begin_ns, end_ns)):
            nth = found[-1].moment[1] + 1 if found and found[-1].moment[0] == raw.log_ns else 0
            if (raw.log_ns, nth) <= last:
                message = messages.decode(raw)
                found.append(_Packet((raw.log_ns, nth), messages.stamp_ns(message), bytes(message.data)))
        return found
