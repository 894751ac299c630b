"""Collects the checks before torque is enabled, and the remedy of each failed one."""

from __future__ import annotations

from dataclasses import replace

from haptic_wall.hw.errors import Problem, ServoError, UnfitServoError
from haptic_wall.hw.servo import Check


def remedy(what: str, advice: str) -> Problem:
    """Return a fault with its remedy, printed as ``WHAT: ADVICE``."""
    return Problem(what, advice=advice, mark=ServoError.mark)


class Checklist:
    """Checks in order; failed ones are collected, so that a person can repair all at once."""

    def __init__(self, name: str) -> None:
        """Create an empty list.

        Args:
            name: Name of the servo, for the message.
        """
        self.checks: list[Check] = []
        self._name = name
        self._faults: list[Problem] = []

    def add(
        self, name: str, ok: bool, found: str, wanted: str, fault: Problem | None = None
    ) -> None:
        """Record one check.

        Args:
            name: Name of the check.
            ok: Whether it passed.
            found: The found value.
            wanted: The wanted value.
            fault: The fault if the check did not pass, and its remedy.
        """
        self.checks.append(Check(name, ok, found, wanted))
        if not ok and fault is not None:
            self._faults.append(fault)

    def refuse_if_unfit(self) -> None:
        """Raise if any check failed so far.

        Raises:
            UnfitServoError: With a sentence for each failed check.
        """
        if self._faults:
            *others, last = self._faults
            unfit = f"The {self._name} must not be driven as it is."
            raise UnfitServoError(
                replace(last, what=" ".join((unfit, *map(str, others), last.what)))
            )
