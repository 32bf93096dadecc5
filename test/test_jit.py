"""The kernel cache: wherever the package lies, whoever starts at once, whatever changed."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path

import pytest

import uw_recon_ros.jit

MODULE = """
from uw_recon_ros.jit import CACHE_DIRECTORY, kernel
from helper import grown

@kernel
def total(values):
    result = 0.0
    for value in values:
        result += grown(value)
    return result
"""
HELPER = """
from uw_recon_ros.jit import kernel

@kernel
def grown(value):
    return value + 1.0
"""
RUN = """
import numpy as np
import sums
value = sums.total(np.arange(4.0))
hits = sum(sums.total.stats.cache_hits.values())
print(value, hits, sums.CACHE_DIRECTORY)
"""


@pytest.fixture
def package(tmp_path: Path) -> Path:
    folder = tmp_path / "kernels"
    folder.mkdir()
    (folder / "sums.py").write_text(MODULE)
    (folder / "helper.py").write_text(HELPER)
    return folder


def start(package: Path, **environment: str) -> subprocess.Popen[str]:
    root = str(Path(uw_recon_ros.jit.__file__).parents[1])
    kept = {k: v for k, v in os.environ.items() if k not in ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "HOME", "TMPDIR")}
    kept |= {"PYTHONPATH": f"{root}:{package}", "PYTHONDONTWRITEBYTECODE": "1"} | environment
    return subprocess.Popen([sys.executable, "-c", RUN], env=kept, text=True, stdout=subprocess.PIPE)


def finish(process: subprocess.Popen[str]) -> tuple[float, int, str]:
    out, _ = process.communicate()
    assert process.returncode == 0
    value, hits, directory = out.split()
    return float(value), int(hits), directory


def test_read_only_install_uses_the_given_directory_and_finds_the_code_again(package: Path, tmp_path: Path) -> None:
    package.chmod(stat.S_IRUSR | stat.S_IXUSR)
    given = tmp_path / "given"
    runs = [finish(start(package, NUMBA_CACHE_DIR=str(given), HOME=str(tmp_path))) for _ in range(2)]
    package.chmod(stat.S_IRWXU)
    assert runs == [(10.0, 0, str(given)), (10.0, 1, str(given))]
    assert sorted(path.name for path in package.iterdir()) == ["helper.py", "sums.py"]


def test_changed_helper_in_another_file_is_noticed(package: Path, tmp_path: Path) -> None:
    home = {"HOME": str(tmp_path / "home")}
    assert finish(start(package, **home))[0] == 10.0
    (package / "helper.py").write_text(HELPER.replace("1.0", "2.0"))
    assert finish(start(package, **home))[:2] == (14.0, 0)


def test_several_processes_at_once(package: Path, tmp_path: Path) -> None:
    started = [start(package, HOME=str(tmp_path / "home")) for _ in range(4)]
    assert [finish(process)[0] for process in started] == [10.0] * 4


def test_without_a_writable_home_a_private_temporary_directory_serves(package: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")  # a home below a file can never be made
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    _, _, directory = finish(start(package, HOME=str(tmp_path / "file" / "home"), TMPDIR=str(temporary)))
    assert Path(directory).parent == temporary
    assert Path(directory).stat().st_mode & 0o077 == 0
    shutil.rmtree(directory)
    (temporary / Path(directory).name).mkdir()
    (temporary / Path(directory).name).chmod(0o777)  # anybody could have put code there: not used
    _, _, other = finish(start(package, HOME=str(tmp_path / "file" / "home"), TMPDIR=str(temporary)))
    assert other != directory
    assert Path(other).stat().st_mode & 0o077 == 0
