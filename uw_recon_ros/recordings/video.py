"""Videos: their frames listed without decoding, and decoded one by one; PyAV does it, an extra."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.video_packets import image_of_frame, library
from uw_recon_ros.types import RawImage

SUFFIXES = (".mp4", ".mov", ".mkv", ".avi", ".ts", ".m4v", ".mts", ".m2ts", ".mpg", ".webm", ".h264", ".h265", ".hevc",
            ".mjpeg", ".mjpg")  # fmt: skip
_WITHOUT_TIMES = ("h264", "hevc", "mjpeg", "mjpeg_2000", "jpeg_pipe")  # FFmpeg's names of bare streams
_KEPT = 4  # decoded frames that are kept: the one before is asked for after its follower
_AHEAD_S = 3.0  # frames so far ahead are reached by decoding on, later ones by the index
_LARGEST_PIXELS = 2**26


class Video:
    """A video file, opened.

    Parameters
    ----------
    path : path

    Attributes
    ----------
    size : (width, height)
        As shown, px: the rotation flag obeyed.
    codec : str
    streams : int
        Of pictures; the first is read.

    Raises
    ------
    BagError
        It is no video, has no picture, or its codec is not there.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._av = library()
        self._recent: deque[tuple[int, Any]] = deque(maxlen=_KEPT)
        self._frames: Iterator[Any] | None = None
        self._first_key: int | None = None
        self._open()
        pixels = self._stream.codec_context.width * self._stream.codec_context.height
        if not 0 < pixels <= _LARGEST_PIXELS:
            self.close()
            got = "a larger one" if pixels else "no size: was the video cut off before its first key frame?"
            raise BagError(f"{path}: expected pictures of up to {_LARGEST_PIXELS} px, got {got}")

    def _open(self) -> None:
        try:
            self._file = self._av.open(str(self.path))
            if self._file.format.name in _WITHOUT_TIMES:
                raise BagError(
                    f"{self.path}: expected a video with times, got a bare stream of {self._file.format.name}: put it "
                    "into a file that has them: "
                    f"ffmpeg -framerate RATE -i {self.path.name} -c copy {self.path.stem}.mp4"
                )
            self._stream = self._file.streams.video[0]
            self.streams = len(self._file.streams.video)
            self.codec = self._stream.codec_context.name
            self._unit = float(self._stream.time_base or 0) or 1 / 25
        except (self._av.FFmpegError, OSError) as error:
            told = "an empty file" if _is_empty(self.path) else f"one that cannot be opened: {_told(error)}"
            raise BagError(f"{self.path}: expected a video, got {told}") from error
        except (IndexError, AttributeError) as error:
            raise BagError(f"{self.path}: expected a video with pictures in a codec that is known, got none") from error

    def times(self) -> list[tuple[int, int]]:
        """Stamp (ns from the first) and presentation time (the file's unit) of every frame; nothing is decoded.

        Raises
        ------
        BagError
            There are none, or none that can be decoded.
        """
        marks = list[int]()
        with suppress(self._av.FFmpegError):  # cut short: what came before counts
            for number, packet in enumerate(packet for packet in self._packets() if packet.size):
                time = _time_of(packet)
                marks.append(number if time is None else time)
        self._rewind(0)
        if not marks:
            raise BagError(f"{self.path}: expected a video with frames, got none: empty or cut short")
        if self._first_key is None and self._shows_nothing():
            raise BagError(
                f"{self.path}: expected a key frame, from which pictures can be decoded, got none among {len(marks)} "
                "frames: cut a video at a key frame, or record with key frames"
            )
        marks = sorted(set(marks))
        return [(round((mark - marks[0]) * self._unit * 1e9), mark) for mark in marks]

    def _shows_nothing(self) -> bool:
        try:
            return next(self._frames or iter(()), None) is None
        except (self._av.FFmpegError, OSError):
            return True
        finally:
            self._rewind(0)

    def frame(self, mark: int) -> RawImage:
        """Decode the frame of a presentation time.

        Returns
        -------
        (H, W) or (H, W, 3) uint8
            Mono, or RGB, upright.

        Raises
        ------
        ImageError
            It cannot be decoded.
        """
        return self._upright(self._decoded(mark))

    def small(self, mark: int, width: int) -> RawImage:
        """The frame's luma, reduced to a width, (H, W) uint8."""
        found = self._decoded(mark)
        height = max(2, round(found.height * width / found.width))
        return np.asarray(found.reformat(width=width, height=height, format="gray").to_ndarray())

    def _decoded(self, mark: int) -> Any:
        """The frame of a moment: kept, reached by decoding on, or sought; from the beginning where seeking misses."""
        kept = next((frame for time, frame in self._recent if time == mark), None)
        if kept is not None:
            return kept
        last = self._recent[-1][0] if self._recent else None
        near = self._frames is not None and last is not None and 0 < (mark - last) * self._unit < _AHEAD_S
        for seek in (None, mark, 0) if near else (mark, 0):
            if seek is not None:
                self._rewind(seek)
            try:
                found = self._decode_on(mark)
            except (self._av.FFmpegError, OSError) as error:
                self._frames = None
                raise ImageError(
                    f"{self.path.name}: the frame at {mark * self._unit:.3f} s is damaged: {_told(error)}"
                ) from error
            if found is not None:
                return found
        self._frames = None
        early = self._first_key is None or mark < self._first_key
        because = ": it comes before the first key frame" if early else ""
        raise ImageError(f"{self.path.name}: the frame at {mark * self._unit:.3f} s cannot be decoded{because}")

    def _decode_on(self, mark: int) -> Any:
        """Decode up to a moment; None where there is no frame of it."""
        for frame in self._frames or ():
            time = frame.pts if frame.pts is not None else frame.dts
            self._recent.append((int(time or 0), frame))
            if time is not None and time >= mark:
                return frame if time == mark else None
        return None

    def _packets(self) -> Iterator[Any]:
        """From where the file stands."""
        for packet in self._file.demux(self._stream):
            time = _time_of(packet)
            if packet.size and packet.is_keyframe and time is not None:
                self._first_key = time if self._first_key is None else min(time, self._first_key)
            yield packet

    def _decoded_on(self) -> Iterator[Any]:
        for packet in self._packets():
            yield from packet.decode()

    def _rewind(self, mark: int) -> None:
        """To the key frame before a moment, or to the beginning."""
        try:
            if mark:
                self._file.seek(mark, stream=self._stream, backward=True, any_frame=False)
            else:
                self._file.seek(0)
        except (self._av.FFmpegError, OSError):  # without an index
            self._file.close()
            self._open()
        self._recent.clear()
        self._frames = self._decoded_on()

    def _upright(self, frame: Any) -> RawImage:
        image = image_of_frame(frame)
        turns = round(getattr(frame, "rotation", 0) / 90) % 4
        return np.ascontiguousarray(np.rot90(image, turns)) if turns else image

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Video:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _is_empty(path: Path) -> bool:
    return path.is_file() and not path.stat().st_size


def _time_of(packet: Any) -> int | None:
    time = packet.pts if packet.pts is not None else packet.dts
    return None if time is None else int(time)


def _told(error: Exception) -> str:
    return " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split()).lower()
