"""The report of an examination and its repairs; asks before each repair."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from haptic_wall.hw.errors import ExplainedError
from haptic_wall.hw.servo import Check

Tell = Callable[[str], None]
Consent = Callable[[str], bool]
"""Asked before each change; returns whether it may be made"""


def of_error(name: str, error: ExplainedError, wanted: str, otherwise: str) -> Check:
    """Return a check that ended in an error.

    Args:
        name: Name of the check.
        error: The error.
        wanted: The wanted value.
        otherwise: The remedy where the message has none.
    """
    found = str(replace(error.problem, advice="")).rstrip(".")
    return Check(name, False, found, wanted, error.problem.advice.rstrip(".") or otherwise)


def not_applicable(name: str, why: str) -> Check:
    """Return a check of something that does not exist here."""
    return Check(name, True, f"does not apply: {why}", "", applies=False)


_OF_THE_BUS: Final = ("port", "used by", "latency timer")
"""Checks that are made with an axis, and hold for all"""


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
class Report:
    """Checks, and repairs made."""

    tell: Tell
    """Called with the current step, and with each change at once: after an interrupt the user
    should know what was changed"""
    consent: Consent | None
    """None: nothing is changed"""
    found: dict[str, Check] = field(default_factory=dict)
    """The checks by name, in order; a later one of the same name replaces the first"""
    changes: list[Change] = field(default_factory=list)
    reached: bool = True
    """The port could be used, and a servo replied on it"""
    axis: str = ""
    """The axis that is examined; its own checks have its name before theirs. Empty: the only one"""

    @property
    def wrong(self) -> list[Check]:
        """Return the checks that found a fault."""
        return [check for check in self.found.values() if not check.ok]

    def add(self, *checks: Check) -> None:
        """Record checks, in the place of earlier ones of the same name."""
        named = (replace(check, name=self._named(check.name)) for check in checks)
        self.found.update({check.name: check for check in named})

    def may(self, question: str) -> bool:
        """Whether a change may be made; it is asked."""
        return self.consent is not None and self.consent(question)

    def note(self, change: Change) -> None:
        """Record a change, and tell it."""
        change = change._replace(name=self._named(change.name))
        self.changes.append(change)
        self.tell(f"{change}")

    def _named(self, name: str) -> str:
        return f"{self.axis}.{name}" if self.axis and name not in _OF_THE_BUS else name
