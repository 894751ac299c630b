"""Checks made before a servo may have torque, and what to do about each thing found wrong."""

from __future__ import annotations

from haptic_wall.hw.errors import UnfitServoError
from haptic_wall.hw.servo import Check


class Checklist:
    """Checks in order; those that fail are gathered, so that a person mends all in one go."""

    def __init__(self, name: str) -> None:
        """Begin with nothing checked.

        Args:
            name: Of the servo, for the message.
        """
        self.checks: list[Check] = []
        self._name = name
        self._remedies: list[str] = []

    def add(self, name: str, ok: bool, found: str, wanted: str, remedy: str = "") -> None:
        """Put one check down.

        Args:
            name: What was checked.
            ok: Whether it holds.
            found: What was found.
            wanted: What was wanted.
            remedy: A sentence that says what is wrong and what to do.
        """
        self.checks.append(Check(name, ok, found, wanted))
        if not ok:
            self._remedies.append(remedy)

    def refuse_if_unfit(self) -> None:
        """Stop here if anything was found wrong so far.

        Raises:
            UnfitServoError: With a sentence for each thing.
        """
        if self._remedies:
            remedies = " ".join(self._remedies)
            raise UnfitServoError(f"The {self._name} must not be driven as it is. {remedies}")
