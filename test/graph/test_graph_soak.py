"""What the nodes hold does not grow with what they have done; `test/benchmark/graph_soak.py` looks longer."""

from __future__ import annotations

import pytest
from helpers.graph_bench import FOUR, Graph
from helpers.ros_bench import HEIGHT, WIDTH
from helpers.sea_trial import SeaTrial, arguments
from helpers.soak import growth_kb, soak

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
MONO_IMAGE_KB = WIDTH * HEIGHT / 1e3  # the smallest of what would be held on to by mistake


def test_hundreds_of_pairs_leave_nothing_behind(graph: Graph) -> None:
    pids = {name: graph.start(name, *arguments()).process.pid for name in FOUR}
    trial = SeaTrial(graph)
    trial.connected()
    trial.sails()
    samples = list(soak(trial, pids, pairs=300, every=30))
    settled = samples[2:]
    for name in FOUR:
        assert len({sample.nodes[name].threads for sample in settled}) == 1
        assert len({sample.nodes[name].files for sample in settled}) == 1
        assert growth_kb(settled, name) < MONO_IMAGE_KB / 2
    assert len({sample.segments for sample in settled}) == 1
    trial.sails()
