"""Pairs of stills whose files are the same: a camera that hung, or copies of one pair."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from uw_recon_ros.recordings.pair_index import Frame

_PROBES = (0.2, 0.5, 0.8)  # of the way through a file
_PROBED = 4096  # bytes at each: files of one size that agree there are the same picture


def note_copies(name: str, frames: Sequence[Frame], notes: list[str]) -> None:
    """Note pairs whose files are those of an earlier pair: each is reconstructed, as often as it is there.

    Parameters
    ----------
    name : str
        Of the recording.
    frames : sequence of Frame
        Of stills.
    notes : list of str
        Gets a sentence.
    """
    first = dict[tuple[object, ...], str]()
    copies = list[tuple[str, str]]()
    for frame in frames:
        with suppress(OSError):  # what cannot be read is told where it is read
            content = tuple(_probed(Path(file)) for file in dict.fromkeys((frame.left.name, frame.right.name)))
            own = Path(frame.left.name).name
            earlier = first.setdefault(content, own)
            if earlier != own:
                copies.append((own, earlier))
    if copies:
        own, earlier = copies[0]
        notes.append(
            f"{name}: {len(copies)} of {len(frames)} pairs are copies of earlier ones, the first, {own}, of {earlier}: "
            "did the cameras hang, or was one pair copied?"
        )


def _probed(path: Path) -> tuple[int, bytes]:
    size = path.stat().st_size
    with path.open("rb") as stream:
        parts = []
        for share in _PROBES:
            stream.seek(int(share * size))
            parts.append(stream.read(_PROBED))
    return size, b"".join(parts)
