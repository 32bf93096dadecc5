"""Stamps against clocks: what tf and navigation make of the stamps."""

from __future__ import annotations

from uw_recon_ros.doctor.cameras import image_topic
from uw_recon_ros.doctor.check import Check, ok, warn
from uw_recon_ros.doctor.observation import Observation
from uw_recon_ros.topics import SIDES

_STAGE = "clock"
_LATE_S = 5.0


def check_clocks(seen: Observation) -> list[Check]:
    """Compare stamps, wall clock and ``/clock``."""
    clock, simulated = seen.clock, [n.name for n in seen.nodes.values() if n.parameters.get("use_sim_time") is True]
    found = []
    if simulated and not clock.publishers:
        found.append(
            warn(_STAGE, f"use_sim_time is set ({', '.join(simulated)}), but nobody publishes /clock",
                 "start the bag or simulation, or set use_sim_time to false")
        )  # fmt: skip
    elif clock.stands_still:
        found.append(warn(_STAGE, "/clock stands still: the bag or simulation is paused", "resume it"))
    elif clock.publishers and seen.nodes and not simulated:
        text = f"{', '.join(clock.publishers)} publishes /clock, but our nodes do not use it: latency is not shown"
        found.append(warn(_STAGE, text, "set use_sim_time to true for nodes, RViz and tf"))
    if len(clock.publishers) > 1:
        found.append(
            warn(
                _STAGE,
                f"/clock has {len(clock.publishers)} publishers: {', '.join(clock.publishers)}",
                "stop all but one",
            )
        )
    behind_s = [came.behind_ns * 1e-9 for came in (image_topic(seen, side).arrivals for side in SIDES) if came.count]
    if behind_s and not clock.publishers:
        worst = max(behind_s, key=abs)
        if abs(worst) > _LATE_S:
            text = f"image stamps are {abs(worst):.0f} s {'behind' if worst > 0 else 'ahead of'} this machine's clock"
            found.append(
                warn(
                    _STAGE,
                    text,
                    "set the clocks (chrony, PTP), or play bags with /clock and use_sim_time: tf finds no transform",
                )
            )
        else:
            found.append(ok(_STAGE, f"image stamps are {worst * 1e3:.0f} ms behind this machine's clock"))
    return found
