"""Findings of an examination: found, wanted, and how to mend it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple


class Finding(NamedTuple):
    """One check. Where ``ok`` holds and ``fix`` is not empty, it is advice: well, but not best."""

    name: str
    ok: bool
    found: str
    wanted: str
    fix: str = ""
    """What to do; empty where there is nothing to do"""
    applies: bool = True
    """False: there is no such thing here, ``found`` says why"""
    fixable: bool = False
    """Whether ``--fix`` can do it"""


def of_error(name: str, error: Exception, wanted: str, otherwise: str) -> Finding:
    """A check that ended in an error, whose message says "what was found: what to do.".

    Args:
        name: Of the check.
        error: What came.
        wanted: Instead.
        otherwise: What to do where the message does not say.
    """
    found, _, fix = str(error).rstrip(".").partition(": ")
    return Finding(name, False, found, wanted, fix or otherwise)


def not_applicable(name: str, why: str) -> Finding:
    """A check of something that is not there to be checked."""
    return Finding(name, True, f"does not apply: {why}", "", "", False)


class Change(NamedTuple):
    """One thing that was mended, or was to be."""

    name: str
    before: str
    after: str
    """As read back"""
    verified: bool
    """Whether what was read back is what was wanted"""

    def __str__(self) -> str:
        end = "read back" if self.verified else "NOT AS WANTED"
        return f"{self.name}: {self.before} -> {self.after} ({end})"


@dataclass(slots=True)
class Findings:
    """Findings in the order they were made; a later one of the same name replaces the first."""

    checks: list[Finding] = field(default_factory=list)

    def add(self, *findings: Finding) -> None:
        """Put findings down, in the place of earlier ones of the same name."""
        for finding in findings:
            for place, before in enumerate(self.checks):
                if before.name == finding.name:
                    self.checks[place] = finding
                    break
            else:
                self.checks.append(finding)

    @property
    def wrong(self) -> list[Finding]:
        """Those that found something wrong."""
        return [finding for finding in self.checks if not finding.ok]
