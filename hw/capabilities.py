"""Defines optional abilities of a bus; a caller must work without them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

from haptic_wall.hw.hand import SharedHand


@runtime_checkable
class TakesHand(Protocol):
    """Simulated servos whose shafts a person can hold."""

    def take_hand(self, hand: SharedHand) -> None:
        """Let the hand hold each shaft whenever it holds on."""
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


@runtime_checkable
class GivesUp(Protocol):
    """Servos whose start can be given up between two of them."""

    given_up: Callable[[], bool]
    """Asked before each servo's start; True: ``start`` raises a ``GivenUpError`` instead"""
