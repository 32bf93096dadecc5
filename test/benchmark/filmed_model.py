"""One simulated dive as a bag, as a side-by-side video and as two videos without sync: three models against the truth.

python test/benchmark/filmed_model.py [--seconds 60 --rate 30 --right-rate 29.97 --offset 5.37 --every 15]
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from helpers.filmed_dives import Filming, modelled, write_forms

from uw_recon_ros.simulate.params import CourseParams, SimulateParams

PARAMS = """/**:
  ros__parameters:
    effort: navigation
    min_disparity: 2
    max_disparity: {most}
"""


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rate", type=float, default=30.0, help="of the left camera, Hz")
    parser.add_argument("--right-rate", type=float, default=29.97, help="of the right camera, Hz")
    parser.add_argument("--offset", type=float, default=5.37, help="what the right clock is ahead, s")
    parser.add_argument("--every", type=int, default=15, help="a pair every so-many-th frame")
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--quality", type=int, default=20, help="constant rate factor of x264")
    args = parser.parse_args()
    size = {"width": args.width, "height": args.width * 3 // 4}
    params = SimulateParams(speed_m_s=0.08, snow_per_m3=20.0, **size)
    course = CourseParams(track="lawnmower", leg_m=1.2)
    filming = Filming(params, course, args.seconds, (args.rate, args.right_rate), args.offset, args.every, args.quality)
    say = sys.stdout.write
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        write_forms(Path(folder), filming)
        say(f"rendered and encoded in {time.process_time() - began:.0f} CPU s\n")
        say("| form | pairs | ATE, mm | surface median / 95 %, mm | complete, % |\n|" + " --- |" * 5 + "\n")
        for name in ("bag", "sbs", "two"):
            made = modelled(Path(folder), name, filming, PARAMS.format(most=args.width // 8))
            say(f"| {name} | {made.pairs} | {made.ate_mm:.1f} | {made.median_mm:.2f} / {made.p95_mm:.1f} | "
                f"{made.completeness_percent:.1f} |\n")  # fmt: skip
            for note in made.notes:
                say(f"<!-- {note} -->\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
