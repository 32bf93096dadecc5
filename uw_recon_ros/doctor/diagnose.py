"""All checks in the chain's order, and the most likely cause."""

from __future__ import annotations

from dataclasses import dataclass

from uw_recon_ros.doctor.calibrations import check_calibration
from uw_recon_ros.doctor.cameras import check_cameras
from uw_recon_ros.doctor.check import Check, Level
from uw_recon_ros.doctor.clocks import check_clocks
from uw_recon_ros.doctor.clouds import check_autopilot, check_clouds, check_listeners
from uw_recon_ros.doctor.connections import check_connections
from uw_recon_ros.doctor.environment import check_discovery, check_transport
from uw_recon_ros.doctor.observation import Observation
from uw_recon_ros.doctor.stages import check_further, check_stages, replaced
from uw_recon_ros.doctor.topic_graph import STAGES

#: With how many stages replaced by others' nodes a check no longer matters.
_UNTIL = {check_cameras: 1, check_clocks: 1, check_calibration: 2}
_CHECKS = (
    check_discovery,
    check_cameras,
    check_clocks,
    check_calibration,
    check_connections,
    check_stages,
    check_further,
    check_clouds,
    check_autopilot,
    check_listeners,
    check_transport,
)


@dataclass(frozen=True)
class Diagnosis:
    """What was found, in the chain's order.

    Parameters
    ----------
    seen : Observation
    findings : tuple of Check
    """

    seen: Observation
    findings: tuple[Check, ...]

    @property
    def healthy(self) -> bool:
        """Whether nothing keeps clouds from coming."""
        return all(finding.level < Level.FAIL for finding in self.findings)

    @property
    def cause(self) -> Check | None:
        """The most likely cause; None where all is well.

        What comes first in the chain explains what comes after it: the first failure that is no mere symptom. Where
        there are symptoms only, the first thing that may matter; else the first symptom.
        """
        failed = [finding for finding in self.findings if finding.level == Level.FAIL]
        if not failed:
            return None
        causes = [finding for finding in failed if not finding.symptom]
        doubts = [f for f in self.findings if f.level == Level.WARN and not f.symptom and f.stage != "listeners"]
        return (causes or doubts or failed)[0]


def diagnose(seen: Observation) -> Diagnosis:
    """Judge what was seen of a graph.

    Parameters
    ----------
    seen : Observation

    Returns
    -------
    Diagnosis
    """
    if not seen.surroundings.nodes_seen:
        return Diagnosis(seen, (*check_discovery(seen), *check_transport(seen)))
    gone = replaced(seen)
    checks = [check for check in _CHECKS if gone < _UNTIL.get(check, len(STAGES) + 1)]
    return Diagnosis(seen, tuple(finding for check in checks for finding in check(seen)))
