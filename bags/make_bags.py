"""Make the sample bags anew: ``python bags/make_bags.py [FOLDER]`` or ``make bags``. README.md says what they show."""

from __future__ import annotations

import sys
from pathlib import Path

from uw_recon_ros.simulate import SimulateParams, simulate

SAMPLES = {
    "amphora": SimulateParams(seed=1, width=480, height=360, frames=4, rate_hz=1.0),
    "amphora_vertical": SimulateParams(
        seed=2,
        width=480,
        height=360,
        frames=2,
        rate_hz=1.0,
        axis="vertical",
        mono=True,
        water="1C",
        gain_difference=0.08,
    ),
}


def main() -> None:
    """Write every sample into a folder, this one by default."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name, params in SAMPLES.items():
        simulate(folder / name, params, overwrite=True, level=19)


if __name__ == "__main__":
    main()
