"""Pages in a real browser, without a window."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

_COMPLAINT = re.compile(r"CONSOLE[^\n]*(?:Refused|violates|Content Security Policy)[^\n]*")


def run_in_browser(page: Path, folder: Path, *flags: str) -> str:
    """The page's DOM, where it is asked for (``--dump-dom``); fails where the page's own policy stops a part of it."""
    browser = shutil.which("chromium") or shutil.which("google-chrome") or shutil.which("chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine: the page cannot be run")
    command = [
        browser, "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--use-gl=angle",
        "--disable-background-networking", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
        f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=5000", "--window-size=1000,900",
        "--hide-scrollbars", "--enable-logging=stderr", *flags, f"file://{page}",
    ]  # fmt: skip
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert not _COMPLAINT.findall(done.stderr), "the content security policy stopped something of our own"
    return done.stdout
