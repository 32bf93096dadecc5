"""Videos: their frames listed without decoding, and decoded one by one; PyAV does it, an extra."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
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
        try:
            self._file = self._av.open(str(path))
            if self._file.format.name in _WITHOUT_TIMES:
                raise BagError(
                    f"{path}: expected a video with times, got a bare stream of {self._file.format.name}: put it into "
                    f"a file that has them: ffmpeg -framerate RATE -i {self.path.name} -c copy {self.path.stem}.mp4"
                )
            stream = self._file.streams.video[0]
            self.streams = len(self._file.streams.video)
            self.codec = stream.codec_context.name
            self._stream, self._unit = stream, stream.time_base
        except (self._av.FFmpegError, OSError) as error:
            told = "an empty file" if _is_empty(self.path) else f"one that cannot be opened: {_told(error)}"
            raise BagError(f"{path}: expected a video, got {told}") from error
        except (IndexError, AttributeError) as error:
            raise BagError(f"{path}: expected a video with pictures in a codec that is known, got none") from error
        if not 0 < stream.codec_context.width * stream.codec_context.height <= _LARGEST_PIXELS:
            self.close()
            raise BagError(f"{path}: expected pictures of up to {_LARGEST_PIXELS} px, got no size or a larger one")
        self._recent: deque[tuple[int, Any]] = deque(maxlen=_KEPT)
        self._frames: Iterator[Any] | None = None

    def times(self) -> list[tuple[int, int]]:
        """Stamp (ns from the first) and presentation time (the file's unit) of every frame; nothing is decoded.

        Raises
        ------
        BagError
            There are none.
        """
        marks, number = [], 0
        try:
            for packet in self._file.demux(self._stream):
                if packet.size:
                    mark = packet.pts if packet.pts is not None else packet.dts
                    marks.append(number if mark is None else int(mark))
                    number += 1
        except self._av.FFmpegError:
            pass  # cut short: what came before counts
        self._rewind(0)
        if not marks:
            raise BagError(f"{self.path}: expected a video with frames, got none: empty or cut short")
        marks = sorted(set(marks))
        unit = float(self._unit or 0) or 1 / 25
        return [(round((mark - marks[0]) * unit * 1e9), mark) for mark in marks]

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
        unit = float(self._unit or 1 / 25)
        last = self._recent[-1][0] if self._recent else None
        near = self._frames is not None and last is not None and 0 < (mark - last) * unit < _AHEAD_S
        for seek in (None, mark, 0) if near else (mark, 0):
            if seek is not None:
                self._rewind(seek)
            try:
                found = self._decode_on(mark)
            except (self._av.FFmpegError, OSError) as error:
                self._frames = None
                raise ImageError(
                    f"{self.path.name}: the frame at {mark * unit:.3f} s is damaged: {_told(error)}"
                ) from error
            if found is not None:
                return found
        self._frames = None
        raise ImageError(f"{self.path.name}: the frame at {mark * unit:.3f} s cannot be decoded")

    def _decode_on(self, mark: int) -> Any:
        """Decode up to a moment; None where there is no frame of it."""
        for frame in self._frames or ():
            time = frame.pts if frame.pts is not None else frame.dts
            self._recent.append((int(time or 0), frame))
            if time is not None and time >= mark:
                return frame if time == mark else None
        return None

    def _rewind(self, mark: int) -> None:
        try:
            self._file.seek(mark, stream=self._stream, backward=True, any_frame=False)
        except (self._av.FFmpegError, OSError):
            self._file.seek(0)
        if mark == 0:
            self._file.seek(0)
        self._recent.clear()
        self._frames = self._file.decode(self._stream)

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


def _told(error: Exception) -> str:
    return " ".join((getattr(error, "strerror", None) or str(error) or type(error).__name__).split()).lower()
