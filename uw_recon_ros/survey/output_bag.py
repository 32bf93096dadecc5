"""The output bag: every frame's share, put together in order once all are there."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

from uw_recon_ros.bags import BagWriter, open_bag
from uw_recon_ros.files.atomic import write_json
from uw_recon_ros.survey.frame_messages import LATCHED
from uw_recon_ros.survey.store import Store
from uw_recon_ros.survey.write import BAG_PARTS, frame_name

BAG = "bag"
_DONE = "bag.json"
_LATCHED_TOPICS = frozenset({"/surface"})
Watch = Callable[[Iterable[Path]], Iterable[Path]]


def is_assembled(store: Store) -> bool:
    """Whether the bag is complete, so that no frame's share is needed any more."""
    return (store.state / _DONE).is_file() and (store.root / BAG).is_dir()


def assemble(store: Store, numbers: list[int], watch: Watch = iter) -> None:
    """Write the bag from the shares of frames, then remove these.

    Parameters
    ----------
    store : Store
    numbers : list of int
        Of the frames, in order.
    watch : callable
        Given the shares, yields them while it shows how far it is.

    Raises
    ------
    BagError
        It cannot be written.
    """
    parts = store.root / BAG_PARTS
    if not is_assembled(store) and numbers:
        (store.state / _DONE).unlink(missing_ok=True)
        with BagWriter(store.root / BAG, overwrite=True) as writer:
            for part in watch([parts / f"{frame_name(number)}.mcap" for number in numbers]):
                _copy(part, writer)
        write_json(store.state / _DONE, {"frames": len(numbers)})
    shutil.rmtree(parts, ignore_errors=True)


def _copy(part: Path, writer: BagWriter) -> None:
    with open_bag(part) as share:
        for message in share.raw_messages():
            if message.topic in _LATCHED_TOPICS:
                writer.raw(message, [LATCHED])
            else:
                writer.raw(message)
