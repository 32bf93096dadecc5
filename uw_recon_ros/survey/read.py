"""One pair of the listing, read when its turn comes: each process opens the recordings itself."""

from __future__ import annotations

import threading
from collections import OrderedDict
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from uw_recon_ros.bags import BagReader, RawMessage, messages, open_bag
from uw_recon_ros.bags.pack import LEFT_FRAME
from uw_recon_ros.bags.stereo import make_pair
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.images import read_image
from uw_recon_ros.image_pair import as_pair
from uw_recon_ros.survey.pair_index import Frame, Place
from uw_recon_ros.survey.sources import Source
from uw_recon_ros.system_errors import reason
from uw_recon_ros.types import StereoCalibration, StereoPair

_TOGETHER_NS = 500_000_000  # images recorded further apart are looked up one by one
_OPEN_BAGS = 4


class Reader:
    """Reads pairs by their places; keeps the bags used last open. Safe to use from several threads."""

    def __init__(self, sources: list[Source], calibrations: list[StereoCalibration]) -> None:
        self._sources, self._calibrations = sources, calibrations
        self._bags: OrderedDict[str, BagReader] = OrderedDict()
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
        if source.kind == "stills":
            return _read_stills(frame, calibration)
        with self._lock:
            left, right = self._messages(source, frame)
        return make_pair(messages.decode(left), messages.decode(right), calibration)

    def read_before(self, frame: Frame) -> StereoPair | None:
        """Read the pair before one; None where there is none, or none that can be read."""
        if frame.before is None:
            return None
        try:
            return self.read(replace(frame, left=frame.before[0], right=frame.before[1]))
        except (BagError, ImageError):
            return None

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
            self._bags[source.path] = open_bag(Path(source.path))
            if len(self._bags) > _OPEN_BAGS:
                self._bags.popitem(last=False)[1].close()
        return self._bags[source.path]

    def close(self) -> None:
        """Close the bags."""
        with self._lock, ExitStack() as stack:
            for bag in self._bags.values():
                stack.callback(bag.close)
            self._bags.clear()


def _pick(found: list[RawMessage], place: Place) -> RawMessage:
    same = [m for m in found if m.topic == place.name and m.log_ns == place.log_ns]
    if len(same) <= place.nth:
        raise BagError(f"{place.name}: the message recorded at {place.log_ns} ns cannot be read any more")
    return same[place.nth]


def _read_stills(frame: Frame, calibration: StereoCalibration | None) -> StereoPair:
    left, right, findings = as_pair(read_image(frame.left.name), read_image(frame.right.name))
    frame_id = (calibration.left.frame_id if calibration else "") or LEFT_FRAME
    return StereoPair(left, right, frame.stamp_ns, frame_id, calibration, findings)
