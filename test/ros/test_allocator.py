"""Whether memory that a thread frees is there for its next images without the kernel's help."""

import subprocess
import sys

import pytest

from uw_recon_ros.ros.allocator import keep_freed_memory

ROUNDS, BLOCKS, BYTES = 20, 6, 3 << 20  # of an image each, held together as in a stage
FAULTS = f"""
import resource, sys, threading
import numpy as np
from uw_recon_ros.ros.allocator import keep_freed_memory

if sys.argv[1] == "kept" and not keep_freed_memory({{}}):
    sys.exit(77)

def a_pair():
    held = [np.ones({BYTES}, np.uint8) for _ in range({BLOCKS})]
    held.clear()

def work():
    a_pair()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    for _ in range({ROUNDS}):
        a_pair()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)

thread = threading.Thread(target=work)
thread.start()
thread.join()
"""


def faults(how: str) -> int:
    done = subprocess.run([sys.executable, "-c", FAULTS, how], capture_output=True, text=True)
    if done.returncode == 77:
        pytest.skip("no allocator here that can be told")
    assert done.returncode == 0, done.stderr
    return int(done.stdout)


def test_freed_memory_is_used_again_without_page_faults():
    """Less than one page in a hundred; otherwise as many as there are (fewer where pages are huge)."""
    pages = ROUNDS * BLOCKS * BYTES / 4096
    assert faults("kept") < 0.01 * pages


@pytest.mark.parametrize("name", ["GLIBC_TUNABLES", "MALLOC_ARENA_MAX", "MALLOC_TRIM_THRESHOLD_"])
def test_what_the_user_chose_stays(name: str):
    assert not keep_freed_memory({name: "1"})
