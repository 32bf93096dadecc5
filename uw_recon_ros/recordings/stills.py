"""Stills of both cameras paired: by the times in their names or their EXIF, by number, by order last."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path

import numpy as np
from PIL import Image

from uw_recon_ros.errors import BagError
from uw_recon_ros.findings import Code

FIRST_NS = 1_000_000_000  # zero stamps would look like forgotten ones
_SECOND = 1_000_000_000
_EPOCH = re.compile(r"(?<!\d)(1[0-9]{9})(?:[._-]?(\d{3}|\d{6}|\d{9}))(?!\d)")  # s since 1970, with ms, us or ns
_DATE = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_]?([01]\d)[-_]?([0-3]\d)[-_T ]?([0-2]\d)[-_.:]?([0-5]\d)[-_.:]?([0-6]\d)"
    r"(?:[._-]?(\d{1,9}))?(?!\d)"
)
_FOLDER = 10**12  # more than any still's number
_NEAR = 0.4  # of the interval between stills: partners are nearer in time


@dataclass(frozen=True)
class StillPair:
    """Two files; None where one is missing, so that time goes on."""

    left: Path | None
    right: Path | None
    stamp_ns: int


def pair_stills(
    left: list[Path], right: list[Path], name: str, rate_hz: float, offset_ns: int, notes: list[str]
) -> Iterator[StillPair]:
    """Partners in order of time.

    Parameters
    ----------
    left, right : list of Path
        In natural order.
    name : str
        Of the recording, for sentences.
    rate_hz : float
        Of stills that carry no time.
    offset_ns : int
        What the right camera's clock is ahead of the left one's.
    notes : list of str
        Gets what is odd.

    Raises
    ------
    BagError
        They do not go together.
    """
    numbered = [_by_number(left), _by_number(right)]
    unique = len(numbered[0]) == len(left) and len(numbered[1]) == len(right)
    same_numbers = unique and numbered[0].keys() == numbered[1].keys()
    timed = _times_of(left), _times_of(right)
    if timed[0] and timed[1] and (not same_numbers or timed[0].how == "names"):
        found = _by_time(timed[0].ns, timed[1].ns, offset_ns)
        if 2 * len(found) >= min(len(left), len(right)):
            _note_alone(name, notes, found, (left, right), timed[0].how)
            yield from (StillPair(left[a], right[b], timed[0].ns[a]) for a, b in found)
            return
        if not same_numbers and 2 * len(numbered[0].keys() & numbered[1].keys()) < min(len(left), len(right)):
            raise _clocks_differ(name, timed[0], timed[1])
    if same_numbers and timed[0] and timed[1]:
        _note_clocks(name, notes, timed[0].ns, timed[1].ns)
    for rank, (one, other) in enumerate(_without_times(name, left, right, numbered, notes)):
        yield StillPair(one, other, FIRST_NS + round(rank * _SECOND / rate_hz))


@dataclass(frozen=True)
class _Times:
    """Times of some files, ns, and where they are from."""

    ns: list[int]
    how: str


def _times_of(paths: Sequence[Path]) -> _Times | None:
    """Times in the names of all files, else in the EXIF of all; None where neither tells them apart."""
    for how, reader in (("names", _name_ns), ("EXIF times", _exif_ns)):
        found: list[int] = []
        for path in paths:
            time = reader(path)
            if time is None:
                break
            found.append(time)
        if len(found) == len(paths) and len(set(found)) == len(found) and found == sorted(found):
            return _Times(found, how)
    return None


def _name_ns(path: Path) -> int | None:
    epoch = _EPOCH.search(path.stem)
    if epoch:
        return int(epoch[1]) * _SECOND + int(epoch[2].ljust(9, "0"))
    date = _DATE.search(path.stem)
    return _date_ns([*map(int, date.groups()[:6])], date[7] or "") if date else None


def _exif_ns(path: Path) -> int | None:
    """DateTimeOriginal and its fraction, else DateTime (EXIF 2.32); nothing is decoded."""
    try:
        with Image.open(path) as image:
            exif = image.getexif()
            told = {36867: exif.get(306), 37521: ""} | dict(exif.get_ifd(0x8769))
    except Exception:  # a file of strangers; what it is worth is seen when it is decoded
        return None
    date = re.fullmatch(r"(\d{4}):(\d\d):(\d\d) (\d\d):(\d\d):(\d\d)", str(told.get(36867, "")).strip())
    fraction = re.match(r"\d{1,9}", str(told.get(37521, "")).strip())
    return _date_ns([*map(int, date.groups())], fraction[0] if fraction else "") if date else None


def _date_ns(parts: list[int], fraction: str) -> int | None:
    try:
        seconds = datetime(parts[0], parts[1], parts[2], parts[3], parts[4], parts[5], tzinfo=timezone.utc).timestamp()
    except ValueError:
        return None
    return int(seconds) * _SECOND + int(fraction.ljust(9, "0") or 0)


def _by_time(ours: list[int], theirs: list[int], offset_ns: int) -> list[tuple[int, int]]:
    """Each left still with the right one nearest in time, where each is the other's nearest and near enough."""
    first, second = np.array(ours, np.int64), np.array(theirs, np.int64) - offset_ns
    intervals = [np.median(np.diff(t)) for t in (first, second) if len(t) > 1]
    near = _NEAR * min(intervals) if intervals else _SECOND
    distance = np.abs(first[:, None] - second[None]) if len(first) * len(second) < 10**7 else None
    if distance is None:
        after = np.searchsorted(second, first).clip(1, len(second) - 1)
        nearest = np.where(np.abs(second[after] - first) < np.abs(second[after - 1] - first), after, after - 1)
        return [(a, int(b)) for a, b in enumerate(nearest) if abs(second[b] - first[a]) <= near]
    best = distance.argmin(axis=1)
    return [(a, int(b)) for a, b in enumerate(best) if distance[a, b] <= near and distance[:, b].argmin() == a]


def _without_times(
    name: str, left: list[Path], right: list[Path], numbered: list[dict[int, Path]], notes: list[str]
) -> list[tuple[Path | None, Path | None]]:
    """By the last number in the names where all have different ones and they go together, else by order."""
    common = numbered[0].keys() & numbered[1].keys()
    unique = len(numbered[0]) == len(left) and len(numbered[1]) == len(right)
    if unique and 2 * len(common) >= min(len(left), len(right)):
        for side, mine in zip(("left", "right"), numbered, strict=True):
            alone = [path.name for number, path in mine.items() if number not in common]
            if alone:
                notes.append(f"{name}: {len(alone)} {side} stills have no partner, first {alone[0]}")
        everything = sorted(numbered[0].keys() | numbered[1].keys())
        return [(numbered[0].get(number), numbered[1].get(number)) for number in everything]
    if len(left) != len(right):
        raise BagError(
            f"{name}: expected as many left as right stills, got {len(left)} and {len(right)}, and neither numbers nor "
            "times in their names or EXIF tell which go together: name partners alike", Code.RECORDING_CLOCKS,
        )  # fmt: skip
    if len(left) > 1:
        notes.append(
            f"{name}: paired by order alone, neither numbers nor times tell: if one is missing on either side, all "
            "after it are wrong; name partners alike"
        )
    return list(zip(left, right, strict=True))


def _by_number(paths: list[Path]) -> dict[int, Path]:
    """By the last number of their names; where these come again, by the folder's too (cards), or by an earlier one."""
    found = [(re.findall(r"[0-9]+", path.stem), path) for path in paths]
    single = {int(digits[-1]): path for digits, path in found if digits}
    if len(single) == len(paths):
        return single
    folders = [re.findall(r"[0-9]+", path.parent.name) for path in paths]
    by_folder = {
        int(folder[-1]) * _FOLDER + int(digits[-1]): path
        for folder, (digits, path) in zip(folders, found, strict=True)
        if folder and digits
    }
    earlier = {int(digits[-2]): path for digits, path in found if len(digits) > 1}  # frame_000123_cam0
    return earlier if len(earlier) == len(paths) > len(by_folder) else by_folder


def _note_alone(
    name: str, notes: list[str], found: list[tuple[int, int]], files: tuple[list[Path], list[Path]], how: str
) -> None:
    notes.append(f"{name}: stills paired by their {how}")
    for side, paths in enumerate(files):
        paired = {pair[side] for pair in found}
        alone = [path.name for number, path in enumerate(paths) if number not in paired]
        if alone:
            notes.append(f"{name}: {len(alone)} {('left', 'right')[side]} stills have no partner, first {alone[0]}")


def _note_clocks(name: str, notes: list[str], ours: list[int], theirs: list[int]) -> None:
    apart = float(np.median(np.array(theirs) - np.array(ours))) / _SECOND
    if abs(apart) > 0.02:
        notes.append(
            f"{name}: stills paired by number, the right camera's clock is {apart:+.2f} s off (median): clocks that "
            "differ, or a still missing at the beginning"
        )


def _clocks_differ(name: str, ours: _Times, theirs: _Times) -> BagError:
    apart = (theirs.ns[0] - ours.ns[0]) / _SECOND
    return BagError(
        f"{name}: expected left and right stills of one time, got {ours.how} of which fewer than half have a partner ("
        f"the first two are {apart:+.2f} s apart): tell how far the right camera's clock is ahead, --clock-offset S",
        Code.RECORDING_CLOCKS,
    )
