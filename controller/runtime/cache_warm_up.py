"""Warms the processor's caches: executes a dry-run tick just before each deadline.

A tick is some thousand lines of interpreter and program code, used for a few microseconds once a
period. The processor sleeps in between, and its caches and branch predictors lose that code: the
same tick takes two to three times as long as in a loop without pause. The waiter wakes some time
before each deadline anyway, and would only read the clock. It executes a second tick instead, which
has a wall, a detector and a servo of its own: the same code without any effect. On a bus the port's
driver also makes the system calls of a request, without effect.

The gain is smaller on a bus, where the loop sleeps again until the reply. The core works about 10 %
more. Several warm-ups do not make the tick quicker. One while the reply travels delays its reading
by 30 µs.
"""

from __future__ import annotations

import time
from collections.abc import Callable

_LOOK_NS = 5000
"""Advance of the dry run's clock per reading [ns]"""
_UP, _DOWN = 3, 10
"""Powers of two by which the needed time grows and falls: about 99 of 100 warm-ups take less"""
_LEAST_NS = 1000
"""Least growth of the needed time [ns]"""


class StandInClock:
    """Clock of the dry-run tick: advances with each reading, and waiting returns at once."""

    __slots__ = ("_now",)

    def __init__(self) -> None:
        self._now = 0

    def now_ns(self) -> int:
        """Return the time; see ``Clock``."""
        self._now += _LOOK_NS
        return self._now

    def boot_ns(self) -> int:
        """Return the time; see ``Clock``."""
        return self._now

    def wait_until(self, instant_ns: int) -> None:
        """Return at once; see ``Clock``."""
        self._now = max(self._now, instant_ns)


class CacheWarmUp:
    """Executes a dry-run tick, at any time and as often as wanted, without any effect.

    Args:
        run: Of a ``Tick`` made of stand-ins, which shares nothing with the loop.
        clock: The stand-ins' clock.
        period_ns: Period of the loop [ns].
        idle: Preparations of the servo itself.

    Attributes:
        need_ns: Time to allow for it, estimated from its duration [ns].
        fault: Why there are no more warm-ups; empty: there are.
    """

    __slots__ = (
        "_clock",
        "_deadline_ns",
        "_idle",
        "_most_ns",
        "_period_ns",
        "_run",
        "fault",
        "need_ns",
    )

    def __init__(
        self,
        run: Callable[[int, int, int], None],
        clock: StandInClock,
        period_ns: int,
        idle: Callable[[], None],
    ) -> None:
        self._run = run
        self._clock = clock
        self._period_ns = period_ns
        self._idle = idle
        self._deadline_ns = clock.now_ns()
        self._most_ns = period_ns
        self.need_ns = 0
        self.fault = ""

    def __call__(self, left_ns: int) -> None:
        """Execute a dry-run tick if there is time; never raises.

        An error ends the warm-ups, not the run.

        Args:
            left_ns: Until the deadline [ns].
        """
        need_ns = self.need_ns
        if left_ns < need_ns or self.fault:
            return
        began_ns = time.monotonic_ns()
        self._deadline_ns = deadline_ns = self._deadline_ns + self._period_ns
        try:
            self._idle()
            self._clock.wait_until(deadline_ns)
            self._run(deadline_ns, deadline_ns, 0)
        except Exception as error:  # noqa: BLE001 - whatever it is, the run goes on without
            self.fault = f"{type(error).__name__}: {error}"
            self.need_ns = 0
            return
        if time.monotonic_ns() - began_ns > need_ns:
            self.need_ns = min(need_ns + (need_ns >> _UP) + _LEAST_NS, self._most_ns)
        else:
            self.need_ns = need_ns - (need_ns >> _DOWN)

    def practise(self, most_ns: int, naps: int = 100, nap_ns: int = 300_000) -> bool:
        """Measure the needed time in dry runs after sleeps; return whether it is short enough.

        Args:
            most_ns: Available time [ns].
            naps: Number of dry runs.
            nap_ns: Duration of each sleep [ns].
        """
        for _ in range(naps):
            time.sleep(nap_ns * 1e-9)
            self(self._period_ns)
        self._most_ns = max(most_ns, 0)
        return self.need_ns <= most_ns and not self.fault
