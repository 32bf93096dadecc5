"""Writing rosbag2 MCAP bags that ``ros2 bag play`` (Humble and newer), Foxglove and `open_bag` read."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Final

import zstandard
from numpy.typing import NDArray
from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.rosbag2.storage_mcap import McapWriter

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.model import QosProfile, RawMessage
from uw_recon_ros.errors import BagError
from uw_recon_ros.system_errors import reason
from uw_recon_ros.types import CameraModel

_METADATA_VERSION: Final = 8  # the newest that Humble reads
_FOREVER = QosTime(9223372036, 854775807)


class BagWriter:
    """A bag being written: a context manager. It appears under its name only when it is complete.

    Parameters
    ----------
    path : path
        Folder to make; with the suffix ``.mcap`` a bare file.
    overwrite : bool
        Whether to replace a bag that stands there. Anything else that stands there is never replaced.
    level : int
        zstd's, 1 to 22: 3 is fast, 19 makes images a tenth smaller in ten times the time.

    Raises
    ------
    BagError
        Something stands there already, or it cannot be written.
    """

    def __init__(self, path: str | Path, *, overwrite: bool = False, level: int = 3) -> None:
        self.path = Path(path)
        self._bare = self.path.suffix == ".mcap"
        _refuse_occupied(self.path, overwrite)
        try:
            self.path.absolute().parent.mkdir(parents=True, exist_ok=True)
            self._partial = Path(tempfile.mkdtemp(prefix=f".{self.path.name}.", dir=self.path.absolute().parent))
        except OSError as error:
            raise BagError(f"{path}: cannot be written: {reason(error)}") from error
        inner = self._partial / self.path.name.removesuffix(".mcap")
        self._writer = Writer(inner, version=_METADATA_VERSION, storage_plugin=StoragePlugin.MCAP)
        self._writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
        self._connections: dict[tuple[str, str], Connection] = {}
        self._writer.open()
        if isinstance(self._writer.storage, McapWriter):
            self._writer.storage.compressor = zstandard.ZstdCompressor(level=level).compress

    def raw(self, message: RawMessage, qos: Iterable[QosProfile] = (QosProfile(),)) -> None:
        """Write CDR bytes as they are; `qos` is recorded with a topic's first message."""
        key = message.topic, message.type
        if message.type not in messages.typestore().fielddefs:
            raise BagError(f"{message.topic}: expected a standard message type to write, got {message.type}")
        if key not in self._connections:
            self._connections[key] = self._writer.add_connection(
                message.topic,
                message.type,
                typestore=messages.typestore(),
                offered_qos_profiles=[_to_rosbags(profile) for profile in qos],
            )
        self._writer.write(self._connections[key], message.log_ns, message.data)

    def message(self, topic: str, decoded: Any, *, log_time_ns: int | None = None) -> None:
        """Write a message object made by `uw_recon_ros.bags.messages`; log time defaults to its stamp."""
        kind, data = messages.encode(decoded)
        self.raw(RawMessage(topic, kind, messages.stamp_ns(decoded) if log_time_ns is None else log_time_ns, data))

    def image(self, topic: str, image: NDArray[Any], *, time_ns: int, frame_id: str) -> None:
        """Write an array as an Image; see `uw_recon_ros.bags.messages.image_message`."""
        self.message(topic, messages.image_message(image, time_ns=time_ns, frame_id=frame_id))

    def camera_info(self, topic: str, camera: CameraModel, *, time_ns: int, frame_id: str) -> None:
        """Write a CameraInfo."""
        self.message(topic, messages.camera_info_message(camera, time_ns=time_ns, frame_id=frame_id))

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                self._finish()
            else:
                self._writer.abort()
        except OSError as failure:
            raise BagError(f"{self.path}: cannot be written: {reason(failure)}") from failure
        finally:
            shutil.rmtree(self._partial, ignore_errors=True)

    def _finish(self) -> None:
        if not self._connections:
            self._writer.abort()
            raise BagError(f"{self.path}: expected messages to write, got none")
        self._writer.close()
        written = self._writer.path / f"{self._writer.path.name}.mcap" if self._bare else self._writer.path
        if self.path.is_dir():
            shutil.rmtree(self.path)
        written.replace(self.path)


def write_bag(path: str | Path, recorded: Iterable[RawMessage], *, overwrite: bool = False) -> int:
    """Write messages of standard types as they come; return how many.

    Parameters
    ----------
    path : path
        Folder to make; with the suffix ``.mcap`` a bare file.
    recorded : iterable of RawMessage
    overwrite : bool
        As in `BagWriter`.

    Raises
    ------
    BagError
    """
    count = 0
    with BagWriter(path, overwrite=overwrite) as writer:
        for message in recorded:
            writer.raw(message)
            count += 1
    return count


def _refuse_occupied(path: Path, overwrite: bool) -> None:
    if not path.exists():
        return
    if not overwrite:
        raise BagError(f"{path}: already exists: choose another name")
    is_bag = path.suffix == ".mcap" if path.is_file() else _holds_only_a_bag(path)
    if not is_bag:
        raise BagError(f"{path}: expected a bag to replace, got something else: left as it is")


def _holds_only_a_bag(folder: Path) -> bool:
    return all(f.name == "metadata.yaml" or ".mcap" in f.suffixes or ".db3" in f.suffixes for f in folder.iterdir())


def _to_rosbags(profile: QosProfile) -> Qos:
    return Qos(
        QosHistory[profile.history.upper()],
        profile.depth,
        QosReliability[profile.reliability.upper()],
        QosDurability[profile.durability.upper()],
        _FOREVER,
        _FOREVER,
        QosLiveliness.AUTOMATIC,
        _FOREVER,
        False,
    )
