"""Refuses positions that the servo cannot have reached since the last accepted one."""

from __future__ import annotations

import math
from typing import Final

from haptic_wall.hw.dynamixel.registers import POSITION_UNIT

_REFUSALS: Final = 3
"""Largest number of consecutive refusals. A persistent jump is no hiccup: the next position is
passed on, so that the speed check sees it."""
_SLACK: Final = 2
"""Tolerance for the encoder's steps [counts]"""


class JumpFilter:
    """Detects position jumps: broken replies that look valid, or an encoder fault.

    Args:
        max_speed: The fastest possible motion [rad/s]; 0: unlimited.
    """

    def __init__(self, max_speed: float) -> None:
        self._rate = max_speed / POSITION_UNIT * 1e-9 or math.inf
        """[counts/ns]"""
        self._counts = 0
        self._sampled_ns = 0
        self._refused = _REFUSALS

    def forget(self) -> None:
        """Restart: accept any next position."""
        self._refused = _REFUSALS

    def accepts(self, counts: int, sampled_ns: int) -> bool:
        """Return whether a position is plausible; if so, it becomes the reference for the next one.

        The allowed distance grows with the time since the last accepted sample.

        Args:
            counts: The position.
            sampled_ns: Instant of the sample [ns].
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
