"""What is known of a model while it is made: results kept on the disk, so that a killed run goes on where it was."""

from __future__ import annotations

import io
import json
import shutil
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.georeference.crs import LOCAL, Crs
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.types import Matrix

T = TypeVar("T")
R = TypeVar("R")
Arrays = dict[str, NDArray[Any]]
#: Called with a step's name, how much of it is done, and how much there is.
Tell = Callable[[str, int, int], None]


def say_nothing(step: str, done: int, total: int) -> None:
    """Tell nobody."""


@dataclass(frozen=True, eq=False)
class World:
    """What a model's coordinates mean.

    Parameters
    ----------
    origin : (3,) float64
        Subtracted from the coordinates of `crs`, m.
    crs : Crs
    metric : bool
        Whether lengths are metres.
    """

    origin: Matrix = field(default_factory=lambda: np.zeros(3))
    crs: Crs = LOCAL
    metric: bool = True


@dataclass(frozen=True, eq=False)
class TileTask:
    """One model to make: the frames of one segment, and where it goes.

    Parameters
    ----------
    frames : sequence of PosedFrame
    folder : path
    params : DiveModelParams
    world : World
    tell : callable
    """

    frames: Sequence[PosedFrame]
    folder: Path
    params: DiveModelParams
    world: World
    tell: Tell = say_nothing

    @property
    def work(self) -> Path:
        """Folder of what is kept meanwhile."""
        return self.folder / ".work"

    def claim(self, digest: Mapping[str, Any]) -> None:
        """Begin, or go on with what was begun from the very same frames and parameters; anything else is removed."""
        note, text = self.work / "made_from.json", json.dumps(digest, indent=1)
        if not note.exists() or note.read_text(encoding="utf-8") != text:
            shutil.rmtree(self.work, ignore_errors=True)
            self.work.mkdir(parents=True)
            write_bytes(note, text.encode())

    def kept(self, name: str, make: Callable[[], Arrays]) -> Arrays:
        """What `make` gives, from the disk where it was made before."""
        path = self.work / f"{name}.npz"
        if not path.exists():
            stream = io.BytesIO()
            save: Any = np.savez  # whose stub takes no mapping
            save(stream, **make())
            write_bytes(path, stream.getvalue())
        with np.load(path) as found:
            return {key: found[key] for key in found.files}

    def each(self, step: str, function: Callable[[T], R], items: Iterable[T]) -> Iterator[R]:
        """`function` of every item, in order, some at the same time."""
        listed = list(items)
        with ThreadPoolExecutor(self.params.jobs) as pool:
            for done, result in enumerate(_few_ahead(pool, function, listed, self.params.jobs + 1), 1):
                self.tell(step, done, len(listed))
                yield result


def _few_ahead(pool: ThreadPoolExecutor, function: Callable[[T], R], items: list[T], ahead: int) -> Iterator[R]:
    """Results in order, never more than a few of them waiting."""
    waiting = [pool.submit(function, item) for item in items[:ahead]]
    for item in items[ahead:]:
        yield waiting.pop(0).result()
        waiting.append(pool.submit(function, item))
    for future in waiting:
        yield future.result()
