"""Spoiled bags in the player, node and process, and in whole surveys: exit code 0 or 1, one line, no traceback."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.bag_mutants import bomb, calibrated, joined, make_bases, mutant, split
from helpers.dives import PARAMS, make_dive, recorded
from helpers.ros_bench import Bench

from uw_recon_ros.bags import BagReader, open_bag
from uw_recon_ros.errors import BagError
from uw_recon_ros.nodes.bag_player_node import BagPlayerNode
from uw_recon_ros.nodes.replay import parse

pytestmark = pytest.mark.graph
LIMIT_S = 3600  # on hanging
PLAYED = 80


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(
        [sys.executable, *arguments],
        capture_output=True,
        text=True,
        timeout=LIMIT_S,
        check=False,
        start_new_session=True,
    )
    assert done.returncode in (0, 1), done.stderr
    assert "Traceback" not in done.stderr + done.stdout
    return done


@pytest.fixture(scope="module")
def bases(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    return make_bases(tmp_path_factory.mktemp("bases"), calibrated(4))


def played(bench: Bench, bag: BagReader, path: Path) -> int:
    settings = parse([str(path), "--rate", "10000", "--clock-rate", "1000"], "")
    player = BagPlayerNode(bag, settings, context=bench.context)
    try:
        player.play()
        return int(player.summary().split()[1])
    finally:
        player.close()


def test_the_player_plays_what_can_be_played(tmp_path: Path, bases: list[bytes]) -> None:
    bench = Bench()
    sent = 0
    try:
        for seed in range(PLAYED):
            path = tmp_path / f"{seed}.mcap"
            path.write_bytes(mutant(bases, seed)[0])
            with contextlib.suppress(BagError), open_bag(path) as bag:
                sent += played(bench, bag, path)
    finally:
        bench.close()
    assert sent > 4 * PLAYED


@pytest.mark.parametrize("seed", [2, 5, 9, 12, 30, 41])
def test_the_player_process_ends_in_order(tmp_path: Path, bases: list[bytes], seed: int) -> None:
    path = tmp_path / "spoiled.mcap"
    path.write_bytes(mutant(bases, seed)[0])
    done = run("-m", "uw_recon_ros.nodes.bag_player_node", str(path), "--rate", "10000")
    assert done.stdout.startswith("sent ") if done.returncode == 0 else len(done.stderr.splitlines()) == 1


def test_a_survey_takes_what_is_left_of_each(tmp_path: Path) -> None:
    """One survey of many spoiled dives, one of them sound and one beyond hope."""
    params, folder = tmp_path / "small.yaml", tmp_path / "dives"
    params.write_text(PARAMS + "    effort: navigation\n")
    dive = recorded(make_dive(tmp_path / "dive", frames=2))
    (tmp_path / "forms").mkdir()
    forms = make_bases(tmp_path / "forms", dive)
    folder.mkdir()
    (folder / "00_sound.mcap").write_bytes(forms[0])
    (folder / "01_hopeless.mcap").write_bytes(b"rubbish")
    records = split(forms[1])
    (folder / "02_bomb.mcap").write_bytes(joined([records[0], (6, bomb(2**29)), *records[1:]]))
    for seed in range(14):
        (folder / f"{seed + 10}.mcap").write_bytes(mutant(forms, 500 + seed)[0])
    arguments = ("-o", str(tmp_path / "out"), "--params", str(params), "--jobs", "2", "--json", "--write", "disparity")
    done = run("-m", "uw_recon_ros.cli", "survey", *map(str, sorted(folder.iterdir())), *arguments)
    assert done.returncode == 1, "the hopeless one"
    assert '"unreadable": ["' in done.stdout
    assert (tmp_path / "out" / "report.html").is_file()
    outside = {p.name for p in tmp_path.iterdir()} - {"small.yaml", "dives", "dive", "forms", "out"}
    assert outside == set()
