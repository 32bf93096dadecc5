"""Models of simulated dives against the truth: simulate, survey, model, evaluate-model, one line of a table a dive."""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
from hashlib import sha256
from pathlib import Path

from uw_recon_ros.model.evaluate import evaluate_model

PARAMS = "/**:\n  ros__parameters:\n    effort: {effort}\n"
SMALL = ("--width", "320", "--height", "240")
#: Name: options of ``uw_recon simulate``, of ``uw_recon model``.
DIVES: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "line (320x240)": (("--track", "line", "--frames", "8", *SMALL), ()),
    "line (640x480)": (("--track", "line", "--frames", "8"), ()),
    "lawn-mower (320x240)": (("--track", "lawnmower", "--leg-m", "1.2", "--frames", "24", *SMALL), ()),
    "lawn-mower, two views at least": (
        ("--track", "lawnmower", "--leg-m", "1.2", "--frames", "24", *SMALL),
        ("--min-views", "2"),
    ),
    "mud, 7C, snow (320x240)": (
        ("--track", "line", "--frames", "12", "--texture", "weak", "--water", "7C", "--snow-per-m3", "1000", *SMALL),
        (),
    ),
}
HEAD = "| simulated dive | absolute error | scale | median / 95 % mm | complete | in 1 / 2 sigma | CPU s a frame | MB |"


def run(*words: str) -> tuple[float, int]:
    """A command of ``uw_recon``: its CPU seconds, and the most memory of any so far, MB."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([sys.executable, "-m", "uw_recon_ros.cli", *words], check=True, env=os.environ)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, after.ru_maxrss // 1024


def row(name: str, folder: Path, effort: str) -> str:
    """One line of the table; bags and surveys are kept between runs."""
    simulated, modelled = DIVES[name]
    place = folder / f"{sha256(' '.join(simulated).encode()).hexdigest()[:12]}_{effort}"
    place.mkdir(parents=True, exist_ok=True)
    bag, truth, survey = (str(place / part) for part in ("bag", "truth", "survey"))
    if not Path(bag).exists():
        run("simulate", *simulated, "-o", bag, "--truth", truth)
    (place / "params.yaml").write_text(PARAMS.format(effort=effort))
    run("survey", bag, "-o", survey, "--write", "model", "--params", str(place / "params.yaml"), "--quiet")
    cpu, most = run("model", survey, "--overwrite", "--quiet", *modelled)
    found = evaluate_model(survey, truth)
    way = max(found["trajectory"]["segments"], key=lambda s: s["frames"])
    m = found["surface"][0]
    return (
        f"| {name} | {1e3 * way['ate_m']:.1f} mm, {way['ate_percent']:.2f} % | {100 * (way['scale'] - 1):+.2f} % "
        f"| {m['median_mm']:.2f} / {m['p95_mm']:.1f} | {m['completeness_percent']:.1f} % "
        f"| {m['within_1_sigma_percent']:.0f} / {m['within_2_sigma_percent']:.0f} % "
        f"| {cpu / way['frames']:.2f} | {most} |"
    )


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path("bench_out/surfaces"), help="where dives are kept")
    parser.add_argument("--effort", default="navigation")
    parser.add_argument("dives", nargs="*", default=list(DIVES))
    args = parser.parse_args()
    sys.stdout.write(HEAD + "\n|" + " --- |" * 8 + "\n")
    for name in args.dives:
        sys.stdout.write(row(name, args.folder, args.effort) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
