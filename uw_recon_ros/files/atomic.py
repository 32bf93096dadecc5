"""Files that appear whole or not at all and, where it is asked for, are on the disk when they do."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from uw_recon_ros.errors import ReconError


def sync_folder(folder: Path) -> None:
    """Make renames in a folder survive a power cut."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def sync_file(path: Path) -> None:
    """Make a file's content survive a power cut."""
    with path.open("rb") as stream:
        os.fsync(stream.fileno())


def write_bytes(path: str | Path, data: bytes, *, durable: bool = False) -> None:
    """Write a file whole or not at all: under a temporary name, then renamed.

    Parameters
    ----------
    path : path
    data : bytes
    durable : bool
        Whether it is on the disk when this returns.
    """
    path = Path(path)
    partial = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        partial.write_bytes(data)
        if durable:
            sync_file(partial)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    if durable:
        sync_folder(path.parent)


def finite(value: float | None) -> float | None:
    """A number as JSON holds it; None where it is none."""
    return float(value) if value is not None and math.isfinite(value) else None


def write_json(path: str | Path, content: Any, *, durable: bool = True) -> None:
    """Write JSON, keys in the order given; see `finite` for numbers that are none, which are refused here."""
    write_bytes(path, (json.dumps(content, indent=2, allow_nan=False) + "\n").encode(), durable=durable)


def publish(staged: Mapping[Path, Path]) -> None:
    """Move finished files from their staging names to their places, durably; an existing file is replaced."""
    for place in staged.values():
        place.parent.mkdir(parents=True, exist_ok=True)
    for temporary, place in staged.items():
        sync_file(temporary)
        temporary.replace(place)
    for folder in {place.parent for place in staged.values()}:
        sync_folder(folder)


def is_taken(place: Path) -> bool:
    """Whether a place for a folder holds something: it is a file, or a folder that is not empty."""
    return place.exists() and (not place.is_dir() or any(place.iterdir()))


def claim_folder(output: Path, overwrite: bool) -> None:
    """Make the folder that results go to.

    Raises
    ------
    ReconError
        It is a file, or has files in it that are not to be replaced.
    """
    if output.exists() and not output.is_dir():
        raise ReconError(f"{output}: expected a folder to write to, got a file")
    if is_taken(output) and not overwrite:
        raise ReconError(
            f"{output}: expected an empty or new folder, got one with files in it; --overwrite replaces them"
        )
    output.mkdir(parents=True, exist_ok=True)
