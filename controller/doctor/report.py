"""The report of an examination and its repairs, and the questions before each repair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from haptic_wall.controller.doctor.cycles import Series
from haptic_wall.hw.dynamixel.examine.finding import Change, Finding, Findings
from haptic_wall.hw.dynamixel.examine.judgement import Judgement, Repair

Tell = Callable[[str], None]
Consent = Callable[[str], bool]
"""Asked before each change; returns whether it may be made"""


@dataclass(slots=True)
class Report:
    """Findings, repairs made, and items that could not be examined."""

    findings: Findings = field(default_factory=Findings)
    changes: list[Change] = field(default_factory=list)
    not_examined: list[str] = field(default_factory=list)
    reached: bool = True
    """The port could be used, and a servo replied on it"""
    suits: str | None = None
    """The suitable schedule; None: none, or not measured"""
    cycles: list[Series] = field(default_factory=list)

    def leave_out(self, *names: str) -> None:
        """Record items that could not be examined."""
        self.not_examined += names


def told(judgement: Judgement, before: dict[str, Finding]) -> Judgement:
    """Return a finding after the repair, with the value found before it."""
    first = before.get(judgement.finding.name)
    if first is None or first.found == judgement.finding.found:
        return judgement
    found = f"{first.found}, now {judgement.finding.found}"
    return judgement._replace(finding=judgement.finding._replace(found=found))


def question(finding: Finding, repair: Repair) -> str:
    """Return the question to ask before a repair."""
    if not repair.register:
        return f"{finding.name}: {finding.found} -> reboot"
    if repair.register == "torque_enable":
        return "torque: on -> off (a load on the shaft will fall)"
    return f"{finding.name}: {finding.found} -> {finding.wanted}"
