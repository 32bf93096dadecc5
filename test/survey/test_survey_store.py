"""Rows and files survive, whatever moment a process is killed at; other settings are noticed and named."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.files.atomic import publish
from uw_recon_ros.survey.store import Store, SurveyError, compare, describe

ROWS = [{"frame": i, "status": "ok", "reason": "ü" * i, "density": i / 7, "files": {}} for i in range(4)]


def test_rows_come_back(tmp_path: Path) -> None:
    with Store(tmp_path / "out") as store:
        store.claim({"a": 1}, overwrite=False)
        for row in ROWS:
            store.append(row)
    with Store(tmp_path / "out") as store:
        assert store.rows() == {row["frame"]: row for row in ROWS}


@settings(max_examples=40)
@given(share=st.floats(0, 1), rubbish=st.binary(max_size=8))
def test_a_journal_cut_anywhere_keeps_its_whole_rows_and_goes_on(
    share: float, rubbish: bytes, tmp_path_factory: pytest.TempPathFactory
) -> None:
    root = tmp_path_factory.mktemp("cut") / "out"
    with Store(root) as store:
        for row in ROWS:
            store.append(row)
        journal = store.state / "journal.jsonl"
        data = journal.read_bytes()
        kept = data[: int(share * len(data))]
        journal.write_bytes(kept + rubbish.replace(b"\n", b""))
    whole = kept.count(b"\n")
    with Store(root) as store:
        assert list(store.rows()) == list(range(whole))
        store.append({"frame": 9, "files": {}})
        assert list(store.rows()) == [*range(whole), 9]


def test_a_later_row_replaces_an_earlier_one(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.append({"frame": 1, "density": 0.1})
        store.append({"frame": 1, "density": 0.2})
        assert store.rows() == {1: {"frame": 1, "density": 0.2}}


def test_two_surveys_do_not_share_a_directory(tmp_path: Path) -> None:
    with Store(tmp_path), pytest.raises(SurveyError, match="another survey is writing"):
        Store(tmp_path)
    with Store(tmp_path):
        pass


@pytest.mark.parametrize("overwrite", [False, True])
def test_a_strangers_folder_is_left_alone(overwrite: bool, tmp_path: Path) -> None:
    (tmp_path / "thesis.tex").write_text("years of work")
    with pytest.raises(SurveyError, match="got one with other files"):
        Store(tmp_path).claim({}, overwrite=overwrite)
    assert (tmp_path / "thesis.tex").is_file()


def test_a_file_is_no_directory(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("")
    with pytest.raises(SurveyError, match="got a file"):
        Store(tmp_path / "out")


def test_other_settings_are_refused_by_name(tmp_path: Path) -> None:
    before = {"input": {"dive": {"dive.mcap": "aa"}}, "parameters": {"kz2_sweeps": 2, "profile": "paper"}}
    now = {"input": {"dive": {"dive.mcap": "aa"}}, "parameters": {"kz2_sweeps": 3, "profile": "paper"}}
    with Store(tmp_path) as store:
        store.claim(before, overwrite=False)
        store.append(ROWS[0])
    with Store(tmp_path) as store, pytest.raises(SurveyError, match=r"\(parameters\.kz2_sweeps: 2 then, 3 now\)"):
        store.claim(now, overwrite=False)
    with Store(tmp_path) as store:
        assert list(store.rows()) == [0]
        store.claim(before, overwrite=False)
        assert list(store.rows()) == [0]


def test_overwrite_clears_everything(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.claim({"a": 1}, overwrite=False)
        store.append(ROWS[0])
        (tmp_path / "depth").mkdir()
        (tmp_path / "depth" / "000000.tiff").write_text("")
        store.claim({"a": 2}, overwrite=True)
        assert store.rows() == {}
        assert sorted(p.name for p in tmp_path.iterdir()) == ["state"]


def test_leftovers_of_a_killed_run_are_removed(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.claim({}, overwrite=False)
        (store.staging / "77-abc").mkdir()
        (store.staging / "77-abc" / "cloud.ply").write_text("half")
        (tmp_path / ".bag.x1").mkdir()
        (tmp_path / ".frames.csv.part").write_text("half")
        store.claim({}, overwrite=False)
        assert list(store.staging.iterdir()) == []
        assert sorted(p.name for p in tmp_path.iterdir()) == ["state"]


def test_files_are_missed_when_gone_or_short(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        (tmp_path / "a").write_text("1234")
        assert store.has_files({"a": 4})
        assert not store.has_files({"a": 5})
        assert not store.has_files({"a": 4, "b": 1})


def test_publish_replaces_and_makes_folders(tmp_path: Path) -> None:
    (tmp_path / "new").write_text("new")
    (tmp_path / "depth").mkdir()
    (tmp_path / "depth" / "0").write_text("old")
    publish({tmp_path / "new": tmp_path / "depth" / "0"})
    assert (tmp_path / "depth" / "0").read_text() == "new"
    assert not (tmp_path / "new").exists()


def test_differences_are_named_wherever_they_are() -> None:
    found = compare({"a": {"b": 1, "c": 2}, "d": None}, {"a": {"b": 1}, "d": "x", "e": {"f": True}})
    assert found == [("a.c", 2, None), ("d", None, "x"), ("e", None, {"f": True})]
    assert describe(found) == 'a.c: 2 then, absent now; d: absent then, "x" now; e: absent then, {"f": true} now'
    assert describe([(str(i), 0, 1) for i in range(9)]).endswith("and 5 more")


def test_a_refused_survey_leaves_no_empty_folder(tmp_path: Path) -> None:
    def refused(folder: Path) -> None:
        with Store(folder) as store:
            store.claim({}, overwrite=False)
            raise SurveyError("refused")

    (tmp_path / "made").mkdir()
    for folder in ("new", "made"):
        with pytest.raises(SurveyError, match="refused"):
            refused(tmp_path / folder)
    assert not (tmp_path / "new").exists()
    assert list((tmp_path / "made").iterdir()) == []


def test_a_refusal_takes_nothing_that_an_earlier_run_left(tmp_path: Path) -> None:
    with Store(tmp_path) as store:
        store.claim({"a": 1}, overwrite=False)
    with pytest.raises(SurveyError, match="other settings"), Store(tmp_path) as store:
        store.claim({"a": 2}, overwrite=False)
    assert (tmp_path / "state" / "settings.json").is_file()
