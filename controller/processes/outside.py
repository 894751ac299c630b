"""Watch for reasons outside to end a run: another program on the port, a suspended computer.

Either makes loop or servo fail in ways that look like a bad cable, a weak supply or a stall. So it
is looked for while all is well, and once more when the loop has tripped by itself.
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
"""Trips by which either may end a run before it is noticed itself"""


class Users(Protocol):
    """Tells who else uses the port."""

    brief: bool
    """Somebody opened the port and closed it again, without being seen"""

    def look(self) -> str:
        """Look a little; who it is, for people. Empty: nobody was seen."""
        ...

    def look_everywhere(self) -> str:
        """Look at all there is to see; see ``look``."""
        ...


class Outside:
    """Looks for both, and has the last word on why a run ended.

    Args:
        clock: The system's; one for the tests can be suspended.
        real: The servo is real: its Bus Watchdog runs on while the computer is suspended, so no
            run goes on after that.
    """

    def __init__(self, clock: Clock, real: bool) -> None:
        self._suspension = Suspension(clock)
        self._real = real
        self._found: tuple[Trip, str] | None = None
        self.users: Users | None = None
        """Those of the port, once it is open"""

    def look(self) -> bool:
        """Whether the run must end. Costs little, and never waits."""
        if self._found is None:
            self._found = self._suspended() or self._shared(everywhere=False)
        return self._found is not None

    def verdict(self, reason: StopReason) -> tuple[StopReason, str]:
        """Why the run ended, when all is known, and what is behind it; empty: nothing of this.

        Args:
            reason: As far as loop and supervisor know.
        """
        if reason in _LOOKS_LIKE or reason == End.REFUSED:
            # A computer that was suspended says more than what was opened when it came back.
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
        """Events that did not end the run, and should be known."""
        notes = []
        if not self._real and (seconds := self._suspension.seconds()):
            notes.append(f"the computer was suspended for {seconds:.3g} s during the run")
        if self.users is not None and self.users.brief:
            notes.append("a program opened the port during the run and closed it again")
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
