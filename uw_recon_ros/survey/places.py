"""Where the pairs of a recording are."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Place:
    """Where one image is.

    Parameters
    ----------
    name : str
        Topic, or file of a still.
    log_ns : int
        When the message was recorded, ns.
    nth : int
        Which of the messages of that topic and time, from 0.
    """

    name: str
    log_ns: int = 0
    nth: int = 0


@dataclass(frozen=True)
class Frame:
    """One stereo pair, not read yet.

    Parameters
    ----------
    number : int
        Of the pair in the whole input, from 0; the files are named by it.
    source : int
        Index into the sources.
    stamp_ns : int
        Header stamp of the left image, ns.
    left, right : Place
    rig : int
        Index into the calibrations; -1: none.
    before : (Place, Place) or None
        Left and right of the pair before it in the same source.
    """

    number: int
    source: int
    stamp_ns: int
    left: Place
    right: Place
    rig: int = -1
    before: tuple[Place, Place] | None = None
