"""Ctrl-C, at any moment, of real processes: one line, 130, and what is written is whole."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from uw_recon_ros.files.images import read_image, write_image

#: The console script, telling when it can be interrupted: before that the interpreter itself is starting.
SCRIPT = (
    "import os, sys\nfrom uw_recon_ros import executables\nload = executables.import_module\n"
    "def tell(name):\n    os.write(1, b'ready')\n    return load(name)\n"
    "executables.import_module = tell\nsys.exit(executables.uw_recon())"
)
MOMENTS_S = (0.0, 0.02, 0.05, 0.1, 0.2, 0.4, 0.8, 1.6, 3.2, 6.4)


@pytest.fixture(scope="module")
def stills(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stills")
    scene = np.random.default_rng(2).integers(0, 256, (12, 20, 3), np.uint8).repeat(8, axis=0).repeat(8, axis=1)
    for side, shift in (("left", 0), ("right", -5)):
        (folder / side).mkdir()
        for number in range(4):
            write_image(folder / side / f"{number}.png", np.roll(scene, shift - number, axis=1))
    return folder


def commands(stills: Path, out: Path) -> dict[str, list[str]]:
    left, right = (str(stills / side / "0.png") for side in ("left", "right"))
    return {
        "help": ["--help"],
        "info": ["info", str(stills)],
        "pair": ["pair", left, right, "-o", str(out)],
        "survey": ["survey", str(stills), "-o", str(out), "--jobs", "2"],
        "simulate": ["simulate", "-o", str(out), "--frames", "3"],
    }


@pytest.mark.parametrize("words", [["--help"], ["--version"], ["no such verb"], ["info", "/nowhere"]])
def test_the_interpreters_farewell_is_not_interrupted(words: list[str]) -> None:
    """From when the command has ended until the process has: SIGINT would end it without a line."""
    script = (
        "import signal, sys\nfrom uw_recon_ros import executables\nexecutables.uw_recon()\n"
        "sys.exit(77 if signal.getsignal(signal.SIGINT) is signal.SIG_IGN else 1)"
    )
    done = subprocess.run([sys.executable, "-c", script, *words], capture_output=True, check=False)
    assert done.returncode == 77, done.stderr.decode()


@pytest.mark.slow
@pytest.mark.parametrize("command", ["help", "info", "pair", "survey", "simulate"])
def test_ctrl_c_at_any_moment(command: str, stills: Path, tmp_path: Path) -> None:
    ended = set()
    for number, moment in enumerate(MOMENTS_S):
        out = tmp_path / str(number)
        words = commands(stills, out)[command]
        process = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, *words], stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            start_new_session=True,
        )  # fmt: skip
        assert process.stdout is not None
        assert process.stdout.read(5) == b"ready"
        time.sleep(moment)
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers too
        _, said = process.communicate()
        told = said.decode()
        assert "Traceback" not in told, f"at {moment} s: {told}"
        assert "Exception ignored" not in told
        assert told.count("interrupted") == (process.returncode == 130), f"at {moment} s: {told}"
        assert process.returncode in (0, 1, 130), f"at {moment} s: {process.returncode}, {told}"
        ended.add(process.returncode)
        for image in out.rglob("*.png"):
            assert read_image(image).size
    assert 130 in ended


def test_an_interrupt_that_is_lost_on_its_way_is_obeyed(tmp_path: Path) -> None:
    """A destructor swallows exceptions; a library makes others of them."""
    code = (
        "import os, signal, sys, time\nfrom uw_recon_ros import executables, stop_signals, cli\n"
        "class Swallows:\n    def __del__(self):\n        os.kill(os.getpid(), signal.SIGINT); time.sleep(0.1)\n"
        "def main():\n    Swallows()\n    time.sleep(60)\n"
        "cli.main = main\nsys.exit(executables.uw_recon())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (130, "uw_recon: interrupted\n")
