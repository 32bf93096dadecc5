"""Compiled once: later processes only load, whatever directory the package lies in and whoever starts at once."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from test_planes_matcher import pair_of, plane

import uw_recon_ros
from uw_recon_ros.match.planes.matcher import graph_cut

RUN = """
import hashlib, json, sys
import numpy as np
from uw_recon_ros import jit
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.match.planes.matcher import graph_cut
effort = sys.argv[1]
Match(MatchParams(effort=effort)).warm_up()
after_warm_up = jit.cache_use().compiled
image = np.random.RandomState(1).randint(0, 256, (60, 90)).astype(np.uint8)
found = graph_cut(image, np.roll(image, -4, 1), 0, 12, effort=effort, threads=2)
digest = hashlib.sha256(found.disparity.tobytes() + found.sigma.tobytes()).hexdigest()
use = jit.cache_use()
print(json.dumps([digest, use.compiled, use.loaded, use.compiled - after_warm_up, jit.__file__]))
"""


def start(effort: str, **environment: str) -> subprocess.Popen[str]:
    env = os.environ | {"PYTHONDONTWRITEBYTECODE": "1"} | environment
    return subprocess.Popen([sys.executable, "-c", RUN, effort], env=env, cwd="/", text=True, stdout=subprocess.PIPE)


def finish(process: subprocess.Popen[str]) -> tuple[str, int, int, int, str]:
    out, _ = process.communicate()
    assert process.returncode == 0
    return tuple(json.loads(out))


def test_second_process_compiles_nothing() -> None:
    finish(start("balanced"))
    _, compiled, loaded, _, _ = finish(start("balanced"))
    assert compiled == 0
    assert loaded > 10


def test_warm_up_leaves_nothing_for_the_first_call() -> None:
    assert finish(start("balanced"))[3] == 0


@pytest.mark.slow
def test_several_processes_on_an_empty_cache_with_a_read_only_package(tmp_path: Path) -> None:
    package = tmp_path / "site" / "uw_recon_ros"
    shutil.copytree(Path(uw_recon_ros.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    for folder in (package, *(p for p in package.rglob("*") if p.is_dir())):
        folder.chmod(0o555)
    files = sorted(package.rglob("*"))
    environment = {"PYTHONPATH": str(package.parent), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    first = [finish(p) for p in [start("navigation", **environment) for _ in range(2)]]
    later = finish(start("navigation", **environment))
    assert sorted(package.rglob("*")) == files
    for folder in (package, *(p for p in package.rglob("*") if p.is_dir())):
        folder.chmod(0o755)
    assert later[4].startswith(str(package))  # it was this copy that ran
    assert {run[0] for run in first} == {later[0]} == {finish(start("navigation"))[0]}
    assert all(run[1] > 0 for run in first)
    assert later[1] == 0


def test_called_from_several_threads_at_once() -> None:
    pairs = [pair_of(plane(50, 80, 0.05, 0.02, 2.0 + i), seed=i) for i in range(4)]
    alone = [graph_cut(*pair, 0, 14, threads=1) for pair in pairs]
    with ThreadPoolExecutor(4) as pool:
        together = list(pool.map(lambda pair: graph_cut(*pair, 0, 14, threads=2), pairs))
    for one, other in zip(alone, together, strict=True):
        assert one.disparity.tobytes() == other.disparity.tobytes()
        assert np.array_equal(one.status, other.status)
