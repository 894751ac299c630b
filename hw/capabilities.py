"""Defines optional abilities of a servo; a caller must work without them."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

from haptic_wall.hw.hand import SharedHand


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
