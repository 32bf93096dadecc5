"""Folders of stills as a source of pairs."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from uw_recon_ros.bags.pack import find_images
from uw_recon_ros.calibration import read_calibration
from uw_recon_ros.errors import BagError
from uw_recon_ros.survey.params import SurveyParams
from uw_recon_ros.survey.rigs import Rigs
from uw_recon_ros.survey.sources import Source, calibration_file, eye_folders

_FIRST_NS = 1_000_000_000  # as `pack` counts


def list_stills(
    source: Source, params: SurveyParams, rigs: Rigs, notes: list[str]
) -> Iterator[tuple[int, str, str, int]]:
    """Yield stamp (ns), left file, right file and rig of every pair.

    Files are paired by the last number in their names where all have different ones, else by order.

    Raises
    ------
    BagError
        The two folders do not go together.
    """
    folders = eye_folders(Path(source.path))
    if folders is None:
        raise BagError(f"{source.name}: expected the stills of both eyes in left/ and right/")
    left, right = (find_images(str(folder)) for folder in folders)
    rig_file = calibration_file(source)
    rig = rigs.index(read_calibration(rig_file) if rig_file else None)
    for rank, (one, other) in enumerate(_paired(source, left, right, notes)):
        if one and other:
            yield _FIRST_NS + round(rank * 1e9 / params.stills_rate), str(one), str(other), rig


def _paired(
    source: Source, left: list[Path], right: list[Path], notes: list[str]
) -> list[tuple[Path | None, Path | None]]:
    """Partners side by side in order; None where there is no partner, so that time goes on."""
    numbered = [_by_number(left), _by_number(right)]
    common = numbered[0].keys() & numbered[1].keys()
    unique = len(numbered[0]) == len(left) and len(numbered[1]) == len(right)
    if unique and 2 * len(common) >= min(len(left), len(right)):
        for eye, mine in zip(("left", "right"), numbered, strict=True):
            alone = [path.name for number, path in mine.items() if number not in common]
            if alone:
                notes.append(f"{source.name}: {len(alone)} {eye} stills have no partner, first {alone[0]}")
        everything = sorted(numbered[0].keys() | numbered[1].keys())
        return [(numbered[0].get(number), numbered[1].get(number)) for number in everything]
    if len(left) != len(right):
        raise BagError(f"{source.name}: expected as many left as right stills, got {len(left)} and {len(right)}")
    return list(zip(left, right, strict=True))


def _by_number(paths: list[Path]) -> dict[int, Path]:
    found = ((re.findall(r"[0-9]+", path.stem), path) for path in paths)
    return {int(digits[-1]): path for digits, path in found if digits}
