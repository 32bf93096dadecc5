"""What a message declares is not what it gets: no memory for images that are not there."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

CODE = """
import json, resource, sys
sys.path[:0] = [{here!r}, {shared!r}]
from helpers import bad_messages as bad
from helpers.ros_bench import Bench
from test_bad_messages import Subject, good_camera_infos, good_compressed, good_images
from uw_recon_ros.nodes import preprocess_node

def peak_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024

def mapped_bytes():
    return int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()

huge = [
    bad.setting("", width=2**31, height=2**31, step=2**31).on("left/image_raw"),
    bad.setting("", width=2**32 - 1, height=2**32 - 1, step=2**32 - 1).on("right/image_raw"),
    bad.setting("", width=65_536, height=65_536, step=3 * 65_536).on("left/image_raw"),
]
encoded = [
    bad.containing(content, "").on("left/image_raw/compressed")
    for content in (
        bad.BOMB, bad.png(65_535, 65_535), bad.jpeg(65_535, 65_535), bad.tiff(65_535, 65_535), bad.webp(16_384, 16_384)
    )
]
told = dict()
for transport, good, attacks in (("raw", good_images, huge), ("compressed", good_compressed, encoded)):
    bench = Bench()
    subject = Subject(bench, preprocess_node, preprocess_node.PreprocessNode, good, image_transport=transport)
    before = peak_mb()
    room = mapped_bytes() + 512 * 2**20
    resource.setrlimit(resource.RLIMIT_AS, (room, resource.RLIM_INFINITY))
    for attack in attacks:
        subject.attack(attack)
    subject.unharmed()
    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
    told[transport] = dict(grown_mb=peak_mb() - before, refused=subject.refused())
    bench.close()
print(json.dumps(told))
"""


def test_what_is_declared_is_not_allocated() -> None:
    """With room for 512 MiB more, declared are up to 55 EB; the greatest growth allowed is a few good frames'."""
    code = CODE.format(here=str(Path(__file__).parent), shared=str(Path(__file__).parents[1]))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    told = json.loads(done.stdout.splitlines()[-1])
    assert told["raw"]["refused"] == {"ImageError": 3}
    assert told["compressed"]["refused"] == {"ImageError": 5}
    assert max(each["grown_mb"] for each in told.values()) < 64
