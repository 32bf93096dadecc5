"""The user is told what is compiled, and can have it done beforehand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from uw_recon_ros import jit, kernel_warmup, pair
from uw_recon_ros.cli import main
from uw_recon_ros.files.images import write_image


def test_empty_cache_is_announced(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    said: list[str] = []
    monkeypatch.setattr(jit, "CACHE_DIRECTORY", tmp_path)
    monkeypatch.setattr(kernel_warmup, "CACHE_DIRECTORY", tmp_path)
    kernel_warmup.tell_if_cold(said.append)
    assert said == [f"first start: compiling kernels, about a minute; kept in {tmp_path}"]
    monkeypatch.setattr(jit, "CACHE_DIRECTORY", None)
    monkeypatch.setattr(kernel_warmup, "CACHE_DIRECTORY", None)
    kernel_warmup.tell_if_cold(said.append)
    assert said[1].endswith("every time: no directory can be written")


def test_a_method_that_is_not_asked_for_is_not_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_warmup, "is_cold", lambda folder: folder.name == "kz2")
    said: list[str] = []
    kernel_warmup.tell_if_cold(said.append, ["graph_cut"])
    assert not said
    kernel_warmup.tell_if_cold(said.append, ["kz2"])
    kernel_warmup.tell_if_cold(said.append)
    assert len(said) == 2


def test_disparity_says_that_it_compiles_only_where_it_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    image = np.random.RandomState(1).randint(0, 256, (40, 60)).astype(np.uint8)
    for name, shift in (("left", 0), ("right", -4)):
        write_image(tmp_path / f"{name}.png", np.roll(image, shift, axis=1))
    command = ["disparity", str(tmp_path / "left.png"), str(tmp_path / "right.png"), "--max-disparity", "8"]
    command += ["--effort", "navigation", "--overwrite", "-o", str(tmp_path / "d.pfm")]
    assert main(command) == 0  # compiles, if nothing has yet
    capsys.readouterr()
    assert main(command) == 0
    assert "compiling" not in capsys.readouterr().err
    monkeypatch.setattr(pair, "tell_if_cold", lambda say, methods: say("compiling kernels"))
    assert main(command) == 0
    assert "compiling kernels" in capsys.readouterr().err


def test_warmup_command(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["warmup"]) == 0
    words = capsys.readouterr().out.split()
    assert words[1:3] == ["kernels", "compiled,"]
    assert int(words[0]) + int(words[3]) > 20
    assert words[-1] == str(jit.CACHE_DIRECTORY)
