"""What a node says about itself."""

from __future__ import annotations

import time

import pytest
from diagnostic_msgs.msg import DiagnosticStatus

from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.ros.diagnostics import DEACTIVATED, IDLE, NO_PARTNER, SUPERSEDED, Diagnostics
from uw_recon_ros.ros.log_throttle import Throttle


def values(status: DiagnosticStatus) -> dict[str, str]:
    return {pair.key: pair.value for pair in status.values}


def test_a_node_with_nothing_to_do_is_well() -> None:
    status = Diagnostics().tick("/node")
    assert (status.level, status.message, status.name) == (DiagnosticStatus.OK, "idle", "/node")


def test_rates_are_means_over_the_seconds_seen() -> None:
    diagnostics = Diagnostics()
    for number in (10, 20):
        diagnostics.count("in left/image_raw", number)
        diagnostics.count("done")
        status = diagnostics.tick("/node")
    assert values(status)["in left/image_raw [Hz]"] == "15.00"
    assert status.message == "working"


def test_old_seconds_are_forgotten() -> None:
    diagnostics = Diagnostics()
    diagnostics.count("in x", 1000)
    for _ in range(11):
        status = diagnostics.tick("/node")
    assert values(status).get("in x [Hz]", "0.00") == "0.00"


@pytest.mark.parametrize("reason", [SUPERSEDED, NO_PARTNER, DEACTIVATED])
def test_skipped_frames_are_counted_and_no_fault(reason: str) -> None:
    diagnostics = Diagnostics()
    diagnostics.drop(reason)
    status = diagnostics.tick("/node")
    assert status.level == DiagnosticStatus.OK
    assert values(status)[f"dropped: {reason}"] == "1"
    assert values(status)["dropped"] == "1"


def test_some_bad_frames_are_a_warning_and_only_bad_ones_an_error() -> None:
    diagnostics = Diagnostics()
    diagnostics.drop("ImageError", "left image: 3 bytes")
    diagnostics.count("done")
    some = diagnostics.tick("/node")
    diagnostics.drop("ImageError", "left image: 3 bytes")
    only = diagnostics.tick("/node")
    assert (some.level, only.level) == (DiagnosticStatus.WARN, DiagnosticStatus.ERROR)
    assert only.message == "left image: 3 bytes"
    assert values(only)["last drop"] == "left image: 3 bytes"
    assert diagnostics.drops == {"ImageError": 2}


def test_a_standing_problem_is_told_once_and_lasts_until_cleared() -> None:
    told: list[tuple[str, str]] = []
    diagnostics = Diagnostics(lambda key, text: told.append((key, text)))
    for _ in range(3):
        diagnostics.problem("scale", "unknown")
        assert diagnostics.tick("/node").level == DiagnosticStatus.WARN
    diagnostics.problem("scale", None)
    assert diagnostics.tick("/node").level == DiagnosticStatus.OK
    assert told == [("scale", "unknown")]
    diagnostics.problem("scale", "unknown")
    assert len(told) == 2


def test_spreads_and_facts() -> None:
    diagnostics = Diagnostics()
    for value in range(1, 21):
        diagnostics.measure("work", value / 10)
    diagnostics.say(density=0.9)
    said = values(diagnostics.tick("/node"))
    assert [said[key] for key in ("work [s]", "work p95 [s]", "work max [s]")] == ["1.05", "1.9", "2"]
    assert said["density"] == "0.9"


def test_the_state_of_the_lifecycle_is_told_first() -> None:
    diagnostics = Diagnostics()
    told = [diagnostics.tick("/node", state, "warming up") for state in ("active", "inactive", "unconfigured")]
    assert [status.message for status in told] == ["warming up", "inactive: warming up", "unconfigured: warming up"]
    assert diagnostics.tick("/node", "inactive").message == "inactive"
    assert (told[1].values[0].key, told[1].values[0].value) == ("state", "inactive")


def test_a_failed_transition_outweighs_everything() -> None:
    diagnostics = Diagnostics()
    diagnostics.count("done")
    diagnostics.problem("scale", "unknown")
    status = diagnostics.tick("/node", "unconfigured", trouble="configure failed: no")
    assert (status.level, status.message) == (DiagnosticStatus.ERROR, "unconfigured: configure failed: no")
    assert values(status)["transition"] == "configure failed: no"
    assert diagnostics.tick("/node").level == DiagnosticStatus.WARN


def test_what_is_forgotten_and_what_is_counted_for_ever() -> None:
    diagnostics = Diagnostics()
    diagnostics.count("in x", 10)
    diagnostics.drop("ImageError")
    diagnostics.problem("scale", "unknown")
    diagnostics.say(density=0.9)
    diagnostics.measure("work", 1.0)
    diagnostics.forget()
    status = diagnostics.tick("/node")
    assert status.level == DiagnosticStatus.OK
    assert values(status) == {
        "state": "active", "dropped [Hz]": "0.00", "dropped": "1", "dropped: ImageError": "1",
        IDLE: values(status)[IDLE],
    }  # fmt: skip


def test_idle_since_the_last_that_came_or_was_done(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    diagnostics = Diagnostics()
    now[0] += 7
    assert values(diagnostics.tick("/node"))[IDLE] == "7.0"
    assert values(diagnostics.tick("/node", busy=True))[IDLE] == "0.0"
    for happens in (lambda: diagnostics.count("in x"), lambda: diagnostics.drop("ImageError")):
        now[0] += 5
        assert values(diagnostics.tick("/node"))[IDLE] == "5.0"
        happens()
        assert values(diagnostics.tick("/node"))[IDLE] == "0.0"


def test_throttle_holds_back_equal_lines_and_says_how_many() -> None:
    lines: list[str] = []
    now = [0.0]
    throttle = Throttle(lines.append, 10.0, lambda: now[0])
    for seconds in (0.0, 1.0, 9.9, 10.0):
        now[0] = seconds
        throttle("a", f"at {seconds}")
    throttle("b", "another")
    assert lines == ["at 0.0", "at 10.0 (2 more like it)", "another"]


def test_a_silenced_throttle_logs_nothing() -> None:
    lines: list[str] = []
    throttle = Throttle(lines.append)
    throttle.silence()
    throttle("a", "text")
    assert lines == []


def test_both_ends_are_named() -> None:
    diagnostics = Diagnostics()
    diagnostics.connect({"left/image_raw": 1}, {"disparity": 2})
    diagnostics.connect({}, {"disparity": 0})
    said = values(diagnostics.tick("/node"))
    assert said["listeners disparity"] == "0"
    assert "publishers left/image_raw" not in said  # no longer read


def test_findings_stand_by_their_codes() -> None:
    diagnostics = Diagnostics()
    rows, air = (Finding(code, code.name) for code in (Code.RECTIFY_ROWS_DISAGREE, Code.RECTIFY_CALIBRATED_IN_AIR))
    diagnostics.found("rectification", [rows, air])
    told = values(diagnostics.tick("/node"))
    assert told["codes"] == "rectify.rows_disagree,rectify.calibrated_in_air"
    assert told["rectify.rows_disagree"] == rows.text
    diagnostics.found("rectification", [])
    status = diagnostics.tick("/node")
    assert "codes" not in values(status)
    assert status.level == DiagnosticStatus.OK


def test_the_last_drop_has_its_code() -> None:
    diagnostics = Diagnostics()
    diagnostics.drop("EstimationError", "swapped cameras", code=Code.RECTIFY_EXCHANGED)
    diagnostics.drop(SUPERSEDED)
    assert values(diagnostics.tick("/node"))["last drop code"] == "rectify.exchanged"


def test_an_error_names_the_cause_of_today() -> None:
    diagnostics = Diagnostics()
    diagnostics.drop("EstimationError", "swapped cameras", code=Code.RECTIFY_EXCHANGED)
    diagnostics.tick("/node")
    diagnostics.drop("no left_info yet")
    status = diagnostics.tick("/node")
    assert (status.level, status.message) == (DiagnosticStatus.ERROR, "no left_info yet")
    assert "last drop code" not in values(status)


def test_a_missing_input_comes_before_what_it_makes_fail() -> None:
    diagnostics = Diagnostics()
    diagnostics.problem("silent", "waiting for /left/camera_info: no publisher")
    diagnostics.drop("no left_info yet")
    message = diagnostics.tick("/node").message
    assert message == "waiting for /left/camera_info: no publisher; no left_info yet"
