"""tools/run_cases.py on case folders made here: every judgement is reached, cases are only read, bounds hold."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from typing import Any

import cv2
import numpy as np
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
        ("", "works"),
        ("sys.exit('uw_recon: rig.yaml: expected two cameras, got one')", "refused clearly"),
        ("sys.exit('uw_recon: expected\\n  in line 3')", "confusing"),
        ("sys.exit('uw_recon: [Errno 20] Not a directory')", "confusing"),
        ("raise ValueError('no')", "crash"),
        ("sys.exit('uw_recon: internal error')", "crash"),
        ("import os; os.abort()", "crash"),
        ("bytearray(4 << 30)", "crash"),
    ],
)
def test_judges_what_the_terminal_shows(tool: Any, tmp_path: Path, script: str, judgement: str) -> None:
    assert _run(tool, tmp_path, script).judgement == judgement


@pytest.mark.parametrize(
    ("factor", "report", "judgement"),
    [
        (1.0, {}, "works"),
        (1.02, {}, "works"),
        (1000.0, {}, "silently wrong"),
        (0.96, {}, "silently wrong"),
        (1000.0, {"reliable": False}, "works"),
    ],
)
def test_holds_depth_against_the_truth(
    tool: Any, tmp_path: Path, factor: float, report: dict[str, Any], judgement: str
) -> None:
    depth = np.full((4, 4), tool.TRUE_DEPTH_M * factor, np.float32)
    depth[0] = np.nan
    made = tmp_path / "made.tiff"
    assert cv2.imwrite(str(made), depth)
    script = (
        f"import json, shutil\nout.mkdir()\nshutil.copy({str(made)!r}, out / 'depth.tiff')\n"
        f"(out / 'report.json').write_text(json.dumps({report!r}))"
    )
    outcome = _run(tool, tmp_path, script)
    assert outcome.judgement == judgement
    assert outcome.depth_m == pytest.approx(tool.TRUE_DEPTH_M * factor, rel=1e-5)


def test_ends_what_does_not_end(tool: Any, tmp_path: Path) -> None:
    outcome = _run(tool, tmp_path, "import time; time.sleep(600)", seconds=1.0)
    assert outcome.judgement == "crash"
    assert outcome.code == -9


def test_a_case_without_a_command_is_named_not_skipped(tool: Any, tmp_path: Path) -> None:
    (tmp_path / "02-bare").mkdir()
    (outcome,) = tool.run_case(tmp_path / "02-bare", ["false"], 1.0, 512)
    assert outcome.judgement == "not run"
    assert outcome.case in tool.as_markdown([outcome])
