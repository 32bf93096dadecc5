"""How the command line begins: help without waiting, the version, the shell's tab key."""

from __future__ import annotations

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import uw_recon_ros
from uw_recon_ros import cli

HEAVY = {"numpy", "cv2", "numba", "scipy", "rosbags", "mcap", "trimesh", "pywt", "yaml", "tqdm", "rclpy", "PIL"}
needs_argcomplete = pytest.mark.skipif(importlib.util.find_spec("argcomplete") is None, reason="needs argcomplete")


def loaded_after(*words: str) -> tuple[set[str], str]:
    """Top-level packages that a call leaves loaded, and what it printed."""
    code = (
        "import atexit, sys\n"
        "atexit.register(lambda: sys.stderr.write(' '.join(sys.modules)))\n"
        "from uw_recon_ros.cli import main\nmain(sys.argv[1:])\n"
    )
    done = subprocess.run([sys.executable, "-c", code, *words], capture_output=True, text=True, check=True)
    return {name.partition(".")[0] for name in done.stderr.split()}, done.stdout


@pytest.mark.parametrize("words", [[], *([verb] for verb in cli.VERBS)], ids=lambda words: " ".join(words) or "none")
def test_help_loads_nothing_heavy(words: list[str]) -> None:
    loaded, printed = loaded_after(*words, "--help")
    assert "argparse" in loaded
    assert not loaded & HEAVY
    assert printed.startswith(f"usage: {' '.join(['uw_recon', *words])} ")


def test_help_of_one_subcommand_is_that_of_all(capsys: pytest.CaptureFixture[str]) -> None:
    for verb in cli.VERBS:
        told = []
        for words in ([verb], list(cli.VERBS)):
            with pytest.raises(SystemExit):
                cli.make_parser(words).parse_args([verb, "--help"])
            told.append(capsys.readouterr().out)
        assert told[0] == told[1]
        assert verb == "warmup" or len(re.findall(r"^  \S", told[0], re.MULTILINE)) > 1


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        cli.main(["--version"])
    assert left.value.code == 0
    assert capsys.readouterr().out == f"uw_recon {uw_recon_ros.__version__}\n"


def test_an_interrupt_is_one_line_even_while_arguments_are_read(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(cli.info, "add_arguments", interrupt)
    assert cli.main(["info", "bag"]) == 130
    assert capsys.readouterr().err == "uw_recon: interrupted\n"


def completions(line: str, folder: Path) -> set[str]:
    """What bash offers at the end of a line."""
    script = (
        'eval "$(uw_recon completion bash)"; complete -p uw_recon >/dev/null || exit 3\n'
        f"COMP_LINE={line!r}; COMP_POINT={len(line)}; COMP_TYPE=9; COMP_WORDS=($COMP_LINE ''); COMP_CWORD=1\n"
        "_python_argcomplete uw_recon 2>/dev/null; printf '%s\\n' \"${COMPREPLY[@]}\""
    )
    path = f"{Path(sys.executable).parent}:{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", script], capture_output=True, text=True, check=True, cwd=folder, env={**os.environ, "PATH": path}
    )
    return {word.strip() for word in done.stdout.splitlines()}


@needs_argcomplete
def test_bash_completes_subcommands_options_choices_and_files(tmp_path: Path) -> None:
    (tmp_path / "wreck.png").touch()
    assert completions("uw_recon s", tmp_path) == {"simulate", "survey"}
    assert completions("uw_recon simulate --lens", tmp_path) == {"--lens-blur-px"}
    assert completions("uw_recon disparity --effort ", tmp_path) == {"navigation", "balanced", "quality"}
    assert "wreck.png" in completions("uw_recon pair wr", tmp_path)


@needs_argcomplete
def test_code_for_zsh(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["completion", "zsh"]) == 0
    assert "compdef" in capsys.readouterr().out


def test_without_argcomplete_one_line_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    monkeypatch.setitem(sys.modules, "argcomplete.shell_integration", None)
    assert cli.main(["completion", "bash"]) == 1
    assert "pip install '.[completion]' in the sources' folder" in capsys.readouterr().err
