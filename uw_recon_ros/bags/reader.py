"""`open_bag`: a ROS 2 recording in whatever form and state, without ROS."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import zstandard

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.files import open_files
from uw_recon_ros.bags.mcap_chunk import LARGEST, reason_of
from uw_recon_ros.bags.merge import merge_by_time
from uw_recon_ros.bags.model import RawMessage, TopicInfo, add_note, merge_topics
from uw_recon_ros.bags.stereo import CameraInfoCache, StereoTopics, find_stereo_topics, make_pair, pair_messages
from uw_recon_ros.bounds import unpacked_limit
from uw_recon_ros.calibration.rectified import rig_as_imaged
from uw_recon_ros.errors import BagError, ReconError
from uw_recon_ros.system_errors import told_as
from uw_recon_ros.types import FloatImage, StereoCalibration, StereoPair


class BagReader:
    """An opened bag. Made by `open_bag`; a context manager.

    Attributes
    ----------
    path : Path
    topics : list of TopicInfo
        In ROS 2's serialisation; count is what the index says.
    start_ns, end_ns : int
        First and last log time; both 0 in an empty bag.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._files = open_files(path)
        storages = self._files.storages
        self.topics: list[TopicInfo] = merge_topics([storage.topics for storage in storages])
        spans = [storage.span for storage in storages if storage.span is not None]
        self.start_ns = min((start for start, _ in spans), default=0)
        self.end_ns = max((end for _, end in spans), default=0)
        self.notes: list[str] = []

    @property
    def damage(self) -> list[str]:
        """What could not be read, a sentence each; grows while messages are read."""
        of_files = [sentence for storage in self._files.storages for sentence in storage.damage]
        return [*self._files.damage, *of_files, *self.notes]

    def note(self, sentence: str) -> None:
        """Add a sentence to `damage`."""
        add_note(self.notes, sentence)

    def raw_messages(
        self, topics: Iterable[str] | None = None, between: tuple[int, int] | None = None
    ) -> Iterator[RawMessage]:
        """Messages as recorded, in log-time order over all files of the bag.

        Streams: memory holds the chunks that overlap in time, however long the bag.

        Parameters
        ----------
        topics : iterable of str or None
            Names to keep; None = all.
        between : (int, int) or None
            First and last log time to keep, ns; what lies outside is not even read where there is an index.
        """
        wanted = None if topics is None else frozenset(topics)
        sources = [
            (storage.span[0], partial(storage.messages, wanted, between))
            for storage in self._files.storages
            if storage.span
        ]
        merged = merge_by_time(sources)
        return self._inflated(merged) if self._files.compressed_messages else merged

    def _inflated(self, packed: Iterator[RawMessage]) -> Iterator[RawMessage]:
        decompressor = zstandard.ZstdDecompressor()
        for message in packed:
            most = min(LARGEST, unpacked_limit(len(message.data)))
            try:
                if zstandard.frame_content_size(message.data) > most:
                    raise ValueError(f"more than {most} bytes claimed")
                data = decompressor.decompress(message.data, max_output_size=most)
            except (zstandard.ZstdError, ValueError, MemoryError) as error:
                told = reason_of(error)
                self.note(f"{message.topic}: a compressed message at {message.log_ns} ns is damaged ({told})")
            else:
                yield RawMessage(message.topic, message.type, message.log_ns, data)

    def messages(self, topics: Iterable[str] | None = None) -> Iterator[tuple[RawMessage, Any]]:
        """As `raw_messages`, each with its decoded object; those that cannot be decoded go to `damage`."""
        for raw in self.raw_messages(topics):
            try:
                decoded = messages.decode(raw)
            except BagError as error:
                self.note(str(error))
            else:
                yield raw, decoded

    def stereo_topics(self, left: str | None = None, right: str | None = None) -> StereoTopics:
        """The cameras' topics, found by type and name unless given. Raises `BagError` when there is no pair."""
        return find_stereo_topics(self.topics, left, right)

    def stereo_pairs(
        self,
        left: str | None = None,
        right: str | None = None,
        *,
        tolerance_ns: int = 0,
        calibration: StereoCalibration | None = None,
        images_rectified: str = "auto",
    ) -> Iterator[StereoPair]:
        """Decoded pairs in the order of time, paired by header stamp as the nodes pair them.

        A pair that cannot be decoded is left out and named in `damage`.

        Parameters
        ----------
        left, right : str or None
            Image topics; None = found by type and name.
        tolerance_ns : int
            Largest difference of stamps within a pair, ns.
        calibration : StereoCalibration or None
            Instead of what the bag's CameraInfo says.
        images_rectified : {'auto', 'yes', 'no'}
            Whether the images come rectified; auto: by the names of their topics.

        Raises
        ------
        BagError
            The bag has no two image topics that fit.
        """
        topics = self.stereo_topics(left, right)
        rectified = topics.rectified(images_rectified)
        infos = self._first_infos(topics, rectified)
        wanted = [name for name in (topics.left, topics.right, topics.left_info, topics.right_info) if name]
        pairs = pair_messages(self.raw_messages(wanted), topics, tolerance_ns, self.note, infos)
        given = rig_as_imaged(calibration, rectified) if calibration else None
        return self._decoded_pairs(pairs, infos, given)

    def depth_images(self, topic: str = "/truth/depth") -> Iterator[tuple[int, FloatImage]]:
        """Stamp (ns) and depth (m, NaN = invalid) of each image of a depth topic; unreadable ones go to `damage`."""
        for _, decoded in self.messages([topic]):
            try:
                depth = messages.depth_from_message(decoded)
            except ReconError as error:
                self.note(f"{topic}: {error}")
            else:
                yield messages.stamp_ns(decoded), depth

    def _first_infos(
        self, topics: StereoTopics, rectified: tuple[bool, bool]
    ) -> tuple[CameraInfoCache, CameraInfoCache]:
        """What the first CameraInfo of either camera says: it is recorded after the image it belongs to, most often."""
        caches = CameraInfoCache(rectified[0]), CameraInfoCache(rectified[1])
        for name, cache in zip((topics.left_info, topics.right_info), caches, strict=True):
            first = next(self.raw_messages([name]), None) if name else None
            if first is not None:
                self._try(partial(cache.update, first))
        return caches

    def _try(self, action: Callable[[], None]) -> None:
        try:
            action()
        except BagError as error:
            self.note(str(error))

    def _decoded_pairs(
        self,
        pairs: Iterator[tuple[Any, Any]],
        infos: tuple[CameraInfoCache, CameraInfoCache],
        given: StereoCalibration | None,
    ) -> Iterator[StereoPair]:
        for left, right in pairs:
            cameras = infos[0].camera, infos[1].camera
            own = StereoCalibration(cameras[0], cameras[1]) if cameras[0] and cameras[1] else None
            try:
                pair = make_pair(left, right, given or own)
            except ReconError as error:
                self.note(f"pair at {messages.stamp_ns(left)} ns left out: {error}")
            else:
                yield pair

    def close(self) -> None:
        """Close the files."""
        self._files.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def open_bag(path: str | Path) -> BagReader:
    """Open a rosbag2 folder (MCAP or SQLite, split, compressed) or a bare ``.mcap`` or ``.db3`` file.

    Parameters
    ----------
    path : path

    Returns
    -------
    BagReader
        To be closed: use ``with``. What damage costs is in its `damage`.

    Raises
    ------
    BagError
        In one line, when nothing in it can be read.
    """
    path = Path(path)
    with told_as(BagError, path, "a bag"):
        path.stat()
    return BagReader(path)
