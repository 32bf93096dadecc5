"""One pair of the listing, read when its turn comes: each process opens the recordings itself."""

from __future__ import annotations

import threading
from collections import OrderedDict
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

from uw_recon_ros.bags import BagReader, RawMessage, messages
from uw_recon_ros.bags.stereo import make_pair
from uw_recon_ros.bounds import LARGEST_IMAGE_FILE
from uw_recon_ros.errors import BagError, ImageError, ReconError
from uw_recon_ros.files.bounded import read_bounded
from uw_recon_ros.files.images import decode_compressed, read_image
from uw_recon_ros.files.video_packets import video_codec
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.images import as_gray
from uw_recon_ros.recordings.layout import cut, mpo_parts
from uw_recon_ros.recordings.pair_index import Frame, Place
from uw_recon_ros.recordings.sources import Source, open_source
from uw_recon_ros.recordings.video import Video
from uw_recon_ros.recordings.video_topic import TopicDecoder
from uw_recon_ros.system_errors import reason
from uw_recon_ros.types import ByteImage, RawImage, StereoCalibration, StereoPair

_TOGETHER_NS = 500_000_000  # images recorded further apart are looked up one by one
_OPEN_BAGS = 4
LEFT_FRAME = "stereo_left_optical_frame"
RIGHT_FRAME = "stereo_right_optical_frame"


class Reader:
    """Reads pairs by their places; keeps the bags used last open. Safe to use from several threads."""

    def __init__(self, sources: list[Source], calibrations: list[StereoCalibration]) -> None:
        self._sources, self._calibrations = sources, calibrations
        self._bags: OrderedDict[str, BagReader] = OrderedDict()
        self._decoders: dict[tuple[str, str], TopicDecoder] = {}
        self._videos: OrderedDict[str, Video] = OrderedDict()
        self._lock = threading.Lock()

    def read(self, frame: Frame) -> StereoPair:
        """Read and decode one pair.

        Raises
        ------
        BagError, ImageError
            Naming what is wrong with which image.
        """
        source = self._sources[frame.source]
        calibration = self._calibrations[frame.rig] if frame.rig >= 0 else None
        if source.kind != "bag":
            return _paired(frame, self.images(frame), calibration)
        with self._lock:
            left, right = (messages.decode(raw) for raw in self._messages(source, frame))
            if video_codec(left) is None and video_codec(right) is None:
                return replace(make_pair(left, right, calibration), stamp_ns=frame.stamp_ns)
            images = self._shown(source, frame.left, left, "left"), self._shown(source, frame.right, right, "right")
        return _paired(frame, images, calibration)

    def _shown(self, source: Source, place: Place, message: Any, side: str) -> RawImage:
        """The image of a message, or of a packet of video."""
        codec = video_codec(message)
        try:
            if codec is None:
                return messages.image_from_message(message)
            key = source.path, place.name
            if key not in self._decoders:
                self._decoders[key] = TopicDecoder(self._bag(source), place.name, codec)
            return self._decoders[key].image(place)
        except ReconError as error:
            raise ImageError(f"{side} image: {error}", error.code) from error

    def size(self, frame: Frame) -> tuple[int, int]:
        """Width and height, px, of a pair's left image."""
        height, width = self.read(replace(frame, rig=-1)).left.shape[:2]
        return width, height

    def view(self, source: Source, place: Place, side: str) -> RawImage:
        """One camera's image of a still or a frame; `side` is the word for errors."""
        try:
            layout, _, number = place.part.partition(":")
            if source.kind == "video":
                return cut(self._video(place.name).frame(place.nth), layout, int(number or 0))
            if layout == "mpo":
                return decode_compressed(
                    mpo_parts(read_bounded(place.name, LARGEST_IMAGE_FILE, ImageError))[int(number)]
                )
            return cut(read_image(place.name), layout, int(number or 0))
        except ReconError as error:
            raise ImageError(f"{side} image: {error}", error.code) from error

    def _video(self, path: str) -> Video:
        if path not in self._videos:
            self._videos[path] = Video(path)
            if len(self._videos) > _OPEN_BAGS:
                self._videos.popitem(last=False)[1].close()
        self._videos.move_to_end(path)
        return self._videos[path]

    def images(self, frame: Frame) -> tuple[RawImage, RawImage]:
        """Left and right image, as they are; of bags as `read` gives them."""
        source = self._sources[frame.source]
        if source.kind == "bag":
            pair = self.read(frame)
            return pair.left, pair.right
        with self._lock:
            return self.view(source, frame.left, "left"), self.view(source, frame.right, "right")

    def read_before(self, frame: Frame) -> StereoPair | None:
        """Read the pair before one; None where there is none, or none that can be read."""
        if frame.before is None:
            return None
        try:
            return self.read(replace(frame, left=frame.before[0], right=frame.before[1]))
        except (BagError, ImageError):
            return None

    def read_around(self, frame: Frame) -> list[tuple[float, ByteImage]]:
        """Left images before and after a pair whose right image came late: s from it, and (H, W) uint8."""
        found, source = [], self._sources[frame.source]
        for after_ns, place in sorted(frame.around, key=lambda item: item[0]):
            try:
                with self._lock:
                    found.append((after_ns / 1e9, as_gray(self.view(source, place, "left"))))
            except (BagError, ImageError):
                continue
        return found

    def _messages(self, source: Source, frame: Frame) -> tuple[RawMessage, RawMessage]:
        places = {(place.name, place.log_ns): place for place in (frame.left, frame.right)}
        times = sorted(place.log_ns for place in places.values())
        together = times[-1] - times[0] <= _TOGETHER_NS
        spans = [(times[0], times[-1])] if together else [(time, time) for time in times]
        try:
            bag = self._bag(source)
            found = [m for span in spans for m in bag.raw_messages([name for name, _ in places], span)]
        except OSError as error:
            raise BagError(f"{source.name}: cannot be read: {reason(error)}") from error
        return _pick(found, frame.left), _pick(found, frame.right)

    def _bag(self, source: Source) -> BagReader:
        if source.path in self._bags:
            self._bags.move_to_end(source.path)
        else:
            self._bags[source.path] = open_source(source)
            if len(self._bags) > _OPEN_BAGS:
                self._bags.popitem(last=False)[1].close()
                self._decoders.clear()
        return self._bags[source.path]

    def close(self) -> None:
        """Close bags and videos."""
        with self._lock, ExitStack() as stack:
            for bag in self._bags.values():
                stack.callback(bag.close)
            for video in self._videos.values():
                stack.callback(video.close)
            self._bags.clear()
            self._decoders.clear()
            self._videos.clear()


def _pick(found: list[RawMessage], place: Place) -> RawMessage:
    same = [m for m in found if m.topic == place.name and m.log_ns == place.log_ns]
    if len(same) <= place.nth:
        raise BagError(f"{place.name}: the message recorded at {place.log_ns} ns cannot be read any more")
    return same[place.nth]


def _paired(frame: Frame, images: tuple[RawImage, RawImage], calibration: StereoCalibration | None) -> StereoPair:
    left, right, findings = as_pair(*images)
    frame_id = (calibration.left.frame_id if calibration else "") or LEFT_FRAME
    return StereoPair(left, right, frame.stamp_ns, frame_id, calibration, findings)
