"""The graph brought up, paused and taken down over the nodes' services, as a lifecycle manager does it."""

from __future__ import annotations

import signal
from pathlib import Path
from typing import Any

import pytest
from helpers.flood import Source
from helpers.graph_bench import FOUR
from helpers.lifecycle_manager import ACTIVATE, CLEANUP, CONFIGURE, DEACTIVATE, Manager
from sensor_msgs.msg import Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.ros.diagnostics import SUPERSEDED

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
BAG = Path(__file__).parents[2] / "bags" / "amphora"


def test_up_paused_changed_and_down(graph: Any) -> None:
    for name in FOUR:
        graph.start(name, "--ros-args", "-p", "autostart:=false", "-p", "effort:=navigation")
    managers = {name: Manager(graph.bench.outsider, name, graph.spin_until) for name in FOUR}
    player = graph.start("bag_player_node", BAG, "--loop")
    clouds = graph.bench.listen(PointCloud2, "points2")
    matched = graph.bench.listen(Image, "disparity/status")
    for transition in (CONFIGURE, ACTIVATE):
        assert clouds == []
        assert all(manager.change(transition) for manager in managers.values())
    graph.spin_until(lambda: clouds, "a cloud")

    matcher = managers["disparity_node"]
    assert matcher.change(DEACTIVATE)
    graph.bench.spin_for(0.2)  # what was on its way to us
    clouds.clear()
    matched.clear()
    graph.spin_until(lambda: graph.said["/disparity_node"].get("state") == "inactive")
    graph.bench.spin_for(1.0)
    assert matched == []
    assert matcher.change(CLEANUP)
    assert matcher.set(target_rate_hz=2.0).successful
    assert matcher.change(CONFIGURE, ACTIVATE)
    graph.spin_until(lambda: matched and clouds, "work again")
    graph.spin_until(lambda: graph.said["/disparity_node"].get("target [Hz]") == "2")

    for name in reversed(FOUR):
        assert managers[name].change(DEACTIVATE, CLEANUP)
        assert managers[name].state == "unconfigured"
    player.signal(signal.SIGINT)
    for executable in graph.started:
        executable.signal(signal.SIGINT)
        assert executable.wait() == 0
        assert "Traceback" not in executable.output


def test_services_are_answered_while_a_frame_is_worked_on(graph: Any) -> None:
    """A pair of three megapixels takes tens of seconds at this effort; parameters and states do not wait for it."""
    source = Source(graph)
    graph.start("disparity_node", "--ros-args", "-p", "effort:=quality", "-p", "max_disparity:=128")
    graph.bench.listen(DisparityImage, "disparity")
    source.connect("rectified")
    manager = Manager(graph.bench.outsider, "disparity_node", graph.spin_until)

    def under_way() -> bool:
        source.send()
        return f"dropped: {SUPERSEDED}" in graph.said["/disparity_node"]

    graph.spin_until(under_way, "work")
    for seed in range(10):
        assert manager.set(match_seed=seed).successful
        assert not manager.set(match_seed=-1).successful
        assert manager.state == "active"
    assert manager.change(DEACTIVATE, ACTIVATE, DEACTIVATE, CLEANUP, CONFIGURE)
    assert "work [s]" not in graph.said["/disparity_node"]  # all that while the first frame was under way
