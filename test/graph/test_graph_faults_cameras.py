"""What cameras do on a dive, to the four nodes as processes: before, meanwhile and after, navigation gets the truth.

One graph for all of them: a fault must leave nothing behind either.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from helpers.graph_bench import FOUR, Bench, Graph
from helpers.ros_bench import BANDS, BASELINE
from helpers.sea_trial import OK, SECOND, STEP, SeaTrial, arguments
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
LEFT, RIGHT = ("left/image_raw", "left/camera_info"), ("right/image_raw", "right/camera_info")


@pytest.fixture(scope="module")
def trial(tmp_path_factory: pytest.TempPathFactory) -> Iterator[SeaTrial]:
    bench = Bench()
    graph = Graph(bench, tmp_path_factory.mktemp("faults"))
    for name in FOUR:
        graph.start(name, *arguments())
    trial = SeaTrial(graph)
    trial.connected()
    yield trial
    graph.end()
    bench.close()


@pytest.fixture(autouse=True)
def sailing(trial: SeaTrial) -> Iterator[None]:
    """All is well before and after."""
    trial.sails()
    yield
    trial.sails()
    assert all(executable.running for executable in trial.graph.started)
    assert not any("Traceback" in executable.output for executable in trial.graph.started)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_camera_stops_and_comes_back(trial: SeaTrial, side: str) -> None:
    other = {"left": RIGHT, "right": LEFT}[side]
    trial.sail_until(
        lambda: trial.complains("preprocess_node", f"/{side}/image_raw", "a publisher, but no messages"),
        "preprocess_node to name the camera",
        *other,
    )
    trial.sail_until(lambda: trial.complains("point_cloud_node", "/disparity"), "navigation's node to say so", *other)
    quiet = trial.stamp
    trial.sail_until(lambda: trial.stamp > quiet + 5 * STEP, "a while", *other)
    assert max(trial.depths) < quiet  # one camera sees no depth


def test_time_is_set_back_and_forward(trial: SeaTrial) -> None:
    """A looped bag, a clock that is set: later pairs are worked on at once, whatever their stamps were before."""
    before = trial.stamp
    for jump in (-60 * SECOND, 3600 * SECOND, -7200 * SECOND):
        trial.depths.clear()
        trial.clouds.clear()
        start = trial.stamp + jump
        trial.stamp = start
        trial.sail_until(
            lambda s=start: sum(s < stamp <= trial.stamp for stamp in trial.clouds.keys() & trial.depths.keys()) >= 3,
            f"clouds after a jump of {jump / SECOND:g} s",
        )
        for stamp in trial.clouds.keys() & trial.depths.keys():
            trial.check(stamp)
    trial.depths.clear()
    trial.clouds.clear()
    trial.stamp = before + 10 * SECOND


@pytest.mark.parametrize("topic", ["left/image_raw", "right/image_raw"])
def test_a_single_wild_stamp_does_not_stop_the_graph(trial: SeaTrial, topic: str) -> None:
    """What waits for the partner of an image from the future is forgotten when time turns out to go on."""
    stamp = trial.stamp
    trial.send(stamp + 3600 * SECOND, topic)
    trial.stamp = stamp
    trial.sail_until(lambda: any(stamp < at <= trial.stamp for at in trial.clouds), "pairs after the wild one")


def test_one_camera_at_half_rate(trial: SeaTrial) -> None:
    start, sent = trial.stamp, []
    dropped = int(trial.said("preprocess_node").get("dropped: no partner within tolerance", 0))
    for number in range(1, 13):
        trial.send(start + number * STEP, *LEFT, *(RIGHT if number % 2 else ()))
        sent += [trial.stamp] if number % 2 else []
        last = sent[-1]
        trial.graph.spin_until(lambda last=last: last in trial.clouds and last in trial.depths, "the pair")
    assert sorted(stamp for stamp in trial.clouds if stamp > start) == sent
    for stamp in sent:
        trial.check(stamp)
    key = "dropped: no partner within tolerance"
    trial.sail_until(lambda: int(trial.said("preprocess_node").get(key, 0)) >= dropped + 5, "to count them")


def test_a_tenth_of_all_messages_lost(trial: SeaTrial) -> None:
    """Every pair of which both images arrive comes out, and no other."""
    random, start, whole = np.random.default_rng(5), trial.stamp, []
    for number in range(1, 41):
        arriving = [topic for topic in trial.publishers if random.random() >= 0.1]
        trial.send(start + number * STEP, *arriving, "")
        if {"left/image_raw", "right/image_raw"} <= set(arriving):
            whole.append(trial.stamp)
            trial.graph.spin_until(lambda s=trial.stamp: s in trial.clouds and s in trial.depths, f"pair {number}")
    assert 25 < len(whole) < 40
    assert sorted(stamp for stamp in trial.clouds if stamp > start) == whole
    for stamp in whole:
        trial.check(stamp)


def set_parameter(trial: SeaTrial, node: str, name: str, value: int) -> tuple[bool, str]:
    integer = ParameterValue(type=ParameterType.PARAMETER_INTEGER, integer_value=value)
    request = SetParameters.Request(parameters=[Parameter(name=name, value=integer)])
    (result,) = trial.graph.call(f"/{node}/set_parameters", SetParameters, request).results
    return result.successful, result.reason


def test_parameters_changed_under_load(trial: SeaTrial) -> None:
    """Answered while pairs come; every depth is by the old parameters or the new; a refused change changes nothing."""
    start = trial.stamp
    nearest = BANDS[-1][2]
    for limit in (nearest - 3, 24, nearest - 3, 24):
        for _ in range(3):  # work that is under way and waiting
            trial.send(trial.stamp + STEP)
        assert set_parameter(trial, "disparity_node", "max_disparity", limit) == (True, "")
        accepted, reason = set_parameter(trial, "disparity_node", "max_disparity", -5)
        assert not accepted
        assert "max_disparity: expected at least min_disparity" in reason
        seen = limit >= nearest
        after = trial.stamp + 3 * STEP  # what is sent from now on meets the new limit
        trial.sail_until(lambda after=after: max(trial.depths) > after, f"pairs under limit {limit}")
        plane = trial.planes(max(trial.depths))
        assert np.isfinite(plane[:2]).all()
        near = float(plane[2])
        assert seen == bool(np.isclose(near, 15.0 / nearest, rtol=0.02)), f"limit {limit}: nearest plane at {near} m"
    assert all(
        np.allclose(trial.planes(stamp)[:2], [3.0, 15 / 11], rtol=0.02) for stamp in trial.depths if stamp > start
    )
    trial.sail_until(lambda: trial.said("disparity_node")["level"] == OK, "lateness to be over")


def test_a_calibration_that_changes(trial: SeaTrial) -> None:
    """Depths follow the cameras' own word, each wholly by the old one or wholly by the new."""
    for baseline in (2 * BASELINE, BASELINE):
        old, trial.baseline_m, start = trial.baseline_m, baseline, trial.stamp
        trial.sail_until(
            lambda s=start, b=baseline: any(
                np.isclose(trial.planes(t)[0], 30 * b, rtol=0.02) for t in trial.depths if t > s
            ),
            "depths by the new calibration",
        )
        by_new = [np.isclose(trial.planes(t)[0], 30 * baseline, rtol=0.02) for t in sorted(trial.depths) if t > start]
        assert by_new == sorted(by_new)  # once, and never back
        for stamp, new in zip(sorted(t for t in trial.depths if t > start), by_new, strict=True):
            if stamp in trial.clouds:
                trial.check(stamp, baseline if new else old)
