"""One thing found, and its severity."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum


class Level(IntEnum):
    """How bad."""

    OK = 0
    WARN = 1
    FAIL = 2


@dataclass(frozen=True)
class Check:
    """One line of the doctor's table.

    Parameters
    ----------
    level : Level
    stage : str
        Where in the chain, e.g. ``cameras``.
    text : str
        What was seen, with the numbers.
    advice : str
        What to do; empty for what is well.
    symptom : bool
        Whether it only follows from something else that is wrong.
    code : str
        Of the finding of another room that it passes on; empty: none.
    """

    level: Level
    stage: str
    text: str
    advice: str = ""
    symptom: bool = False
    code: str = ""


def ok(stage: str, text: str) -> Check:
    """Make a finding of something that is well."""
    return Check(Level.OK, stage, text)


def warn(stage: str, text: str, advice: str = "", *, symptom: bool = False) -> Check:
    """Make a finding of something that may matter."""
    return Check(Level.WARN, stage, text, advice, symptom)


def fail(stage: str, text: str, advice: str = "", *, symptom: bool = False) -> Check:
    """Make a finding of something that keeps clouds from coming."""
    return Check(Level.FAIL, stage, text, advice, symptom)
