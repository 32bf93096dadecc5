"""What all tests share."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys

import pytest
from hypothesis import settings

# In CI the same examples every time; elsewhere others each time, and a failure prints how to see it again.
settings.register_profile("ci", derandomize=True, deadline=None)
settings.register_profile("default", deadline=None, print_blob=True)
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as a shell's background has it; processes under test inherit it
    signal.signal(signal.SIGINT, signal.default_int_handler)
settings.load_profile("ci" if os.environ.get("CI") else "default")

if importlib.util.find_spec("rclpy") is None:  # Python without ROS 2: the core is tested, nodes are not
    collect_ignore = ["graph", "nodes", "ros", "survey/test_frame_messages.py", "survey/test_survey_and_nodes.py"]
    collect_ignore += ["doctor/test_calibration_doors.py"]

COMPILE = """
import tempfile
from pathlib import Path
from uw_recon_ros import jit, simulate, kernel_warmup
from uw_recon_ros.progress import say

kernel_warmup.tell_if_cold(say)
kernel_warmup.warm_up()
if jit.is_cold(Path(simulate.__path__[0])):
    from uw_recon_ros.simulate.params import SimulateParams
    from uw_recon_ros.simulate.write import simulate

    with tempfile.TemporaryDirectory() as folder:
        simulate(Path(folder, "bag"), SimulateParams(width=64, height=48, frames=1))
"""


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session: pytest.Session) -> None:
    """Have the kernels compiled before any test and any of its limits, once for all of pytest-xdist's processes.

    In a process of its own: a compilation that is interrupted spoils numba for the rest of the process.
    """
    ready = "UW_RECON_KERNELS_READY" in os.environ  # as tools/mutate.py says, which runs tests by the hundred
    if ready or hasattr(session.config, "workerinput") or session.config.option.collectonly:
        return
    if subprocess.run([sys.executable, "-c", COMPILE], check=False).returncode:
        pytest.exit("the kernels could not be compiled, see above", returncode=1)
