"""tools/run_cases.py on case folders made here: every judgement is reached, cases are only read, bounds hold."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil
import pytest

_TOOL = Path(__file__).resolve().parent.parent / "tools" / "run_cases.py"


@pytest.fixture(scope="module")
def tool() -> Any:
    spec = importlib.util.spec_from_file_location("run_cases", _TOOL)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["run_cases"] = module
    spec.loader.exec_module(module)
    return module


def _run(tool: Any, folder: Path, script: str, *, seconds: float = 60.0, memory_mb: int = 2048) -> Any:
    case = folder / "01-case"
    case.mkdir()
    (case / "README").write_text("what: a fake\ncommand: uw_recon pair left.png right.png -o out\n")
    program = folder / "program.py"
    program.write_text(f"import sys, pathlib\nout = pathlib.Path(sys.argv[-1])\n{script}\n")
    (outcome,) = tool.run_case(case, [sys.executable, str(program)], seconds, memory_mb)
    assert [p.name for p in case.iterdir()] == ["README"]  # only read
    return outcome


@pytest.mark.parametrize(
    ("script", "judgement"),
    [
        ("", "readable"),
        ("sys.exit('uw_recon: rig.yaml: expected two cameras, got one')", "refused clearly"),
        ("sys.exit('uw_recon: expected\\n  in line 3')", "confusing"),
        ("sys.exit('uw_recon: [Errno 20] Not a directory')", "confusing"),
        ("raise ValueError('no')", "crash"),
        ("sys.exit(70)", "crash"),
        ("import os; os.abort()", "crash"),
        ("import time; kept = b'1' * (600 << 20); time.sleep(60)", "crash"),
    ],
)
def test_judges_how_a_command_ends(tool: Any, tmp_path: Path, script: str, judgement: str) -> None:
    assert _run(tool, tmp_path, script, memory_mb=400).judgement == judgement


def test_address_space_that_is_not_used_is_no_memory(tool: Any, tmp_path: Path) -> None:
    script = "import mmap, time; kept = mmap.mmap(-1, 4 << 30); time.sleep(0.5)"
    outcome = _run(tool, tmp_path, script, memory_mb=400)
    assert outcome.judgement == "readable"
    assert 0 < outcome.peak_mb < 400


_OK = {"warnings": [], "reliable": True, "failed": None}
_WARNED = {**_OK, "warnings": [{"code": "rectify.not_checked", "severity": "warn", "text": "-"}]}
_REFUSED = {**_OK, "failed": {"stage": "match", "code": "match.nothing", "text": "nothing seen"}, "reliable": False}


@pytest.mark.parametrize(
    ("factor", "report", "judgement"),
    [
        (1.0, _OK, "works"),
        (1.02, _OK, "works"),
        (1.0, _WARNED, "works"),
        (None, _OK, "works, no metres"),
        (1000.0, _OK, "silently wrong"),
        (0.96, _OK, "silently wrong"),
        (0.96, _WARNED, "doubted"),
        (1000.0, {**_OK, "reliable": False}, "doubted"),
        (None, _REFUSED, "refused clearly"),
        (None, {**_REFUSED, "failed": {"stage": "match", "code": "internal", "text": "-"}}, "crash"),
    ],
)
def test_holds_depth_against_the_truth(
    tool: Any, tmp_path: Path, factor: float | None, report: dict[str, Any], judgement: str
) -> None:
    script = f"import json, shutil\nout.mkdir()\n(out / 'report.json').write_text(json.dumps({report!r}))\n"
    if factor is not None:
        depth = np.full((4, 4), tool.TRUE_DEPTH_M * factor, np.float32)
        depth[0] = np.nan
        assert cv2.imwrite(str(tmp_path / "made.tiff"), depth)
        script += f"shutil.copy({str(tmp_path / 'made.tiff')!r}, out / 'depth.tiff')\n"
    outcome = _run(tool, tmp_path, script + f"sys.exit({int(bool(report['failed']))})")
    assert outcome.judgement == judgement
    assert (outcome.depth_m or 0) == pytest.approx(tool.TRUE_DEPTH_M * (factor or 0), rel=1e-5)


@pytest.mark.parametrize(
    ("code", "reason", "judgement"),
    [
        ("image", "left: expected JPEG: got a video", "refused clearly"),
        ("image", "cv2.error: -215 assertion failed", "confusing"),
        ("internal", "internal error", "crash"),
    ],
)
def test_a_survey_is_judged_by_its_frames(tool: Any, tmp_path: Path, code: str, reason: str, judgement: str) -> None:
    table = f"frame,status,reason,warnings\n0,failed,{reason},{code}\n"
    report = {"frames": {}, "warnings": [], "reliable": True}
    script = (
        f"import json\nout.mkdir()\n(out / 'report.json').write_text(json.dumps({report!r}))\n"
        f"(out / 'frames.csv').write_text({table!r})\nsys.exit(1)"
    )
    outcome = _run(tool, tmp_path, script)
    assert (outcome.judgement, outcome.last_line, outcome.codes) == (judgement, reason, (code,))


_PARENT = "import subprocess, time\nchild = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(600)'])\n"
_TOLD = "pathlib.Path({file!r}).write_text(str(child.pid)); time.sleep(600)"


def test_ends_what_does_not_end_with_its_children(tool: Any, tmp_path: Path) -> None:
    told = tmp_path / "pid"
    outcome = _run(tool, tmp_path, _PARENT + _TOLD.format(file=str(told)), seconds=3.0)
    assert (outcome.judgement, outcome.code) == ("out of time", None)
    assert _ends(int(told.read_text()))


def test_interrupted_it_leaves_no_process(tool: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    told = tmp_path / "pid"

    def interrupted(process: Any) -> float:
        if told.is_file() and told.read_text():
            raise KeyboardInterrupt
        return 0.0

    monkeypatch.setattr(tool, "resident_mb", interrupted)
    with pytest.raises(KeyboardInterrupt):
        _run(tool, tmp_path, _PARENT + _TOLD.format(file=str(told)))
    assert _ends(int(told.read_text()))


def _ends(pid: int) -> bool:
    """Whether a process is gone, or only waits to be buried."""
    try:
        process = psutil.Process(pid)
        return bool(process.status() == psutil.STATUS_ZOMBIE or process.wait(10) is None)
    except psutil.NoSuchProcess:
        return True


def test_a_pattern_in_quotes_is_the_programs(tool: Any) -> None:
    assert tool.arguments_of("pack --left '*.jpg' -o out", "o") == ["pack", "--left", "*.jpg", "-o", "o"]


def test_a_case_without_a_command_is_named_not_skipped(tool: Any, tmp_path: Path) -> None:
    (tmp_path / "02-bare").mkdir()
    (outcome,) = tool.run_case(tmp_path / "02-bare", ["false"], 1.0, 512)
    assert outcome.judgement == "not run"
    assert outcome.case in tool.as_markdown([outcome])
