"""The findings of an examination: found, wanted, and the remedy."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

from haptic_wall.hw.errors import ExplainedError


class Finding(NamedTuple):
    """One check. With ``ok`` and a ``fix`` it is advice: it works, but could be better."""

    name: str
    ok: bool
    found: str
    wanted: str
    fix: str = ""
    """The remedy; empty: none is needed"""
    applies: bool = True
    """False: it does not exist here; ``found`` gives the reason"""
    fixable: bool = False
    """Whether ``--fix`` can do it"""


def of_error(name: str, error: ExplainedError, wanted: str, otherwise: str) -> Finding:
    """Return a check that ended in an error.

    Args:
        name: Name of the check.
        error: The error.
        wanted: The wanted value.
        otherwise: The remedy where the message has none.
    """
    found = str(replace(error.problem, advice="")).rstrip(".")
    return Finding(name, False, found, wanted, error.problem.advice.rstrip(".") or otherwise)


def not_applicable(name: str, why: str) -> Finding:
    """Return a check of something that does not exist here."""
    return Finding(name, True, f"does not apply: {why}", "", "", False)


class Change(NamedTuple):
    """One repair, made or attempted."""

    name: str
    before: str
    after: str
    """The value read back"""
    verified: bool
    """Whether the value read back is the wanted one"""

    def __str__(self) -> str:
        end = "read back" if self.verified else "NOT AS WANTED"
        return f"{self.name}: {self.before} -> {self.after} ({end})"


@dataclass(slots=True)
class Findings:
    """Findings in order; a later one of the same name replaces the first."""

    checks: list[Finding] = field(default_factory=list)

    def add(self, *findings: Finding) -> None:
        """Record findings, in the place of earlier ones of the same name."""
        for finding in findings:
            for place, before in enumerate(self.checks):
                if before.name == finding.name:
                    self.checks[place] = finding
                    break
            else:
                self.checks.append(finding)

    @property
    def wrong(self) -> list[Finding]:
        """Return the findings of faults."""
        return [finding for finding in self.checks if not finding.ok]
