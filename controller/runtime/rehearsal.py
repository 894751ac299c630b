"""Runs a tick on stand-ins just before a deadline, so that the processor knows it when it counts.

A tick is some thousand lines of interpreter and program that are used for a few microseconds once a
period. In between the processor sleeps, and its caches and branch predictors forget: the same tick
takes two to three times as long as in a loop without pause. The waiter wakes some time before each
deadline anyway, and would only look at the clock. Instead it lets a second tick run, with a wall, a
detector and a servo of its own: the same code, and nobody's torque.
"""

from __future__ import annotations

import time
from collections.abc import Callable

_LOOK_NS = 5000
"""How much later the stand-in's clock is each time it is looked at [ns]"""
_UP, _DOWN = 3, 10
"""Powers of two by which the time needed grows and falls: some 99 of 100 rehearsals take less"""
_LEAST_NS = 1000
"""By which it grows at least [ns]"""


class StandInClock:
    """Time as a rehearsal has it: it passes by being looked at, and nobody waits for it."""

    __slots__ = ("_now",)

    def __init__(self) -> None:
        self._now = 0

    def now_ns(self) -> int:
        """See ``Clock``."""
        self._now += _LOOK_NS
        return self._now

    def boot_ns(self) -> int:
        """See ``Clock``."""
        return self._now

    def wait_until(self, instant_ns: int) -> None:
        """See ``Clock``."""
        self._now = max(self._now, instant_ns)


class Rehearsal:
    """A tick that may be run at any time, as often as wanted, because nothing comes of it.

    Args:
        run: Of a ``Tick`` made of stand-ins, not of anything that the loop uses.
        clock: The one that it runs on.
        period_ns: Of the loop [ns].
        idle: What the servo itself can do beforehand.

    Attributes:
        need_ns: How much time to have for it, by what it took [ns].
        fault: Why there are no more rehearsals; empty: there are.
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
        """Rehearse, if there is time. Never raises: an error ends the rehearsals, not the run.

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
        """Rehearse after some naps, to know what it needs; whether that is little enough.

        Args:
            most_ns: What there is for it, now and later [ns].
            naps: How many.
            nap_ns: How long each is [ns].
        """
        for _ in range(naps):
            time.sleep(nap_ns * 1e-9)
            self(self._period_ns)
        self._most_ns = max(most_ns, 0)
        return self.need_ns <= most_ns and not self.fault
