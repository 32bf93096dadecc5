"""The output directory: files that appear whole or not at all, and what is known of the work so far.

``state/`` holds ``settings.json`` (what the directory was made from), ``journal.jsonl`` (a row a finished frame,
appended when all its files stand in their places and are on the disk), ``staging/`` (files being written), and a lock.
A process killed at any moment leaves rows whose files are there, and leftovers in ``staging/`` for the next to remove.
"""

from __future__ import annotations

import fcntl
import json
import os
import shutil
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from uw_recon_ros.errors import ReconError
from uw_recon_ros.files.atomic import sync_folder, write_json


def compare(before: Any, now: Any, name: str = "") -> list[tuple[str, Any, Any]]:
    """Where two nested mappings differ: dotted name, value before, value now (None: not there)."""
    if isinstance(before, Mapping) and isinstance(now, Mapping):
        keys = dict.fromkeys([*before, *now])
        parts = [compare(before.get(key), now.get(key), f"{name}.{key}" if name else str(key)) for key in keys]
        return [difference for part in parts for difference in part]
    return [] if before == now else [(name, before, now)]


def describe(differences: Iterable[tuple[str, Any, Any]], most: int = 4) -> str:
    """The differences in words."""
    listed = list(differences)
    texts = [f"{name}: {_shorten(before)} then, {_shorten(now)} now" for name, before, now in listed[:most]]
    if len(listed) > most:
        texts.append(f"and {len(listed) - most} more")
    return "; ".join(texts)


def _shorten(value: Any) -> str:
    if value is None:
        return "absent"
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."


Row = dict[str, Any]

STATE = "state"
BAG_PARTS = f"{STATE}/bag"
PREVIEWS = "previews"
VIEWS = "views"
#: ``status`` in ``frames.csv``: reconstructed; reconstructed and not to be trusted (`reason` says why); not at all.
OK, UNRELIABLE, FAILED = "ok", "unreliable", "failed"


def succeeded(row: Row) -> bool:
    """Whether a frame was reconstructed, to be trusted or not."""
    status: str = row["status"]
    return status != FAILED


def frame_name(number: int) -> str:
    """What a frame's files are called."""
    return f"{number:06d}"


class SurveyError(ReconError):
    """The output directory does not allow what was asked."""


class Store:
    """One survey's output directory, locked while it is open. A context manager.

    Parameters
    ----------
    root : path

    Raises
    ------
    SurveyError
        Another survey is writing there, or it holds something else.
    """

    def __init__(self, root: str | Path) -> None:
        self.root = Path(root)
        self.state = self.root / STATE
        self._check()
        self._made = [path for path in (self.root, self.state) if not path.exists()]
        self.state.mkdir(parents=True, exist_ok=True)
        self._lock = (self.state / "lock").open("w")
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._lock.close()
            raise SurveyError(f"{self.root}: another survey is writing to it") from error
        self._journal = self.state / "journal.jsonl"

    def _check(self) -> None:
        if self.root.exists() and not self.root.is_dir():
            raise SurveyError(f"{self.root}: expected a folder to write to, got a file")
        if self.root.is_dir() and not self.state.is_dir() and any(self.root.iterdir()):
            raise SurveyError(f"{self.root}: expected an empty or new folder or a survey's, got one with other files")

    def __enter__(self) -> Store:
        return self

    def __exit__(self, kind: type[BaseException] | None, *error: object) -> None:
        if self.state in self._made and kind is not None and issubclass(kind, ReconError):
            self._leave_nothing()
        self._lock.close()

    def _leave_nothing(self) -> None:
        """Remove what was made for a survey that was refused before its first frame."""
        if self._journal.exists():
            return
        shutil.rmtree(self.state)
        if self.root in self._made and not any(self.root.iterdir()):
            self.root.rmdir()

    @property
    def staging(self) -> Path:
        """Where files are written before they are moved to their places."""
        return self.state / "staging"

    def claim(self, settings: Mapping[str, Any], *, overwrite: bool) -> None:
        """Begin, or go on with what was begun with the same settings.

        Parameters
        ----------
        settings : mapping
            Everything the output depends on.
        overwrite : bool
            Whether to clear what another survey left here.

        Raises
        ------
        SurveyError
            The settings are others; the text names the differences.
        """
        if overwrite:
            self._clear()
        path = self.state / "settings.json"
        if path.is_file():
            differences = compare(json.loads(path.read_text(encoding="utf-8")), json.loads(json.dumps(settings)))
            if differences:
                raise SurveyError(
                    f"{self.root}: begun with other settings ({describe(differences)}); take those again, "
                    "another folder, or --overwrite"
                )
        else:
            write_json(path, settings)
        self._tidy()

    def _clear(self) -> None:
        """Remove everything but the lock."""
        for path in [*self.root.iterdir(), *self.state.iterdir()]:
            if path in (self.state, self.state / "lock"):
                continue
            if path.is_dir() and not path.is_symlink():
                shutil.rmtree(path)
            else:
                path.unlink()

    def _tidy(self) -> None:
        """Remove what a killed run left half-written."""
        shutil.rmtree(self.staging, ignore_errors=True)
        self.staging.mkdir()
        for folder in (self.root, self.state):
            for leftover in folder.glob(".*"):
                shutil.rmtree(leftover) if leftover.is_dir() else leftover.unlink()

    def rows(self) -> dict[int, Row]:
        """Rows of finished frames by their number; a line cut short by a power cut is dropped."""
        rows: dict[int, Row] = {}
        whole = 0
        if not self._journal.is_file():
            return rows
        with self._journal.open("rb") as stream:
            for line in stream:
                row = _parse(line)
                if row is None:
                    break
                rows[row["frame"]] = row
                whole += len(line)
        if whole < self._journal.stat().st_size:
            os.truncate(self._journal, whole)
        return rows

    def append(self, row: Row) -> None:
        """Note a finished frame, durably."""
        line = json.dumps(row, allow_nan=False, separators=(",", ":")) + "\n"
        new = not self._journal.exists()
        with self._journal.open("ab") as stream:
            stream.write(line.encode())
            stream.flush()
            os.fsync(stream.fileno())
        if new:
            sync_folder(self.state)

    def has_files(self, files: Mapping[str, int]) -> bool:
        """Whether all files of a row stand there with their sizes."""
        return all(_size(self.root / name) == size for name, size in files.items())


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return -1


def _parse(line: bytes) -> Row | None:
    try:
        row = json.loads(line) if line.endswith(b"\n") else None
    except ValueError:
        return None
    return row if isinstance(row, dict) and "frame" in row else None
