"""`Recording`: the pairs of whatever was recorded, listed at once and read one by one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.files.calibrations import Paths, read_calibration
from uw_recon_ros.recordings.listing import Listing, first_size, list_frames
from uw_recon_ros.recordings.options import Options
from uw_recon_ros.recordings.read import Reader
from uw_recon_ros.recordings.sources import Source, find_sources, fingerprint
from uw_recon_ros.types import StereoCalibration, StereoPair


class Recording(Sequence[StereoPair]):
    """The stereo pairs of bags, folders of stills and videos. A context manager.

    Nothing is decoded before it is asked for, and nothing is kept.

    Parameters
    ----------
    paths : path, or sequence of paths
        As ``uw_recon survey`` takes them.
    options : Options
    calibration : StereoCalibration, path, two paths or None
        Instead of what the recordings say.
    images_rectified : {'auto', 'yes', 'no'}

    Attributes
    ----------
    sources : list of Source
        What was found.
    listing : Listing
        The pairs, and in `notes` and `unreadable` what else there was.

    Raises
    ------
    BagError, CalibrationError
        There are no pairs; the text says why.
    """

    def __init__(
        self,
        paths: str | Path | Sequence[str | Path],
        options: Options = Options(),  # noqa: B008 (frozen)
        calibration: StereoCalibration | Paths | None = None,
        images_rectified: str = "auto",
    ) -> None:
        self.sources: list[Source] = find_sources([paths] if isinstance(paths, (str, Path)) else paths)
        size = partial(first_size, self.sources, options)
        known = calibration is None or isinstance(calibration, StereoCalibration)
        given = calibration if known else read_calibration(calibration, size)  # type: ignore[arg-type]
        self.listing: Listing = list_frames(self.sources, options, given, images_rectified)  # type: ignore[arg-type]
        self._reader = Reader(self.sources, self.listing.calibrations)

    def __len__(self) -> int:
        return len(self.listing.frames)

    def __getitem__(self, number):  # type: ignore[no-untyped-def]
        """Read one pair, or a slice of them."""
        if isinstance(number, slice):
            return [self._reader.read(frame) for frame in self.listing.frames[number]]
        return self._reader.read(self.listing.frames[number])

    def pairs(self) -> Iterator[StereoPair]:
        """Those that can be read, in order; what cannot is added to the notes."""
        for frame in self.listing.frames:
            try:
                yield self._reader.read(frame)
            except (BagError, ImageError) as error:
                self.listing.notes.append(f"pair {frame.number} left out: {error}")

    def fingerprint(self) -> dict[str, dict[str, str]]:
        """SHA-256 of every file, by source."""
        return {source.name: fingerprint(source) for source in self.sources}

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        frames = self.listing.frames
        return {
            "sources": [{"kind": source.kind, "name": source.name} for source in self.sources], "pairs": len(frames),
            "start_ns": frames[0].stamp_ns, "end_ns": frames[-1].stamp_ns, "notes": self.listing.notes,
            "unreadable": self.listing.unreadable, "calibrated": frames[0].rig >= 0,
        }  # fmt: skip

    def __str__(self) -> str:
        """What was found, as lines of text."""
        frames = self.listing.frames
        seconds = (frames[-1].stamp_ns - frames[0].stamp_ns) / 1e9
        lines = [f"{source.name}: {source.kind}" for source in self.sources]
        lines += [f"pairs: {len(frames)} in {seconds:.1f} s"]
        lines += [f"note: {sentence}" for sentence in (*self.listing.unreadable, *self.listing.notes)]
        return "\n".join(lines)

    def close(self) -> None:
        """Close the files."""
        self._reader.close()

    def __enter__(self) -> Recording:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
