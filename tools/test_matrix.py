"""Run the quick tests on every Python that is there: ``make test-matrix``.

A virtual environment a version in ``.matrix/``, with ROS 2's wheels where they exist for it (3.10 to 3.12); without ROS
the tests of nodes are left out. Then the oldest and the newest numpy and OpenCV, each with the tests that lean on them
most; Kilted's wheels; and what pip finds for the newest Python, where no interpreter is there, and for aarch64. Prints
a table; exit code 1 where anything failed.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
WITH_WHEELS = ("3.10", "3.11", "3.12")
TESTS = ("-q", "-n", "2", "--dist", "loadgroup", "-m", "not slow and not graph")


#: Python, what is pinned.
LIBRARIES = (
    ("3.11", ("numpy==1.26.*", "opencv-python-headless==4.6.*")),
    ("3.11", ("numpy==2.0.*", "opencv-python-headless==4.10.*")),
    ("3.12", ("numpy>=2.2", "opencv-python-headless>=4.11,<5")),
    ("3.12", ("numpy>=2.2", "opencv-python-headless>=5,<6")),
)
LIBRARY_TESTS = (
    "-q",
    "-m",
    "not slow and not graph",
    "test/files",
    "test/preprocess",
    "test/rectify",
    "test/test_images.py",
)
PLATFORMS = ("manylinux2014_aarch64", "manylinux_2_27_aarch64", "manylinux_2_28_aarch64")


class Outcome(NamedTuple):
    """What came of one version."""

    version: str
    what: str
    passed: bool
    last_line: str


def interpreter(version: str) -> str | None:
    """A Python of that version: on PATH, or one of pyenv's."""
    found = shutil.which(f"python{version}")
    if found and _is(found, version):
        return found
    kept = sorted(
        Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"), "versions").glob(f"{version}.*/bin/python")
    )
    return str(kept[-1]) if kept and _is(str(kept[-1]), version) else None


def _is(python: str, version: str) -> bool:
    code = "import sys; print('%d.%d' % sys.version_info[:2])"
    told = subprocess.run([python, "-c", code], capture_output=True, text=True, check=False)
    return told.stdout.strip() == version


def environment() -> dict[str, str]:
    """Without the mark that the wheels' start-up hook leaves for the interpreter it ran in."""
    return {name: value for name, value in os.environ.items() if name != "_ROS_WHEELS_BOOTSTRAP_COMPLETE"}


def run(version: str, python: str, tests: Sequence[str], pinned: Sequence[str] = (), ros: str = "ros-jazzy") -> Outcome:
    """Make the environment, run the tests."""
    name = "-".join(
        [version, *(re.sub(r"[^a-z0-9.]", "", pin) for pin in pinned), *([ros] if ros != "ros-jazzy" else [])]
    )
    folder = ROOT / ".matrix" / name
    inside = folder / "bin" / "python"
    extras = f"test,{ros}" if version in WITH_WHEELS else "test"
    what = ", ".join(pinned) or (f"tests, {ros}" if version in WITH_WHEELS else "tests without ROS")
    steps = [] if inside.exists() else [[python, "-m", "venv", str(folder)]]
    steps.append([str(inside), "-m", "pip", "install", "--quiet", *pinned, "--editable", f"{ROOT}[{extras}]"])
    for step in steps:
        made = subprocess.run(step, env=environment(), capture_output=True, text=True, check=False)
        if made.returncode:
            return Outcome(version, "installation", False, made.stderr.strip().splitlines()[-1])
    done = subprocess.run(
        [str(inside), "-m", "pytest", *tests],
        cwd=ROOT,
        env=environment(),
        stdout=subprocess.PIPE,
        text=True,
        check=False,
    )
    sys.stdout.write(done.stdout)
    return Outcome(version, what, done.returncode == 0, done.stdout.strip().splitlines()[-1])


def resolve(version: str, platforms: Sequence[str] = ()) -> Outcome:
    """Ask pip whether all that the package needs is there for that version, here or on other platforms."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--target", folder]
        command += ["--python-version", version, "--only-binary=:all:"]
        command += [word for platform in platforms for word in ("--platform", platform)]
        told = subprocess.run(
            [*command, *_requirements()], env=environment(), capture_output=True, text=True, check=False
        )
    line = told.stderr.strip().splitlines()[-1] if told.returncode else "all wheels are there"
    what = "resolved by pip" + (" for aarch64" if platforms else "")
    return Outcome(version, what, told.returncode == 0, line)


def _requirements() -> list[str]:
    from importlib.metadata import requires

    return [line for line in requires("uw_recon_ros") or [] if "extra ==" not in line]


def outcomes(versions: list[str], tests: list[str]) -> Iterator[Outcome]:
    """One a version, as they come."""
    for version in versions:
        python = interpreter(version)
        yield run(version, python, tests) if python else resolve(version)


def other_outcomes(tests: list[str]) -> Iterator[Outcome]:
    """Of pinned libraries, of Kilted's wheels, and of aarch64."""
    for version, pinned in LIBRARIES:
        python = interpreter(version)
        if python:
            yield run(version, python, LIBRARY_TESTS, pinned)
    python = interpreter("3.12")
    if python:
        yield run("3.12", python, tests, ros="ros-kilted")
    yield resolve("3.12", PLATFORMS)


def main() -> int:
    """Run all; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--versions", nargs="+", default=list(VERSIONS), metavar="X.Y")
    parser.add_argument("tests", nargs="*", default=list(TESTS), help="arguments for pytest")
    parser.add_argument("--only", choices=("versions", "others"), help="half of it")
    args = parser.parse_args()
    table = list(outcomes(args.versions, args.tests)) if args.only != "others" else []
    table += list(other_outcomes(args.tests)) if args.only != "versions" else []
    for outcome in table:
        verdict = "passed" if outcome.passed else "FAILED"
        sys.stdout.write(f"Python {outcome.version}: {outcome.what}: {verdict}: {outcome.last_line}\n")
    return int(not all(outcome.passed for outcome in table))


if __name__ == "__main__":
    raise SystemExit(main())
