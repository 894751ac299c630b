"""Defines optional abilities of a bus; a caller must work without them."""

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
    """Servos that report their supply and their temperature while they run."""

    def health(self) -> list[tuple[float, float]]:
        """Return each one's last supply [V] and temperature [°C]; supply 0: not known yet."""
        ...


@runtime_checkable
class HasTrouble(Protocol):
    """Servos that can say what was wrong with them."""

    trouble: str
    """The fault and its remedy, known after ``stop``; empty: none"""
