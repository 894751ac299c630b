"""Collects the checks before torque is enabled, and the remedy of each failed one."""

from __future__ import annotations

from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.servo import Check


class Checklist:
    """Checks in order; failed ones are collected, so that a person can repair all at once."""

    def __init__(self, name: str) -> None:
        """Create an empty list.

        Args:
            name: Of the servo, for the message.
        """
        self.checks: list[Check] = []
        self._name = name
        self._remedies: list[str] = []

    def add(self, name: str, ok: bool, found: str, wanted: str, remedy: str = "") -> None:
        """Record one check.

        Args:
            name: Of the check.
            ok: Whether it passed.
            found: The found value.
            wanted: The wanted value.
            remedy: A sentence with the fault and its remedy.
        """
        self.checks.append(Check(name, ok, found, wanted))
        if not ok:
            self._remedies.append(remedy)

    def refuse_if_unfit(self) -> None:
        """Raise if any check failed so far.

        Raises:
            UnfitServoError: With a sentence for each failed check.
        """
        if self._remedies:
            remedies = " ".join(self._remedies)
            raise UnfitServoError(f"The {self._name} must not be driven as it is. {remedies}")
