"""Tables of the documents come from the benchmarks' files."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
from write_benchmarks import MARKED, TABLES, filled  # noqa: E402

START = [{"what": "cold", "cpu_s": 20.0, "wall_s": 21.0, "misses": 67, "hits": 0}]
TEXT = "Before.\n<!-- bench: matching start-up -->\nold\n<!-- end -->\nAfter.\n"


def test_table_is_written_between_its_marks_and_nothing_else_changes(tmp_path: Path) -> None:
    (tmp_path / "match_startup.json").write_text(json.dumps(START))
    text = filled(TEXT, tmp_path)
    assert text.startswith("Before.\n<!-- bench: matching start-up -->\n| a fresh process |")
    assert text.endswith("| cold | 20 | 21 | 67 | 0 |\n<!-- end -->\nAfter.\n")
    assert filled(text, tmp_path) == text


def test_what_was_not_measured_is_left_and_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert filled(TEXT, tmp_path) == TEXT
    assert "matching start-up: left as it is" in capsys.readouterr().err


def test_unknown_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"<!-- bench: weather -->: expected one of matching in air"):
        filled(TEXT.replace("matching start-up", "weather"), tmp_path)


def test_documents_ask_for_known_tables_and_have_them() -> None:
    asked = 0
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        for mark in MARKED.finditer(path.read_text(encoding="utf-8")):
            asked += 1
            assert mark["name"] in TABLES, path
            assert "| --- |" in mark[0], f"{path}: {mark['name']} is empty"
    assert asked >= 5
