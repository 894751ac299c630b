"""Watches for a suspended computer, which makes loop and servo fail as a stall or a cable does."""

from __future__ import annotations

from haptic_wall.controller.runtime.safety import End, StopReason, Trip
from haptic_wall.hw.clock import Clock, Suspension

_LOOKS_LIKE = frozenset(
    (
        End.INTERRUPTED,
        Trip.LOSSES_IN_ROW,
        Trip.LOSS_RATE,
        Trip.OVERSPEED,
        Trip.TORQUE_LOST,
        Trip.SERVO_LOST,
        Trip.LOOP_HUNG,
    )
)
"""Ends that it may cause before it is noticed itself, or by being noticed"""


class SuspensionWatch:
    """Looks for suspensions, and corrects the stop reason of a run accordingly.

    Args:
        clock: The system's; the tests have one that can be suspended.
        real: The servo is real: its Bus Watchdog runs on while the computer is suspended, so no run
            goes on after that.
    """

    def __init__(self, clock: Clock, real: bool) -> None:
        self._suspension = Suspension(clock)
        self._real = real

    def look(self) -> bool:
        """Whether the run must end. Costs little, and never waits."""
        return self._real and self._suspension.seconds() > 0.0

    def verdict(self, reason: StopReason) -> tuple[StopReason, str]:
        """Return the final stop reason, and its cause; empty: there was none.

        Args:
            reason: The reason that loop and supervisor found.
        """
        if not self.look():
            return reason, ""
        text = f"the computer was suspended for {self._suspension.seconds():.3g} s"
        if reason == End.REFUSED:
            return reason, text
        if reason not in _LOOKS_LIKE:
            return reason, ""
        if before := Trip.of(reason):
            text += f"; the run had ended by {before.label}"
        return Trip.SUSPENDED, text

    def notes(self) -> list[str]:
        """Return events that did not end the run but should be reported."""
        if not self._real and (seconds := self._suspension.seconds()):
            return [f"the computer was suspended for {seconds:.3g} s during the run"]
        return []
