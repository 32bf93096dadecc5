"""Key points of a long dive in a file without a name: 90 kB a frame that memory need not hold."""

from __future__ import annotations

from pathlib import Path
from tempfile import TemporaryFile
from types import TracebackType

import numpy as np

from uw_recon_ros.track.keypoints import PackedKeypoints

_POINT = np.dtype([("measured", "<f4", (3,)), ("sigma", "<f4"), ("descriptor", "u1", (128,))])


class KeypointFile:
    """Key points of frames, written once and read by number; nothing of it is left, however the process ends.

    Parameters
    ----------
    folder : path
        On whose disk it lies.
    """

    def __init__(self, folder: str | Path) -> None:
        self._file = TemporaryFile(dir=folder)  # noqa: SIM115
        self._starts = [0]

    def __enter__(self) -> KeypointFile:
        """For ``with``."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close it, which removes it."""
        self._file.close()

    def append(self, keypoints: PackedKeypoints) -> None:
        """Keep those of the next frame."""
        points = np.empty(len(keypoints.sigma), _POINT)
        points["measured"], points["sigma"] = keypoints.measured, keypoints.sigma
        points["descriptor"] = keypoints.descriptors
        self._file.seek(self._starts[-1])
        self._file.write(points.tobytes())
        self._starts.append(self._starts[-1] + points.nbytes)

    def __getitem__(self, number: int) -> PackedKeypoints:
        """Those of a frame."""
        start, end = self._starts[number : number + 2]
        self._file.seek(start)
        points = np.frombuffer(self._file.read(end - start), _POINT)
        return PackedKeypoints(points["measured"], points["sigma"], points["descriptor"])
