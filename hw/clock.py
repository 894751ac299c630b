"""The clocks: the system's monotonic one, and a simulated one that tests and fast runs advance."""

from __future__ import annotations

import select
import time
from collections.abc import Collection
from itertools import chain
from typing import Protocol


class Clock(Protocol):
    """Tells the time and waits; every part of the program is given one."""

    def now_ns(self) -> int:
        """Return the present time [ns] from an arbitrary, fixed origin; never decreases."""
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
    """Time that passes only by waiting: deterministic, as fast as the machine allows."""

    __slots__ = ("_now",)

    def __init__(self, start_ns: int = 0) -> None:
        self._now = start_ns

    def now_ns(self) -> int:
        """Return the simulated time [ns]."""
        return self._now

    def wait_until(self, instant_ns: int) -> None:
        """Advance the time to ``instant_ns`` [ns] unless it is past."""
        self._now = max(self._now, instant_ns)


def ready(readable: Collection[int], timeout_s: float, writable: Collection[int] = ()) -> list[int]:
    """Return the descriptors that are ready, after waiting until one is, to the microsecond.

    Args:
        readable: Descriptors to read from, below 1024.
        timeout_s: Longest wait [s].
        writable: Descriptors to write to.

    Raises:
        OSError: A descriptor is closed.
        ValueError: A descriptor is negative, or too large.
    """
    return [*chain.from_iterable(select.select(readable, writable, (), timeout_s))]
