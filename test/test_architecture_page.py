"""ARCHITECTURE.md and CONTRIBUTING.md name what exists."""

from __future__ import annotations

import importlib
import importlib.util
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "uw_recon_ros"
ARCHITECTURE = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
CONTRIBUTING = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
DOTTED = re.compile(r"[a-z]\w*(\.\w+)+")
NAME = re.compile(r"[A-Za-z_]\w*")
FILE = re.compile(r"[\w./-]+(\.py|/)")
FILE_NAME = re.compile(r"\.(py|md|xml|yaml|json|rst|toml|mcap)$")
#: What the question's answer must hold, so that a file that stays while its content moves away is noticed.
HOLDS = {
    "left-right check": "def left_right_check(",
    "calibration is metric": "def judge_calibration(",
    "points2_filtered": '"points2_filtered"',
    "finding's code": "class Code(",
    "messages made": "def cloud_message(",
    "whole or not at all": ".replace(",
    "data cost": "cost",
    "subcommand": "def add_arguments(",
    "geometry locked": "class RigTracker",
    "bag read": "class BagReader",
}


def backticked(text: str) -> list[str]:
    """What stands in backticks, outside of blocks."""
    return re.findall(r"`([^`\n]+)`", re.sub(r"```.*?```", "", text, flags=re.DOTALL))


def find(name: str) -> object:
    """The object of a dotted name below the package: the longest module, then attributes."""
    parts = name.split(".")
    for length in range(len(parts), 0, -1):
        module = ".".join(["uw_recon_ros", *parts[:length]])
        try:
            if importlib.util.find_spec(module) is None:
                continue
        except ModuleNotFoundError:
            continue
        found: object = importlib.import_module(module)
        for part in parts[length:]:
            found = getattr(found, part)
        return found
    raise AttributeError(name)


def is_ours(name: str) -> bool:
    room = PACKAGE / name.split(".")[0]
    return room.is_dir() or room.with_suffix(".py").exists()


def dotted_names() -> list[str]:
    names = [name for name in backticked(ARCHITECTURE) if DOTTED.fullmatch(name) and not FILE_NAME.search(name)]
    return sorted({name.removeprefix("uw_recon_ros.") for name in names})


@pytest.mark.parametrize("name", dotted_names())
def test_a_dotted_name_exists(name: str) -> None:
    if name.split(".")[0] == "ros":
        pytest.importorskip("rclpy")
    assert find(name) is not None


def rows_of_equations() -> list[list[str]]:
    table = ARCHITECTURE.partition("## Where the paper's equations are")[2]
    return [backticked(line.split("|")[3]) for line in table.splitlines() if line.count("|") == 4 and "`" in line]


def test_every_function_of_the_table_of_equations_exists() -> None:
    """Bare names too: they are of the module that stands before them."""
    assert len(rows_of_equations()) >= 20
    for names in rows_of_equations():
        module = ""
        for name in names:
            if "." in name:
                module = name.rpartition(".")[0]
            if name.endswith("/"):
                assert (PACKAGE / name).is_dir(), name
            else:
                assert find(name if "." in name else f"{module}.{name}") is not None


def test_what_does_not_exist_is_noticed() -> None:
    with pytest.raises(AttributeError):
        find("preprocess.color.no_such_function")
    with pytest.raises(AttributeError):
        find("preprocess.no_such_module")


def test_files_and_rooms_exist() -> None:
    """Named from the root or from the package; a bare file name may stand for one in each room, such as `stage.py`."""
    for name in filter(FILE.fullmatch, backticked(ARCHITECTURE)):
        assert (ROOT / name).exists() or (PACKAGE / name).exists() or list(PACKAGE.rglob(name)), name


def drawn() -> set[str]:
    (block,) = re.findall(r"## Imports point down only\n+```\n(.*?)```", ARCHITECTURE, re.DOTALL)
    return set(re.findall(r"(?:(?<=\s)|^)(\w+)(?:\.py|/)(?=\s)", block)) | set(
        block.partition("stages: pure")[2].replace("the nouns", "").replace("/", "").replace("|", "").split()[5:]
    )


def test_the_drawing_has_every_room_and_noun() -> None:
    rooms = {path.stem for path in PACKAGE.iterdir() if path.is_dir() and (path / "__init__.py").exists()}
    assert {"nodes", "messages", "findings", "stopwatch"} <= drawn()
    assert {name for name in drawn() if not is_ours(name)} == set()
    assert rooms - drawn() <= {"track", "align", "locate", "doctor"}  # told of below the drawing


def questions() -> list[tuple[str, list[str]]]:
    table = CONTRIBUTING.partition("## Ten questions")[2].partition("\n## ")[0]
    rows = [line.split("|") for line in table.splitlines() if line.startswith("| ") and "?" in line]
    return [(row[1], backticked(row[2])) for row in rows]


def test_ten_questions_are_answered_by_what_exists() -> None:
    assert len(questions()) == len(HOLDS) == 10
    for question, answers in questions():
        (text,) = [text for key, text in HOLDS.items() if key in question]
        assert answers
        for answer in answers:
            place = ROOT / answer
            files = place.rglob("*.py") if place.is_dir() else [place]
            assert any(text in file.read_text(encoding="utf-8") for file in files), f"{question}: {answer}"
