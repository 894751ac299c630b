"""Which positions a servo can have come to since the last one that was used."""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.hw.dynamixel.tables import POSITION_UNIT

_REFUSALS: Final = 3
"""Positions out of reach that are refused in a row. What persists is no hiccup: the next is passed
on, so that whoever watches the speed sees it."""
_SLACK: Final = 2
"""What an encoder's steps may add to a motion [counts]"""


class Reach:
    """Refuses a position that jumps: a reply that is broken and looks whole, or an encoder.

    Args:
        max_speed: The fastest motion there may be [rad/s]; 0: any.
    """

    __slots__ = ("_counts", "_rate", "_refused", "_sampled_ns")

    def __init__(self, max_speed: float) -> None:
        self._rate = max_speed / POSITION_UNIT * 1e-9 or math.inf
        """[counts/ns]"""
        self._counts = 0
        self._sampled_ns = 0
        self._refused = _REFUSALS

    def forget(self) -> None:
        """Take the next position from anywhere."""
        self._refused = _REFUSALS

    def holds(self, counts: int, sampled_ns: int) -> bool:
        """Whether a position may be used; then the next one is measured from it.

        The longer ago the last one was sampled, the further it may be.

        Args:
            counts: The position.
            sampled_ns: Its instant [ns].
        """
        if self._refused < _REFUSALS:
            moved = abs(counts - self._counts)
            if moved > self._rate * (sampled_ns - self._sampled_ns) + _SLACK:
                self._refused += 1
                return False
        self._refused = 0
        self._counts = counts
        self._sampled_ns = sampled_ns
        return True
