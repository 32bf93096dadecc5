"""Signals are noted, and obeyed at the latest after a while."""

from __future__ import annotations

import signal
import subprocess
import sys
import time

import pytest

from uw_recon_ros import stop_signals

NOTED = "import time; from uw_recon_ros import stop_signals; stop_signals.note(); print('ready', flush=True); "


def test_two_seconds_are_promised() -> None:
    assert stop_signals.PATIENCE_S < 2.0


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(
    ("busy", "said"),
    [
        ("\nwhile not stop_signals.came(): time.sleep(0.01)\nprint('in order')", "in order\n"),
        ("\nwhile True: pass", ""),
    ],
    ids=["looks", "never looks"],
)
def test_a_noted_signal(number: int, busy: str, said: str) -> None:
    process = subprocess.Popen([sys.executable, "-c", NOTED + busy], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    began = time.monotonic()
    process.send_signal(number)
    process.send_signal(number)
    try:
        assert process.wait() == 0
    finally:
        process.kill()
    assert process.stdout.read() == said
    process.stdout.close()
    if not said:
        assert time.monotonic() - began >= 0.9 * stop_signals.PATIENCE_S


FINISHES = """
import threading, time
from uw_recon_ros import stop_signals
stop_signals.PATIENCE_S = 0.2
stop_signals.finish_first()
stop_signals.note()
print('ready', flush=True)
while not stop_signals.came(): time.sleep(0.01)
print('finishing', flush=True)
time.sleep(1.0 if {soon} else 1000.0)
print('finished', flush=True)
"""


@pytest.mark.parametrize("soon", [True, False])
def test_what_was_gathered_is_finished_unless_a_second_signal_comes(soon: bool) -> None:
    process = subprocess.Popen([sys.executable, "-c", FINISHES.format(soon=soon)], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    process.send_signal(signal.SIGINT)
    assert process.stdout.readline() == "finishing\n"
    if not soon:
        process.send_signal(signal.SIGINT)
    try:
        assert process.wait() == 0
    finally:
        process.kill()
    assert process.stdout.read() == ("finished\n" if soon else "")
    process.stdout.close()
