"""Defines optional abilities of a servo; a caller must work without them."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from haptic_wall.hw.clock import Clock
from haptic_wall.hw.hand import SharedHand
from haptic_wall.hw.servo import Servo


@runtime_checkable
class HasStandIn(Protocol):
    """A servo whose driver can be exercised without it, to keep the processor's caches warm."""

    def stand_in(self, clock: Clock) -> Servo:
        """Return a started servo of the same make that moves nothing and needs no other end.

        It shares nothing with this servo and its bus, so that calls to it have no effect. It
        answers at once, with invented positions.

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
class TakesHand(Protocol):
    """A simulated servo whose shaft a person can hold."""

    def take_hand(self, hand: SharedHand) -> None:
        """Let the hand hold the shaft whenever it holds on."""
        ...


@runtime_checkable
class HasHealth(Protocol):
    """A servo that reports its supply and its temperature while it runs."""

    def health(self) -> tuple[float, float]:
        """Return the last known supply [V] and temperature [°C]; supply 0: not known yet."""
        ...


@runtime_checkable
class HasTrouble(Protocol):
    """A servo that can say what was wrong with it."""

    trouble: str
    """The fault and its remedy, known after ``stop``; empty: none"""
