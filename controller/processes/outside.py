"""Watches for external reasons to end a run: another program on the port, a suspended computer.

Either makes loop or servo fail in ways that look like a bad cable, a weak supply or a stall. The
supervisor therefore checks for them during the run, and once more after a trip of the loop.
"""

from __future__ import annotations

from typing import Protocol

from haptic_wall.controller.runtime.safety import End, StopReason, Trip
from haptic_wall.hw.clock import Clock, Suspension

_LOOKS_LIKE = frozenset(
    (
        Trip.LOSSES_IN_ROW,
        Trip.LOSS_RATE,
        Trip.OVERSPEED,
        Trip.TORQUE_LOST,
        Trip.SERVO_LOST,
        Trip.LOOP_HUNG,
    )
)
"""Trips that either may cause before it is noticed itself"""


class Users(Protocol):
    """Finds other programs that use the port."""

    def look(self) -> str:
        """Search a little; return the program, for people. Empty: none was found."""
        ...

    def look_everywhere(self) -> str:
        """Search everything; see ``look``."""
        ...


class Outside:
    """Watches for both, and corrects the stop reason of a run accordingly.

    Args:
        clock: The system's; the tests have one that can be suspended.
        real: The servo is real: its Bus Watchdog runs on while the computer is suspended, so no run
            goes on after that.
    """

    def __init__(self, clock: Clock, real: bool) -> None:
        self._suspension = Suspension(clock)
        self._real = real
        self._found: tuple[Trip, str] | None = None
        self.users: Users | None = None
        """The users of the port, once it is open"""

    def look(self) -> bool:
        """Whether the run must end. Costs little, and never waits."""
        if self._found is None:
            self._found = self._suspended() or self._shared(everywhere=False)
        return self._found is not None

    def verdict(self, reason: StopReason) -> tuple[StopReason, str]:
        """Return the final stop reason, and its external cause; empty: there was none.

        Args:
            reason: The reason that loop and supervisor found.
        """
        if reason in _LOOKS_LIKE or reason == End.REFUSED:
            # A suspension explains more than a port that was opened on resumption.
            found = self._suspended() or self._found or self._shared(everywhere=True)
        else:
            found = self._found if reason == End.INTERRUPTED else None
        if found is None:
            return reason, ""
        trip, text = found
        if reason == End.REFUSED:
            return reason, text
        if before := Trip.of(reason):
            text += f"; the run had ended by {before.label}"
        return trip, text

    def notes(self) -> list[str]:
        """Return events that did not end the run but should be reported."""
        notes = []
        if not self._real and (seconds := self._suspension.seconds()):
            notes.append(f"the computer was suspended for {seconds:.3g} s during the run")
        return notes

    def _suspended(self) -> tuple[Trip, str] | None:
        seconds = self._suspension.seconds() if self._real else 0.0
        if not seconds:
            return None
        return Trip.SUSPENDED, f"the computer was suspended for {seconds:.3g} s"

    def _shared(self, everywhere: bool) -> tuple[Trip, str] | None:
        if self.users is None:
            return None
        text = self.users.look_everywhere() if everywhere else self.users.look()
        return (Trip.PORT_SHARED, text) if text else None
