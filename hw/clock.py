"""Clocks: the system's monotonic one, and a simulated one that a test or a fast run moves."""

from __future__ import annotations

import time
from typing import Protocol


class Clock(Protocol):
    """What tells the time and waits; everything that runs is given one."""

    def now_ns(self) -> int:
        """Present time [ns] from an arbitrary, fixed origin; never goes back."""
        ...

    def wait_until(self, instant_ns: int) -> None:
        """Return when ``instant_ns`` [ns] has come; at once when it is past."""
        ...


class MonotonicClock:
    """CLOCK_MONOTONIC of the system: never steps, the same in every process of the machine."""

    now_ns = staticmethod(time.monotonic_ns)

    def wait_until(self, instant_ns: int) -> None:
        """Sleep until ``instant_ns`` [ns]; ``time.sleep`` is absolute and resumes after signals."""
        remaining = instant_ns - time.monotonic_ns()
        if remaining > 0:
            time.sleep(remaining * 1e-9)


class SimulatedClock:
    """Time that passes only when somebody waits: deterministic, as fast as the machine allows."""

    __slots__ = ("_now",)

    def __init__(self, start_ns: int = 0) -> None:
        self._now = start_ns

    def now_ns(self) -> int:
        """Simulated time [ns]."""
        return self._now

    def wait_until(self, instant_ns: int) -> None:
        """Move the time to ``instant_ns`` [ns] unless it is past already."""
        self._now = max(self._now, instant_ns)
