"""A diagnosis as a table for people, and as JSON."""

from __future__ import annotations

import json

from uw_recon_ros.doctor.check import Check, Level
from uw_recon_ros.doctor.diagnose import Diagnosis


def _line(finding: Check) -> str:
    return f"{finding.level.name:<5} {finding.stage:<12} {finding.text}"


def as_table(diagnosis: Diagnosis) -> str:
    """One line a finding, then the most likely cause and what to do about it."""
    seen = diagnosis.seen
    head = f"graph in {seen.namespace}, domain {seen.surroundings.domain}, watched for {seen.seconds:.1f} s"
    lines = [head, *(_line(finding) for finding in diagnosis.findings)]
    cause = diagnosis.cause
    if cause is None:
        doubts = sum(finding.level == Level.WARN for finding in diagnosis.findings)
        told = f"with {doubts} warning{'s' * (doubts > 1)} above" if doubts else "healthy"
        lines.append(f"{told}: clouds come")
    else:
        lines.append(f"most likely cause: {cause.text}" + (f" -> {cause.advice}" if cause.advice else ""))
    return "\n".join(lines)


def as_json(diagnosis: Diagnosis) -> str:
    """The same for programs: ``healthy``, ``cause`` (null or a finding), ``findings``."""

    def plain(finding: Check) -> dict[str, object]:
        return {
            "level": finding.level.name, "stage": finding.stage, "text": finding.text, "advice": finding.advice,
            "symptom": finding.symptom, "code": finding.code,
        }  # fmt: skip

    seen, cause = diagnosis.seen, diagnosis.cause
    return json.dumps(
        {
            "healthy": diagnosis.healthy,
            "namespace": seen.namespace,
            "domain": seen.surroundings.domain,
            "seconds": round(seen.seconds, 2),
            "cause": plain(cause) if cause else None,
            "findings": [plain(finding) for finding in diagnosis.findings],
        }
    )
