"""Run the quick tests on every Python that is there: ``make test-matrix``.

A virtual environment a version in ``.matrix/``, with ROS 2's wheels where they exist for it (3.10 to 3.12); without ROS
the tests of nodes are left out. The newest Python, where no interpreter is there, is resolved by pip at least. Prints a
table; exit code 1 where anything failed.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parent.parent
VERSIONS = ("3.10", "3.11", "3.12", "3.13", "3.14")
WITH_WHEELS = ("3.10", "3.11", "3.12")
TESTS = ("-q", "-n", "2", "--dist", "loadgroup", "-m", "not slow and not graph")


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


def run(version: str, python: str, tests: list[str]) -> Outcome:
    """Make the environment, run the tests."""
    folder = ROOT / ".matrix" / version
    inside = folder / "bin" / "python"
    extras = "test,ros-jazzy" if version in WITH_WHEELS else "test"
    what = "tests" if version in WITH_WHEELS else "tests without ROS"
    steps = [] if inside.exists() else [[python, "-m", "venv", str(folder)]]
    steps.append([str(inside), "-m", "pip", "install", "--quiet", "--editable", f"{ROOT}[{extras}]"])
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


def resolve(version: str) -> Outcome:
    """Ask pip whether all that the package needs is there for that version."""
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "install", "--dry-run", "--quiet", "--target", folder]
        command += ["--python-version", version, "--only-binary=:all:"]
        told = subprocess.run(
            [*command, *_requirements()], env=environment(), capture_output=True, text=True, check=False
        )
    line = told.stderr.strip().splitlines()[-1] if told.returncode else "all wheels are there"
    return Outcome(version, "resolved by pip", told.returncode == 0, line)


def _requirements() -> list[str]:
    from importlib.metadata import requires

    return [line for line in requires("uw_recon_ros") or [] if "extra ==" not in line]


def outcomes(versions: list[str], tests: list[str]) -> Iterator[Outcome]:
    """One a version, as they come."""
    for version in versions:
        python = interpreter(version)
        yield run(version, python, tests) if python else resolve(version)


def main() -> int:
    """Run all; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--versions", nargs="+", default=list(VERSIONS), metavar="X.Y")
    parser.add_argument("tests", nargs="*", default=list(TESTS), help="arguments for pytest")
    args = parser.parse_args()
    table = list(outcomes(args.versions, args.tests))
    for outcome in table:
        verdict = "passed" if outcome.passed else "FAILED"
        sys.stdout.write(f"Python {outcome.version}: {outcome.what}: {verdict}: {outcome.last_line}\n")
    return int(not all(outcome.passed for outcome in table))


if __name__ == "__main__":
    raise SystemExit(main())
