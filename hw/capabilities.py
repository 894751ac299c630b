"""Optional abilities of a servo beyond the interface: a caller asks once, and does without."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.servo import Servo


@runtime_checkable
class HasStandIn(Protocol):
    """A servo whose driver can be exercised without it, to keep the processor's caches warm."""

    def stand_in(self, clock: Clock) -> Servo:
        """Return a started servo of the same make that moves nothing and needs no other end.

        It has nothing in common with this servo and its bus: what is done to it has no effect. It
        answers at once, with positions that it makes up.

        Args:
            clock: Its time.
        """
        ...


@runtime_checkable
class HasIdleWork(Protocol):
    """A servo with work that can be done before the next request."""

    def idle(self) -> None:
        """Do that work while the loop waits for a deadline; send nothing, read nothing."""
        ...


@runtime_checkable
class HasTrouble(Protocol):
    """A servo that can say what was wrong with it."""

    trouble: str
    """The fault and its remedy, known after ``stop``; empty: none"""
